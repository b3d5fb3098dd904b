"""The command line: parse, call, exit code.

Commands import what they need when they run, so that `--help` is quick.  What a command does is elsewhere;
here are its options.  Errors and progress bars are `shell.py`.
"""

from __future__ import annotations

import os
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

import cmpcheck.optimise.command
import cmpcheck.rerun_command
import cmpcheck.sensitivity.command  # noqa: F401  (they register themselves)
from cmpcheck.shell import (
    INTERRUPTED,
    BadInput,
    app,
    command,
    complain,
    progress_bars,
    sentence_of,
    show_fraction,
)

if TYPE_CHECKING:
    from cmpcheck.results import SuiteResult
    from reference.case import Case


class Profile(StrEnum):
    """How much is run."""

    quick = "quick"
    full = "full"


class Stepper(StrEnum):
    """Who makes the steps of the reference."""

    plain = "plain"
    fast = "fast"


def main() -> None:
    """Entry point of the command `cmpcheck`."""
    app(prog_name="cmpcheck")


@command()
def compare(
    cases: Annotated[
        list[str] | None, typer.Argument(metavar="[CASE]...", help="names or files; default all")
    ] = None,
    engine: Annotated[
        list[str] | None, typer.Option(help="one to compare; may be repeated; default all")
    ] = None,
    profile: Annotated[Profile, typer.Option(help="how much is run")] = Profile.quick,
    out: Annotated[Path, typer.Option(help="folder of the report")] = Path("reports/latest"),
    deck: Annotated[
        list[str] | None, typer.Option(metavar="CASE=FILE", help="a LAMMPS deck for a case")
    ] = None,
    trajectory: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CASE[/VARIANT]=FILE", help="what another code computed: dump, CSV, Parquet, VTK"
        ),
    ] = None,
    units: Annotated[
        str, typer.Option(help="of trajectories that do not say them: si, cgs, micro, nano, or length=um,...")
    ] = "",
    time_step: Annotated[str, typer.Option(help='of the code that wrote the trajectory, "10 ps"')] = "",
    contact_duration: Annotated[str, typer.Option(help='of its contacts, "1 ns"; 0: none')] = "",
    study: Annotated[
        list[str] | None, typer.Option(help="one to run; may be repeated; all in the full profile")
    ] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="processes; default one per processor")] = None,
    strict: Annotated[
        bool, typer.Option("--strict", help="exit 1 too when something was not tested")
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="go on with a comparison that was interrupted or killed")
    ] = False,
    force: Annotated[
        bool, typer.Option("--force", help="write into a folder that holds other files")
    ] = False,
) -> None:
    """Compare engines and write a report.

    Runs every case in every engine, compares the runs with closed forms and with the reference.  With
    `--study` and without cases only those studies are run; named cases are run without any.  What is finished
    is kept as it comes: --resume goes on, with the same options, to the same report.
    """
    from cmpcheck.comparing import Stopped, make_report
    from cmpcheck.request import request_of
    from cmpcheck.trajectories import Options

    if resume and force:
        raise BadInput("--resume and --force: one goes on, the other starts again; allowed: one of them")
    options = Options(units, time_step, contact_duration)
    request = request_of(
        cases or [], engine or [], profile.value, deck or [], trajectory or [], options, study or []
    )
    try:
        result = make_report(request, out, jobs or os.cpu_count() or 1, force, resume)
    except Stopped as stopped:
        complain(str(stopped), stopped.code)
    _show(result, out, strict)


def _show(result: SuiteResult, out: Path, strict: bool) -> NoReturn:
    """What a terminal shows of a report, and the exit code."""
    from rich.console import Console

    from cmpcheck.report import exit_code, summary_table
    from cmpcheck.verdicts import headline

    console = Console()
    if result.cases:
        console.print(summary_table(result))
    for found in result.studies:
        console.print(f"{found.name}: {found.error or found.sentence}", highlight=False, markup=False)
    console.print(headline(result), highlight=False)
    console.print(f"report: {out / 'index.html'}", soft_wrap=True, highlight=False)
    raise typer.Exit(exit_code(result, strict))


