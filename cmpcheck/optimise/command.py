"""The command `cmpcheck optimise`: its options, and how it ends.

It imports what it needs when it runs, as `cli.py` does.
"""

from __future__ import annotations

import math
import os
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cmpcheck.shell import INTERRUPTED, BadInput, command, complain, progress_bars, sentence_of

if TYPE_CHECKING:
    from cmpcheck.optimise.workers import Workers


class Second(StrEnum):
    """The other objective of a front."""

    removal_rate = "removal_rate"
    abrasive_mass = "abrasive_mass"


@command()
def optimise(
    case: Annotated[str, typer.Argument(help="name or file of a case with [optimise]")],
    out: Annotated[Path | None, typer.Option(help="folder; default reports/optimise/CASE")] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="go on with a run that was interrupted or killed")
    ] = False,
    jobs: Annotated[int | None, typer.Option(min=1, help="processes; default one per processor")] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="run on the Dask cluster of this scheduler")
    ] = None,
    compare_methods: Annotated[
        bool, typer.Option("--compare-methods", help="other methods of search at the same budget too")
    ] = False,
    seeds: Annotated[int, typer.Option(min=1, help="of each method that is compared")] = 3,
    front: Annotated[
        Second | None, typer.Option(help="flatness against this too, as a front without weights")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="start again in a folder that holds files")] = False,
) -> None:
    """Search for the best parameters of a process.

    The genetic algorithm of the paper over ensembles of samples, with its Table 1 and Figs. 7 and 8.  Every
    sample is kept as it finishes; --resume goes on to the same result.
    """
    from cmpcheck.optimise.links import DESIGNS
    from cmpcheck.optimise.problem import Problem
    from cmpcheck.optimise.run import Plan, run_design, summary
    from cmpcheck.optimise.store import Store
    from cmpcheck.optimise.workers import WorkersError
    from reference.case import load_case

    problem = Problem(load_case(case))
    if resume and force:
        raise BadInput("--resume and --force: one goes on, the other starts again; allowed: one of them")
    if scheduler and jobs:
        raise BadInput("--scheduler and --jobs: the cluster has workers of its own; allowed: one of them")
    if compare_methods or front:
        _require_pymoo("--compare-methods" if compare_methods else "--front")
    folder = out or Path("reports") / DESIGNS / problem.case.name
    go_on = f"to go on: cmpcheck optimise {case}{f' --out {out}' if out else ''} --resume"
    try:
        workers = _workers(scheduler, jobs)
    except WorkersError as problem_met:
        raise BadInput(str(problem_met)) from None
    with workers:
        store = Store.resume(folder, problem.case) if resume else Store.create(folder, problem.case, force)
        try:
            plan = Plan.kept(store, seeds if compare_methods else 0, front.value if front else "")
            with progress_bars() as bars:
                design = run_design(problem, store, workers, plan, bars)
        except KeyboardInterrupt:
            complain(f"interrupted: {folder} keeps {store.totals()[0]} samples; {go_on}", INTERRUPTED)
        except WorkersError as problem_met:
            complain(f"{problem_met}: {folder} keeps {store.totals()[0]} samples; {go_on}", 1)
        except OSError as problem_met:
            complain(f"{sentence_of(problem_met)}; {folder} keeps the samples that were finished; {go_on}", 1)
        finally:
            store.close()
    for line in summary(design):
        typer.echo(line)
    typer.echo(f"page: {folder / 'index.html'}")
    raise typer.Exit(int(math.isinf(design.ranked[0].cost)))


def _workers(scheduler: str | None, jobs: int | None) -> Workers:
    from cmpcheck.optimise.workers import DaskCluster, LocalProcesses

    return DaskCluster(scheduler) if scheduler else LocalProcesses(jobs or os.cpu_count() or 1)


def _require_pymoo(option: str) -> None:
    from importlib.util import find_spec

    if find_spec("pymoo") is None:
        raise BadInput(f'{option}: pymoo is not installed; install it with: pip install "cmpcheck[optimise]"')
