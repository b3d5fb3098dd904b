"""Long runs: how much memory `polish_full` takes, and whether its balances close, over up to 1e8 steps.

`python -m benchmarks.reliability_long_runs [--full]` prints the findings.  --full runs the whole second (half
an hour) and keeps what it measured in `results.json`; without it, shortened cases run, and what was kept is
told.  Each run is a process of its own, whose resident memory is looked at while it runs.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.record import RESULTS, conditions, store
from benchmarks.reliability_finding import Finding
from reference.case import Case, load_case
from reference.ledger import COLUMNS
from reference.spool import SPILL_BYTES

CASE, KEPT = "polish_full", "polish_full_whole"
DURATIONS = (2e-3, 20e-3)  # s; the case itself lasts 1 s
SHARE = 0.5  # of the bytes of the rows that a longer run has more: with those in memory it would be above 1
INTERVAL = 1.0  # s between checkpoints of the shortened runs, so that there are some


def findings(full: bool = False) -> list[Finding]:
    """Memory and balances of shortened runs, and of the whole one, measured now or kept."""
    with tempfile.TemporaryDirectory(prefix="cmpcheck-") as folder:
        measured(1e-4, Path(folder) / "first", INTERVAL)  # compiles, which takes memory of its own
        runs = [measured(duration, Path(folder) / f"{duration:g}", INTERVAL) for duration in DURATIONS]
        if full:
            whole = measured(load_case(CASE).case.duration, Path(folder) / "whole", 10.0)
            store({KEPT: whole | conditions("python -m benchmarks.reliability_long_runs --full")})
    found = [_memory(runs), *(_balances(run) for run in runs)]
    kept = json.loads(RESULTS.read_text("utf-8")).get(KEPT) if RESULTS.exists() else None
    return found + ([_whole(kept), _balances(kept)] if kept else [])


def measured(duration: float, out: Path, interval: float) -> dict[str, Any]:
    """What `child` has measured of a run of that duration, in a process of its own."""
    command = [
        sys.executable,
        "-m",
        __name__ if __name__ != "__main__" else "benchmarks.reliability_long_runs",
    ]
    command += ["--child", repr(duration), str(out), repr(interval)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def shortened(duration: float) -> Case:
    """The case with another duration; its pad descends in 0.7 of that."""
    case = load_case(CASE).variants()[0]
    return case.model_copy(update={"case": case.case.model_copy(update={"duration": duration})})


def child(duration: float, out: Path, interval: float) -> dict[str, Any]:
    """Run it, and say how much memory it took when, how much was written, and how its balances close."""
    from reference.simulation import simulate

    memory: list[tuple[float, float]] = []

    def look(done: float) -> None:
        memory.append((float(done), _resident()))

    run = simulate(shortened(duration), out, look, checkpoint_interval=interval)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    files = sum(path.stat().st_size for path in out.iterdir()) / 1e6
    return {
        "duration": duration,
        "steps": run.provenance["steps"],
        "seconds": run.provenance["timing"]["wall_time"],
        "peak": peak,
        "memory": [entry for k, entry in enumerate(memory) if k % max(1, len(memory) // 20) == 0],
        "files": files,
        "contacts": float(run.history["contacts"].iloc[-1]),
        "rows": _rows(out),
        "balances": run.provenance["balances"],
        "sizes": {
            "energy": float(run.history["contact_loss"].iloc[-1]),
            "volume": float(run.history["removed_volume"].iloc[-1]),
        },
    }


def _rows(out: Path) -> int:
    import pyarrow.parquet as pq

    return int(pq.read_metadata(out / "contacts.parquet").num_rows)


def _resident() -> float:
    """Resident memory of this process now, MB."""
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[1])
    return pages * resource.getpagesize() / 2**20


def _memory(runs: list[dict[str, Any]]) -> Finding:
    peaks = [run["peak"] for run in runs]
    longer = runs[-1]["steps"] / runs[0]["steps"]
    more = max(peaks) - peaks[0]
    rows = 8.0 * len(COLUMNS) * (runs[-1]["rows"] - runs[0]["rows"]) / 1e6
    return Finding(
        name="memory of a long run",
        done=f"{CASE} over " + ", ".join(f"{run['duration']:g} s" for run in runs),
        outcome=f"{longer:.3g} times as many steps, with {rows:.0f} MB more in their ledger, took {more:.0f} "
        f"MB more memory; {SPILL_BYTES >> 20} MB of rows at the most are in memory, the others on the disk",
        holds=more <= SHARE * rows,
        numbers={
            key: value
            for run in runs
            for key, value in (
                (f"T = {run['duration']:g} s: steps", f"{run['steps']:,}"),
                (f"T = {run['duration']:g} s: peak resident memory", f"{run['peak']:.0f} MB"),
                (f"T = {run['duration']:g} s: rows of the ledger", f"{run['rows']:,}"),
                (f"T = {run['duration']:g} s: files", f"{run['files']:.0f} MB"),
                (f"T = {run['duration']:g} s: wall time", f"{run['seconds']:.0f} s"),
            )
        },
    )


def _whole(run: dict[str, Any]) -> Finding:
    """The whole second, from its first look at the memory on, before which the kernel may be compiled."""
    looked = [memory for _, memory in run["memory"]]
    more, rows = run["peak"] - looked[0], 8.0 * len(COLUMNS) * run["rows"] / 1e6
    return Finding(
        name="memory of a whole second",
        done=f"{CASE} as it ships, {run['date']}, commit {run['commit'][:10]}",
        outcome=f"{run['steps']:,} steps took {more:.0f} MB more than the start, most of it while the files "
        f"are written at the end; their ledger takes {rows:.0f} MB",
        holds=more <= SHARE * rows,
        numbers={
            "at the start": f"{looked[0]:.0f} MB",
            "half-way": f"{looked[len(looked) // 2]:.0f} MB",
            "at 95 %": f"{looked[-2]:.0f} MB",
            "peak": f"{run['peak']:.0f} MB",
            "wall time": f"{run['seconds']:.0f} s",
        },
    )


def _balances(run: dict[str, Any]) -> Finding:
    """Each balance against its bound, which is derived where it is computed (`balances.py`)."""
    parts = run["balances"]
    worst = max(parts, key=lambda name: abs(parts[name]["residual"]) / (parts[name]["bound"] or 1e-300))
    holds = all(abs(part["residual"]) <= part["bound"] for part in parts.values())
    return Finding(
        name=f"balances over {run['steps']:,} steps",
        done=f"{CASE} over {run['duration']:g} s, {run['contacts']:,.0f} contacts",
        outcome=f"every balance closes within its bound on round-off; the nearest to it is that of {worst}"
        if holds
        else f"the balance of {worst} does not close",
        holds=holds,
        numbers={
            name: f"{part['residual']:.2e} {part['unit']}, bound {part['bound']:.2e}"
            + (f", of {run['sizes'][name]:.3g}" if name in run["sizes"] else "")
            for name, part in parts.items()
        },
    )


def main() -> None:
    arguments = sys.argv[1:]
    if arguments[:1] == ["--child"]:
        print(json.dumps(child(float(arguments[1]), Path(arguments[2]), float(arguments[3]))))
        return
    for finding in findings(full="--full" in arguments):
        print(finding.line(), flush=True)


if __name__ == "__main__":
    main()