@command()
def run(
    case: Annotated[str, typer.Argument(help="name or file of a case")],
    engine: Annotated[str, typer.Option(help="the engine that runs it")] = "reference",
    out: Annotated[Path | None, typer.Option(help="run folder; default runs/CASE")] = None,
    stepper: Annotated[
        Stepper | None, typer.Option(help="of the reference, instead of the case's: fast skips what it can")
    ] = None,
    threads: Annotated[
        int | None, typer.Option(help="of the fast stepper with many particles; default all, same numbers")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="go on with a run that was interrupted or killed")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="write over an existing run folder")] = False,
) -> None:
    """Run one case in one engine.

    The run folder is kept: one below it for each variant of a case that has any.  The reference saves its
    state every ten seconds; --resume goes on from there to the same numbers.
    """
    from cmpcheck import outputs
    from cmpcheck.comparing import RUNS
    from cmpcheck.request import require_engines
    from cmpcheck.single import run_variant
    from cmpcheck.summary import summary
    from reference.case import load_case
    from reference.checkpoint import is_complete

    loaded = load_case(case)
    require_engines([engine])
    if stepper is not None and engine != "reference":
        raise BadInput(f"--stepper: {engine} has none to choose; allowed: with the reference")
    if threads is not None:
        _take_threads(threads, engine)
    if resume and force:
        raise BadInput("--resume and --force: one goes on, the other starts again; allowed: one of them")
    if resume and engine != "reference":
        raise BadInput(
            f"--resume: only the reference can go on with a run; start {engine} again with --force"
        )
    folder = outputs.claim_run_folder(out or RUNS / loaded.name, force, resume)
    variants = [_stepped(variant, stepper) for variant in loaded.variants()]
    there = [variant for variant in variants if is_complete(folder / variant.variant)]
    lines: list[str] = []
    try:
        with progress_bars() as bars:
            for variant in variants:
                task = bars.add_task(variant.variant or variant.name, total=1.0)
                result = run_variant(
                    variant, engine, folder / variant.variant, show_fraction(bars, task), resume
                )
                lines += [
                    f"{variant.name} {variant.variant}".strip(),
                    *(f"  {line}" for line in summary(result)),
                ]
    except KeyboardInterrupt:
        go_on = _go_on(case, out, engine, stepper)
        complain(f"interrupted: {folder} keeps what was recorded, marked as not complete{go_on}", INTERRUPTED)
    except OSError as problem:
        keeps = f"; {folder} keeps what was written before{_go_on(case, out, engine, stepper)}"
        complain(f"{sentence_of(problem)}{keeps}", 1)
    for line in lines:
        typer.echo(line)
    if there:
        share = f"{len(there)} of {len(variants)} variants were " if len(variants) > len(there) else ""
        typer.echo(f"{share}complete already")
    typer.echo(f"run: {folder}")


def _take_threads(count: int, engine: str) -> None:
    """Have the reference use as many threads."""
    from reference.fast.threads import use_threads

    if engine != "reference":
        raise BadInput(f"--threads: {engine} takes none from here; allowed: with the reference")
    try:
        use_threads(count)
    except ValueError as problem:
        raise BadInput(f"--threads: {problem}") from None


def _stepped(case: Case, stepper: Stepper | None) -> Case:
    """The case with another stepper, or as it is."""
    if stepper is None:
        return case
    if stepper is Stepper.fast and case.numerics.scheme != "point_implicit":
        raise BadInput("--stepper: fast takes steps of scheme = 'point_implicit'; allowed: plain")
    return case.model_copy(update={"numerics": case.numerics.model_copy(update={"stepper": stepper.value})})


def _go_on(case: str, out: Path | None, engine: str, stepper: Stepper | None = None) -> str:
    """How to go on with a run, for the end of a line."""
    where = (f" --out {out}" if out else "") + (f" --stepper {stepper.value}" if stepper else "")
    return f"; to go on: cmpcheck run {case}{where} --resume" if engine == "reference" else ""


@command(
    options_metavar="FILE [LAMMPS FLAGS]",
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
)
def deck(context: typer.Context) -> None:
    """Run a LAMMPS deck with the Python fix.

    Takes what lmp takes: -in FILE, -var, -log, -screen; or FILE first, and then the flags.
    """
    from cmpcheck.deck import run_deck

    arguments = list(context.args)
    if arguments and not arguments[0].startswith("-"):
        arguments.insert(0, "-in")
    raise typer.Exit(run_deck(arguments))


