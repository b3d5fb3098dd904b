"""`RESULTS.md` and its two plots, made of `results.json` and nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure

from benchmarks import record

PAGE = "RESULTS.md"
TITLES = {
    "polish_full": "A whole second of polishing",
    "fix_overhead": "What the fix costs LAMMPS",
    "engines": "Side by side",
    "scaling": "Cost and memory over the number of particles",
    "crowd": "The fast stepper with many particles, in threads",
    "samples": "Samples per minute, and Table 1",
    "start_up": "Start-up",
}
QUIET = 0.2  # cores
NAMES = {
    "reference": "reference, its own step", "reference_soft_step": "reference, the others' step",
    "lammps_fix": "LAMMPS, Python fix", "lammps_native": "LAMMPS by itself",
    "liggghts_plane": "LIGGGHTS, plane", "liggghts": "LIGGGHTS, mesh", "yade": "YADE",
    "lammps_observed": "LAMMPS, fix, pairs followed", "liggghts_observed": "LIGGGHTS, driven",
}  # fmt: skip


def write(pieces: Mapping[str, ModuleType], problems: Mapping[str, str], folder: Path) -> None:
    """Write page and plots of what `results.json` in the folder holds."""
    results = record.load(folder / "results.json")
    plots = {"cost_over_particles.svg": over_particles(results), "cost_over_time.svg": over_time(results)}
    for name, figure in plots.items():
        if figure is not None:
            with rc_context({"svg.hashsalt": "cmpcheck"}):  # the same figure is the same file
                figure.savefig(folder / name, metadata={"Date": None}, bbox_inches="tight")
    drawn = [name for name, figure in plots.items() if figure is not None]
    (folder / PAGE).write_text("\n".join(text(pieces, problems, results, drawn)), "utf-8")


def text(
    pieces: Mapping[str, ModuleType], problems: Mapping[str, str], results: dict[str, Any], plots: list[str]
) -> list[str]:
    """The lines of the page."""
    measured = results.get("measured", {})
    lines = [
        "# Results of the benchmarks",
        "",
        "Written by `make benchmark` (`python -m benchmarks`); the numbers themselves are in "
        "`results.json`, how "
        "they came about and what did not work in `NOTES.md`. Ratios are taken within one run.",
    ]
    for name, title in TITLES.items():
        lines += ["", f"## {title}", ""]
        if name in problems:
            lines += [f"**It failed when it was last run:** {problems[name]}", ""]
        if name not in measured:
            lines.append(f"Not measured yet: `python -m benchmarks --only {name}`.")
            continue
        lines += [*circumstances(measured[name]), "", *pieces[name].lines(results)]
    for name in plots:
        lines += ["", f"![{name.removesuffix('.svg').replace('_', ' ')}]({name})"]
    return [*lines, ""]


def circumstances(found: dict[str, Any]) -> list[str]:
    """When, where and how undisturbed a piece was run."""
    versions = ", ".join(
        f"{name} {found['versions'][name]}"
        for name in ("python", "numpy", "numba", "lammps", "liggghts", "yade")
        if name in found["versions"]
    )  # fmt: skip
    commit = f", commit {record.shown(found['commit'])}" if found["commit"] else ""
    disturbed = found["busy_cores_before"] > QUIET or found["load"] > 2.5
    return [
        f"*{found['date']}{commit}; {found['machine']}; {versions}; {found['busy_cores_before']:.2f} cores "
        "were busy "
        f"with other things before, load average {found['load']:.1f} at the end; it took "
        f"{found['took_s']:.0f} s."
        + (" **The machine was not quiet.**" if disturbed else "")
        + (" **Quick: short runs, to try the benchmark.**" if found["quick"] else "")
        + "*"
    ]


def over_particles(results: dict[str, Any]) -> Figure | None:
    """Nanoseconds of a particle-step over N: engines on one core, the fast stepper on each number of threads.

    None where nothing was measured.
    """
    speeds = results.get("particle_steps_per_s", {})
    layer = results.get("scaling", {}).get("runs", [])
    crowd = {"runs": [], "plain": []} | results.get("crowd", {})
    if not speeds and not layer and not crowd["runs"]:
        return None
    figure = Figure(figsize=(7, 4.6))
    axes = figure.subplots()
    for name, label in NAMES.items():
        points = sorted((int(n), 1e9 / speed) for n, speed in speeds.get(name, {}).items())
        if points:
            axes.plot(*zip(*points, strict=True), marker="o", label=label)
    if layer:
        axes.plot(
            [one["N"] for one in layer], [1e9 * one["s"] for one in layer], "k--", marker="s",
            label="reference, a layer without surface",
        )  # fmt: skip
    for threads in sorted({one["threads"] for one in crowd["runs"]}):
        points = [(one["N"], 1e9 * one["s"]) for one in crowd["runs"] if one["threads"] == threads]
        axes.plot(
            *zip(*points, strict=True), ":", marker="^", color={1: "black"}.get(threads, "gray"),
            label=f"fast stepper, rough surface and pad, {threads} thread{'s' * (threads > 1)}",
        )  # fmt: skip
    if crowd["plain"]:
        axes.plot(
            [one["N"] for one in crowd["plain"]], [1e9 * one["s"] for one in crowd["plain"]], "k-.",
            marker="v", label="plain stepper, rough surface and pad",
        )  # fmt: skip
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="particles N",
        ylabel="ns per particle-step, one thread unless named",
    )
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def over_time(results: dict[str, Any]) -> Figure | None:
    """Wall time over the simulated time of the paper's example, by stepper, and the plain one's µs a step."""
    found = results.get("polish_full", {}).get("steppers", {})
    if not found:
        return None
    figure = Figure(figsize=(7, 4.2))
    axes = figure.subplots()
    for name, one in found.items():
        windows = one.get("windows")
        if windows:
            times, walls = [0.0], [0.0]  # s
            for k, window in enumerate(windows):  # each stands for an equal part of the second
                times.append((k + 1) / len(windows))
                walls.append(walls[-1] + window["step_s"] * results["polish_full"]["steps"] / len(windows))
        else:
            times, walls = zip(*one["curve"], strict=True)
        axes.plot(
            times,
            walls,
            marker="o",
            markersize=4,
            label=f"{name} stepper, {one['how']}: {one['wall_s']:.0f} s",
        )
    axes.set(xlabel="simulated time (s), A = 1, N = 73", ylabel="wall-clock time (s), one core")
    axes.set_xlim(0, 1)
    axes.set_ylim(0)
    axes.grid(alpha=0.3)
    axes.legend()
    return figure
