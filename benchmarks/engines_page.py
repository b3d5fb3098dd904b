"""`engines.md` and the keys of `results.json`, made of what `engines.py` has measured and nothing else."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks import record
from benchmarks.engines_findings import findings
from benchmarks.measurement import Cell, Way, digits
from benchmarks.outcome import DIFFERENCE, ERRORS

OUTPUT = Path(__file__).with_name("engines.md")
COMPARED = "flat"  # the surface of `particle_steps_per_s`: every engine has it
QUIET = 0.2  # cores


def write(
    cells: Sequence[Cell], conditions: dict[str, Any], page: Path = OUTPUT, results: Path = record.RESULTS
) -> None:
    """Write page and results."""
    page.write_text(text(cells, conditions), "utf-8")
    record.store(
        {"particle_steps_per_s": speeds(cells), "engines": conditions | {"runs": rows(cells)}}, results
    )


def speeds(cells: Iterable[Cell]) -> dict[str, dict[str, float]]:
    """{engine: {N: particle-steps per second}}, medians, over the flat surface and on one rank."""
    found: dict[str, dict[str, float]] = {}
    for cell in cells:
        if cell.measured and cell.surface == COMPARED and cell.way.ranks == 1:
            found.setdefault(cell.way.key, {})[str(cell.count)] = cell.middle("speed")
    return found


def rows(cells: Iterable[Cell]) -> list[dict[str, Any]]:
    """Everything, one entry for each way, surface and size."""
    return [
        {
            "engine": cell.way.key, "ranks": cell.way.ranks, "surface": cell.surface, "N": cell.count,
            "triangles": cell.triangles, "problem": cell.way.missing or cell.problem,
            "particle_steps_per_s": [run.speed for run in cell.runs],
            "simulated_s_per_s": [run.pace for run in cell.runs],
            "energy_over_reference": [run.outcome.energy for run in cell.runs if not run.outcome.problem],
            "shift_over_reference": [run.outcome.shift for run in cell.runs if not run.outcome.problem],
            "busy_cores_before": [run.busy for run in cell.runs],
        }
        for cell in cells
    ]  # fmt: skip


def text(cells: Sequence[Cell], conditions: dict[str, Any]) -> str:
    """The page."""
    surfaces = list(dict.fromkeys(cell.surface for cell in cells))
    runs = max((len(cell.runs) for cell in cells), default=0)
    lines = [
        "# Speed of the engines on one shear",
        "",
        "Particles in a Couette layer between a surface and a lid, with drag, restitution 0.5 and, between "
        "particles, friction 0.3; nothing is removed (`decks/shear.toml`). All engines start from the same "
        "particles, which the reference has sheared for 5 µs; the soft engines take the same steps, 50 to a "
        f"contact of 12 ns. Medians of {runs} runs of each, made in turn, with the lowest and the highest: "
        "million particle-steps per second; and µs/s, the time that is simulated in a second. LAMMPS and "
        'LIGGGHTS by themselves are timed by their own "Loop time", the reference and LIGGGHTS as driven by '
        "the wall-clock time of their steps; none of them includes setting up.",
        "",
        *_circumstances(cells, conditions),
    ]
    for surface in surfaces:
        lines += ["", f"## Surface: {surface}", "", *_table([c for c in cells if c.surface == surface])]
    lines += ["", "## What the numbers say", ""]
    lines += [f"- {line}" for line in findings(cells)] or ["Nothing: too little was measured."]
    lines += ["", "## Do all simulate the same?", "", *_checks(cells), ""]
    return "\n".join(lines)


def _circumstances(cells: Sequence[Cell], conditions: dict[str, Any]) -> list[str]:
    busy = [run.busy for cell in cells for run in cell.runs]
    versions = ", ".join(f"{name} {version}" for name, version in conditions["versions"].items())
    commit = f", commit {record.shown(conditions['commit'])}" if conditions["commit"] else ""
    lines = [
        f"Written by `{conditions['command']}` on {conditions['date']}{commit}. {conditions['machine']}; "
        f"{versions}."
    ]
    if busy:
        middle = median(busy)
        lines += [
            "",
            f"Just before each run {middle:.2f} cores were busy with other things (median; at most "
            f"{max(busy):.2f})."
            + ("" if middle <= QUIET else " **The machine was not quiet: two ranks suffer most from that.**"),
        ]
    return lines


def _ways(cells: Iterable[Cell]) -> list[Way]:
    return list(dict.fromkeys(cell.way for cell in cells))


def _table(cells: Sequence[Cell]) -> list[str]:
    """The speeds over one surface."""
    sizes = list(dict.fromkeys(cell.count for cell in cells))
    found = {(cell.way, cell.count): cell for cell in cells}
    head = "".join(f" N = {n} | lowest – highest | µs/s |" for n in sizes)
    lines = [f"| engine | ranks |{head}", "|---|---:|" + "---:|---:|---:|" * len(sizes)]
    for way in _ways(cells):
        entries = "".join(_entry(found[way, n]) for n in sizes)
        lines.append(f"| {way.label} | {way.ranks} |{entries}")
    return lines


def _entry(cell: Cell) -> str:
    if not cell.measured:
        return f" {cell.way.missing or cell.problem or 'not run'} | | |".replace("\n", " ")
    low, high = cell.extremes()
    middle, pace = _millions(cell.middle("speed")), digits(1e6 * cell.middle("pace"), 3)
    return f" {middle} | {_millions(low)} – {_millions(high)} | {pace} |"


def _millions(speed: float) -> str:
    return digits(speed / 1e6, 3)


def _checks(cells: Sequence[Cell]) -> list[str]:
    """The ends of the runs beside that of the reference."""
    wheres = list(dict.fromkeys((cell.surface, cell.count) for cell in cells))
    found = {(cell.way, cell.surface, cell.count): cell for cell in cells}
    lines = [
        "Kinetic energy per particle and mean change of height at the end, over those of the reference at "
        "the step of the soft engines. A speed is shown only if all particles are still there, and both "
        f"differ by {100 * DIFFERENCE:.0f} % or {ERRORS:g} standard errors of a particle's mean difference "
        "at most: equal starts part after some collisions. At N = 5000 that notices missing contacts with "
        "particles, surface or lid, missing friction and another flow; another restitution it does not.",
        "",
        "| engine | ranks |" + "".join(f" {surface}, N = {n} |" for surface, n in wheres),
        "|---|---:|" + "---:|" * len(wheres),
    ]
    for way in _ways(cells):
        entries = []
        for where in wheres:
            cell = found.get((way, *where))
            ends = [run.outcome for run in cell.runs] if cell else []
            entries.append(f" {ends[0].energy:.4f}, {ends[0].shift:.4f} |" if ends else " |")
        lines.append(f"| {way.label} | {way.ranks} |{''.join(entries)}")
    return lines