@command()
def export(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="a run folder")],
    form: Annotated[str, typer.Option("--format", help="vtu, pvd, stl, csv or dump")],
    out: Annotated[Path | None, typer.Option(help="folder to write; default RUN/FORMAT")] = None,
    force: Annotated[
        bool, typer.Option("--force", help="write into a folder that holds other files")
    ] = False,
) -> None:
    """Write a run for other programs.

    vtu (first and last state) and pvd (all times) for ParaView, stl the surface, csv tables, dump for OVITO.
    """
    from cmpcheck.export import FORMATS, export_run, load_run
    from reference.toml_source import nearest

    if form not in FORMATS:
        raise BadInput(f"unknown format {form!r}: {nearest(form, FORMATS)}")
    loaded = load_run(run)
    files = export_run(loaded, form, out or run / form, force)
    if not loaded.provenance.get("complete"):
        typer.echo(f"cmpcheck: {run} is not complete: it ends at {loaded.times[-1]:g} s", err=True)
    for file in files if len(files) < 5 else files[-1:]:
        typer.echo(str(file))


@command()
def figures(
    out: Annotated[Path, typer.Option(help="folder of the figures")] = Path("reports/figures"),
    samples: Annotated[int, typer.Option(min=2, help="runs whose mean and spread are drawn")] = 8,
    jobs: Annotated[int | None, typer.Option(min=1, help="runs at a time; default one per processor")] = None,
) -> None:
    """Draw the paper's figures from our own runs.

    Figs. 2 to 6 as SVG and PNG, with captions in README.md; earlier ones are replaced.
    """
    from cmpcheck.figures import EXAMPLE, simulate_samples, write_figures
    from cmpcheck.outputs import writable
    from reference.case import load_case

    writable(out)
    (case,) = load_case(EXAMPLE).variants()
    with progress_bars() as bars:
        task = bars.add_task(case.name, total=samples)
        runs = simulate_samples(
            case, samples, jobs or os.cpu_count() or 1, lambda done: bars.update(task, completed=done)
        )
    for file in write_figures(runs, out):
        typer.echo(str(file))


@command()
def doctor() -> None:
    """Show what is installed and what is missing.

    For each engine its version, or the command that installs it; exit code 1 when anything is
    missing that is not optional.
    """
    from cmpcheck.doctor import examine

    findings = examine()
    for finding in findings:
        typer.echo(
            f"{finding.name:<10} {finding.version or 'missing: ' + finding.problem}  ({finding.what_for})"
        )
        if finding.remedy:
            typer.echo(f"{'':<10} install with: {finding.remedy}")
    raise typer.Exit(int(not all(finding.found or finding.optional for finding in findings)))


@command()
def cases() -> None:
    """List the cases that ship, a sentence each."""
    from cmpcheck.published import benchmark_names, load_benchmark
    from reference.case import available_cases, load_case

    for name in available_cases():
        typer.echo(f"{name:<16} {load_case(name).case.description}")
    for name in benchmark_names():
        typer.echo(f"{name:<16} {load_benchmark(name).sentence}")


@command()
def init(
    case: Annotated[str, typer.Argument(help="name of a case that ships")],
    file: Annotated[Path, typer.Argument(help="file to write")],
    deck: Annotated[
        bool, typer.Option("--deck", help="copy the LAMMPS deck of the case, not the case")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="write over an existing file")] = False,
) -> None:
    """Write a case file or a deck to start from, the latter with what `compare --deck` needs in comments."""
    from cmpcheck.engines.lammps_contract import contract
    from cmpcheck.engines.lammps_library import EngineError
    from cmpcheck.engines.lammps_setup import Deck, deck_path
    from cmpcheck.outputs import write_new
    from cmpcheck.published import benchmark_names
    from reference.case import CASES, CaseError, available_cases
    from reference.toml_source import nearest

    known = available_cases() + (benchmark_names() if deck else [])
    if case not in known:
        raise CaseError(f"unknown case {case!r}: {nearest(case, known)}")
    try:
        source = deck_path(case) if deck else CASES / f"{case}.toml"
    except EngineError as problem:
        raise BadInput(str(problem)) from None
    text = source.read_text("utf-8")
    if deck and case not in benchmark_names():  # whose decks say at their top what they need
        text = contract(case, Deck(source, text))
    write_new(file, text, force)
    typer.echo(str(file))
