"""What the Python fix costs LAMMPS: a step with it over a step of the same particles without any fix of ours.

The layer of `polish_pair` at larger N, equally dense, with contact, drag, pad and removal. Two instances of
LAMMPS in one process take turns: the one with the fix makes a block of steps, then the other one goes on
from the same positions and velocities for as many, with its own contacts of pairs alone. Each block has its
ratio, so that what else the machine does falls on both. `python -m benchmarks.fix_overhead JOB END` is one
such process, one of the ranks.
"""

from __future__ import annotations

import math
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from benchmarks.shear import DEVELOPED, DEVELOPING_STEP, SWOLLEN
from benchmarks.shear_lammps import TIMEOUT
from benchmarks.shear_reference import shear
from cmpcheck.engines.lammps_library import available, open_lammps
from cmpcheck.engines.lammps_setup import Deck, create_atoms, deck_path, execute, input_flags, variables
from cmpcheck.engines.protocol import Resolution
from cmpcheck.fixes.layout import MICRO
from cmpcheck.fixes.slurry import DEFINE_STATE, SlurryFix
from cmpcheck.study import contact_settings
from reference.case import load_case
from reference.process import build_setup
from reference.state import DEPOSIT_NONE, Setup

CASE = "polish_pair"
PARTICLE_STEPS = 1_500_000  # of a block
GOALS = {73: 2.0, 5_000: 1.6}


class Job(NamedTuple):
    """Blocks to be run: in which form the fix acts, and whether it follows the contacts of pairs."""

    setup: Setup
    form: str
    observed: bool
    steps: int  # of a block
    blocks: int


def layer(count: int) -> Setup:
    """`polish_pair` with `count` particles at its density, sheared for a while under a pad that stays."""
    case = load_case(CASE)
    assert case.particles is not None
    assert case.surface.nodes is not None
    nodes = round(case.surface.nodes * math.sqrt(count / case.particles.count))
    spacing = case.surface.size / case.surface.nodes
    setup = build_setup(
        case.replaced({"particles.count": count, "surface.nodes": nodes, "surface.size": spacing * nodes})
    )
    calm = setup.model._replace(deposit=DEPOSIT_NONE, pad_descent=0.0)
    swollen = replace(setup.state, diameter=SWOLLEN * setup.state.diameter)
    _, _, end = shear(
        replace(setup, model=calm, state=swollen), DEVELOPING_STEP, round(DEVELOPED / DEVELOPING_STEP)
    )
    return replace(setup, state=replace(setup.state, position=end.position, velocity=end.velocity))


def instance(setup: Setup, form: str, log: Path) -> tuple[Any, Resolution]:
    """LAMMPS with the particles and pair contacts of the case's deck, and its resolution."""
    duration, steps = contact_settings(setup.case, "lammps")
    resolution = Resolution(duration / steps, duration, form)
    deck = Deck.read(deck_path(CASE))
    flags = input_flags(variables(setup, resolution, resolution.time_step))
    lmp = open_lammps(["-log", str(log), "-screen", "none", "-var", "driver", "cmpcheck", *flags])
    lines = [line for line in deck.definitions().splitlines() if not line.startswith("fix cmpcheck_state")]
    execute(lmp, "\n".join(lines), deck.path)
    for line in (f"timestep {resolution.time_step / MICRO!r}", "thermo 0"):
        lmp.command(line)
    return lmp, resolution


def work(job: Job, folder: Path) -> dict[str, Any] | None:
    """The blocks, in this process, one of the ranks; the first one returns what was measured."""
    setup = job.setup
    with_fix, resolution = instance(setup, job.form, folder / "with")
    with_fix.command(DEFINE_STATE)
    without, _ = instance(setup, job.form, folder / "without")
    for lmp in (with_fix, without):
        create_atoms(lmp, setup.state)
    with_fix.command("fix slurry all external pf/callback 1 1")
    fix = SlurryFix(
        with_fix, "slurry", setup.model, setup.state.modulus, setup.state.heights,
        pad_height=setup.state.pad_height, form=job.form, contact_duration=resolution.contact_duration,
        ledger_speed=setup.case.numerics.ledger_speed, observe_pairs=job.observed,
    )  # fmt: skip
    fix.attach()
    comm = with_fix.get_mpi_comm()
    clock = time.thread_time if comm.size == 1 else time.perf_counter
    for lmp in (with_fix, without):
        lmp.command("run 100")
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(job.blocks):
        times[0].append(timed(with_fix, job.steps, clock))
        fix.check()
        for name in ("x", "v"):
            without.scatter_atoms(name, 1, 3, with_fix.gather_atoms(name, 1, 3))
        times[1].append(timed(without, job.steps, clock))
    contacts = fix.contacts()
    for lmp in (with_fix, without):
        lmp.close()
    if comm.rank > 0:
        return None
    return {
        "N": len(setup.state.mass), "ranks": comm.size, "form": job.form, "pairs_followed": job.observed,
        "ratio": median(a / b for a, b in zip(*times, strict=True)),
        "lowest": min(a / b for a, b in zip(*times, strict=True)),
        "step_s": median(times[0]), "step_without_s": median(times[1]), "blocks": job.blocks,
        "surface_contacts": int((contacts.kind == "surface").sum()),
        "removals": int((contacts.removed_volume > 0.0).sum()),
    }  # fmt: skip


def timed(lmp: Any, steps: int, clock: Callable[[], float]) -> float:
    """Seconds of one step of a run, its short beginning included."""
    begin = clock()
    lmp.command(f"run {steps} post no")
    return (clock() - begin) / steps


def run(job: Job, ranks: int) -> dict[str, Any]:
    """One process, or one for each rank.  Raises RuntimeError with what they said when they fail."""
    with tempfile.TemporaryDirectory(prefix="cmpcheck-") as name:
        source, end = Path(name) / "job", Path(name) / "end"
        source.write_bytes(pickle.dumps(job))
        launcher = [str(Path(sys.executable).with_name("mpiexec")), "-n", str(ranks)] if ranks > 1 else []
        done = subprocess.run(
            [*launcher, sys.executable, "-m", "benchmarks.fix_overhead", str(source), str(end)],
            capture_output=True, text=True, timeout=TIMEOUT, cwd=Path(__file__).parents[1],
            stdin=subprocess.DEVNULL,
        )  # fmt: skip
        if done.returncode != 0:
            raise RuntimeError(f"LAMMPS has failed: {(done.stdout + done.stderr)[-500:]}")
        found: dict[str, Any] = pickle.loads(end.read_bytes())
        return found


def measure(quick: bool) -> dict[str, Any]:
    """`fix_overhead` {N: ratio} in the impulse form, that of the full case, on one rank; and every run."""
    found, reason = available()
    if not found:
        raise RuntimeError(reason)
    sizes, blocks, runs = (73, 5_000) if quick else (73, 5_000, 50_000), 5 if quick else 15, []
    for count in sizes:
        setup, steps = layer(count), max(30, PARTICLE_STEPS // (5 if quick else 1) // count)
        for form, observed, ranks in (
            ("impulse", False, 1), ("soft", False, 1), ("impulse", True, 1), ("impulse", False, 2),
        ):  # fmt: skip
            if ranks == 1 or count == max(sizes):
                runs.append(run(Job(setup, form, observed, steps, blocks), ranks))
                print(runs[-1], flush=True)
    plain = [
        one for one in runs if (one["form"], one["pairs_followed"], one["ranks"]) == ("impulse", False, 1)
    ]
    return {
        "fix_overhead": {str(one["N"]): one["ratio"] for one in plain},
        "fix_overhead_runs": runs,
    }


def lines(results: dict[str, Any]) -> list[str]:
    """The section of the page."""
    text = [
        "LAMMPS with the compiled fix (contact, drag, pad, removal) over LAMMPS with no fix, step by step on "
        f"the layer of `{CASE}`, both with LAMMPS's own contacts of pairs; medians of blocks that took "
        "turns in "
        "one process, each with its own ratio; processor time on one rank, wall-clock time on two, where the "
        "fix is a Python function around the compiled one.",
        "",
        "| N | ranks | form | pairs followed | with (µs/step) | without (µs/step) | ratio | lowest | goal |",
        "|---:|---:|---|---|---:|---:|---:|---:|---:|",
    ]
    for one in results["fix_overhead_runs"]:
        goal = GOALS.get(one["N"], "") if one["ranks"] == 1 and not one["pairs_followed"] else ""
        text.append(
            f"| {one['N']} | {one['ranks']} | {one['form']} | {'yes' if one['pairs_followed'] else 'no'} "
            f"| {1e6 * one['step_s']:.3g} | {1e6 * one['step_without_s']:.3g} | {one['ratio']:.2f} "
            f"| {one['lowest']:.2f} | {goal} |"
        )
    return text


def main() -> None:
    job, end = map(Path, sys.argv[1:])
    found = work(pickle.loads(job.read_bytes()), end.parent)
    if found is not None:
        end.write_bytes(pickle.dumps(found))


if __name__ == "__main__":
    main()
