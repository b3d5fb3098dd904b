"""Killed by SIGKILL at random moments: `run`, `compare` and `optimise` go on to the same arrays.

`python -m benchmarks.reliability_kill [--full]` prints the findings.  A command is started, killed after a
random time, resumed, killed again, until it completes; then the next one is started, until it has been killed
often enough.  After every kill all files that are there under their final names must be whole.
"""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd

from benchmarks.reliability_digests import digests_of, json_digest, table_digests
from benchmarks.reliability_finding import Finding
from cmpcheck.optimise.store import FILE
from cmpcheck.outputs import STAGING, count_finished
from reference.case import load_case
from reference.checkpoint import FOLDER as CHECKPOINTS
from reference.checkpoint import INDEX, is_complete

KILLS = (3, 50)  # of each command, quick and full
SEED = 9
INTERVAL = 0.3  # s between checkpoints of the runs that are killed
COMPARED = ("wall_bounce", "--engine", "lammps")  # two variants, each of them a task


class Subject(ABC):
    """A command that is killed."""

    name: str
    unit: str  # of what it may lose

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @abstractmethod
    def command(self, out: Path, resume: bool) -> list[str]:
        """What is started."""

    @abstractmethod
    def begun(self, out: Path) -> bool:
        """Whether there is something to resume."""

    @abstractmethod
    def complete(self, out: Path) -> bool:
        """Whether there is nothing left to do."""

    @abstractmethod
    def digests(self, out: Path) -> dict[str, str]:
        """SHA-256 of all that came out, but for wall-clock times."""

    def has_kept(self, out: Path) -> bool:
        """Whether something that was computed is there."""
        raise NotImplementedError

    def lost(self, out: Path, killed: float) -> float:
        """How much is lost by the kill at that time, in the subject's unit."""
        return 0.0

    def may_lose(self) -> float:
        """The bound of that."""
        return 0.0


class Run(Subject):
    """`cmpcheck run` of polish_full, 2 ms of it, with checkpoints at short intervals."""

    name, unit = "run", "s of computing up to the last steps told"

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        case = load_case("polish_full")
        header = case.case.model_copy(update={"duration": 2e-3})
        case.model_copy(update={"case": header}).save(folder / "short.toml")
        self.gaps: list[float] = []

    def command(self, out: Path, resume: bool) -> list[str]:
        log = str(self.folder / f"{out.name}.progress")
        words = [sys.executable, "-m", "benchmarks.reliability_kill", "--child", log]
        return [*words, "run", str(self.folder / "short.toml"), "--out", str(out), *["--resume"] * resume]

    def begun(self, out: Path) -> bool:
        return out.exists()

    def complete(self, out: Path) -> bool:
        return is_complete(out) and not (out / CHECKPOINTS).exists()

    def digests(self, out: Path) -> dict[str, str]:
        return digests_of(out)

    def has_kept(self, out: Path) -> bool:
        return (out / "checkpoint" / "part-00000.h5").exists()

    def lost(self, out: Path, killed: float) -> float:
        log = self.folder / f"{out.name}.progress"
        moments = np.fromfile(log).tolist() if log.exists() else []
        self.gaps += [b - a for a, b in pairwise(moments)]
        index = out / "checkpoint" / INDEX
        if not moments or not index.exists():  # not yet computing, or done with it
            return 0.0
        computed = min(killed, moments[-1])  # what follows the last steps is the writing of what is saved
        return max(0.0, computed - max(index.stat().st_mtime, moments[0]))

    def may_lose(self) -> float:
        return INTERVAL + max(self.gaps, default=0.0)


class Compare(Subject):
    """`cmpcheck compare` of two variants in the reference and LAMMPS."""

    name, unit = "compare", "finished comparisons"

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.kept: dict[Path, int] = {}  # at the last kill, by folder

    def command(self, out: Path, resume: bool) -> list[str]:
        words = [sys.executable, "-m", "cmpcheck", "compare", *COMPARED, "--jobs", "1", "--out", str(out)]
        return [*words, *["--resume"] * resume]

    def begun(self, out: Path) -> bool:
        return out.exists()

    def complete(self, out: Path) -> bool:
        return (out / "report.json").exists() and not (out / STAGING).exists()

    def digests(self, out: Path) -> dict[str, str]:
        report = json.loads((out / "report.json").read_text("utf-8"))
        return {"report.json": json_digest(report)} | digests_of(out / "data")

    def has_kept(self, out: Path) -> bool:
        return count_finished(out / STAGING) > 0

    def lost(self, out: Path, killed: float) -> float:
        before = self.kept.get(out, 0)
        self.kept[out] = count_finished(out / STAGING)
        return float(max(0, before - self.kept[out])) if (out / STAGING).exists() else 0.0


class Optimise(Subject):
    """`cmpcheck optimise` of a search of two generations of four strings."""

    name, unit = "optimise", "finished samples"

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        case = load_case("polish_design")
        assert case.optimise is not None
        small = {"population": 4, "parents": 2, "generations": 2, "minimum_samples": 2, "maximum_samples": 3}
        part = case.optimise.model_copy(update={**small, "distribution_samples": 3})
        header = case.case.model_copy(update={"duration": 10e-6})
        case.model_copy(update={"case": header, "optimise": part}).save(folder / "search.toml")
        self.kept: dict[Path, int] = {}  # at the last kill, by folder

    def command(self, out: Path, resume: bool) -> list[str]:
        words = [
            sys.executable,
            "-m",
            "cmpcheck",
            "optimise",
            str(self.folder / "search.toml"),
            "--jobs",
            "1",
        ]
        return [*words, "--out", str(out), *["--resume"] * resume]

    def begun(self, out: Path) -> bool:
        return out.exists() and any(out.iterdir())

    def complete(self, out: Path) -> bool:
        return False  # a run that has ended says so by its exit code

    def digests(self, out: Path) -> dict[str, str]:
        with sqlite3.connect(out / FILE) as sql:
            samples = pd.read_sql("SELECT * FROM samples ORDER BY string, k", sql).drop(columns="seconds")
            asked = pd.read_sql("SELECT * FROM asked ORDER BY run, place", sql)
        tables = table_digests("samples", samples) | table_digests("asked", asked)
        for name in ("table.csv", "strings.csv"):
            tables |= table_digests(name, pd.read_csv(out / name).drop(columns="seconds", errors="ignore"))
        return tables

    def has_kept(self, out: Path) -> bool:
        return _samples(out / FILE) > 0

    def lost(self, out: Path, killed: float) -> float:
        before = self.kept.get(out, 0)
        self.kept[out] = _samples(out / FILE)
        return float(max(0, before - self.kept[out]))


def _samples(file: Path) -> int:
    if not file.exists():
        return 0
    with tempfile.TemporaryDirectory() as folder:  # a reader would end the log of the killed writer
        for path in file.parent.glob(f"{FILE}*"):
            shutil.copy(path, folder)
        with sqlite3.connect(Path(folder) / FILE) as sql:
            if not sql.execute("SELECT count(*) FROM sqlite_master WHERE name = 'samples'").fetchone()[0]:
                return 0
            return int(sql.execute("SELECT count(*) FROM samples").fetchone()[0])


@dataclass
class Tally:
    """What came of the kills of one subject."""

    kills: int = 0
    resumed: int = 0
    completed: int = 0
    different: int = 0
    damaged: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    lost: float = 0.0


SUBJECTS: tuple[type[Subject], ...] = (Run, Compare, Optimise)


def findings(full: bool = False) -> Iterator[Finding]:
    """One finding for each command."""
    for seed, subject in enumerate(SUBJECTS, SEED):
        yield kill(subject, KILLS[full], seed)


def kill(kind: type[Subject], kills: int, seed: int) -> Finding:
    """Kill one command so often, and see what becomes of it."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory(prefix="cmpcheck-") as place:
        folder = Path(place)
        subject = kind(folder)
        _whole(subject, folder / "first")  # compiles what is not compiled yet
        seconds = _whole(subject, folder / "whole")
        expected = subject.digests(folder / "whole")
        tally, chain = Tally(), 0
        while tally.kills < kills:
            chain += 1
            out = folder / f"killed-{chain}"
            _chain(subject, out, rng, seconds, kills, tally)
            if not tally.failed and subject.digests(out) != expected:
                tally.different += 1
            shutil.rmtree(out, ignore_errors=True)
            if tally.failed:
                break
        return _finding(subject, tally, seconds, len(expected))


def _whole(subject: Subject, out: Path) -> float:
    """Let the command end, and return how long it took, s."""
    begin = time.monotonic()
    done = subprocess.run(subject.command(out, False), capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(f"{subject.name}: exit code {done.returncode}: {done.stderr.strip()}")
    return time.monotonic() - begin


def _chain(
    subject: Subject, out: Path, rng: np.random.Generator, seconds: float, kills: int, tally: Tally
) -> None:
    """Start, kill and resume until it completes; beyond the last kill it is left alone."""
    resume = False
    while True:
        command = subject.command(out, resume)
        tally.resumed += resume
        with tempfile.TemporaryFile() as said:
            process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=said)
            try:
                limit = rng.uniform(0.0, seconds) if tally.kills < kills else None
                code = process.wait(limit)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                killed = time.time()
                code = None
            said.seek(0)
            words = said.read().decode("utf-8", "replace").strip()
        if code is None:
            tally.kills += 1
            tally.lost = max(tally.lost, subject.lost(out, killed))
            tally.damaged += damaged_files(out)
            resume = subject.begun(out)
            if not (resume and subject.complete(out)):
                continue
            code = 0  # it was killed when it had just ended
        if code != 0:
            tally.failed.append(f"exit code {code}: {words[-300:]}")
        tally.completed += code == 0
        return


def damaged_files(folder: Path) -> list[str]:
    """Files under their final names that cannot be read as what they are."""
    found = []
    for path in sorted(p for p in folder.rglob("*") if p.is_file() and not p.name.startswith(".")):
        try:
            if path.suffix == ".json":
                json.loads(path.read_text("utf-8"))
            elif path.suffix == ".h5":
                with h5py.File(path) as file:
                    file.visititems(lambda _, item: item[()] if isinstance(item, h5py.Dataset) else None)
            elif path.suffix == ".parquet":
                pd.read_parquet(path)
        except FileNotFoundError:  # the worker that was left has not ended yet, and has renamed it
            continue
        except Exception as problem:  # whatever the library raises
            found.append(f"{path.name}: {problem}")
    return found


def _finding(subject: Subject, tally: Tally, seconds: float, digests: int) -> Finding:
    bound = subject.may_lose()
    holds = not (tally.failed or tally.damaged or tally.different) and tally.lost <= bound
    outcome = (
        f"{tally.completed} of {tally.completed + len(tally.failed)} completed, resumed {tally.resumed} "
        f"times; {tally.different} of them differ from the uninterrupted one in any of {digests} digests; "
        f"{len(tally.damaged)} damaged files"
    )
    outcome += "".join(f"; {text}" for text in (tally.failed + tally.damaged)[:3])
    return Finding(
        f"{subject.name}, killed",
        f"{subject.__doc__} Killed {tally.kills} times within the {seconds:.1f} s that it takes.",
        outcome,
        holds,
        {
            "kills": float(tally.kills),
            f"most lost, {subject.unit}": tally.lost,
            f"allowed to be lost, {subject.unit}": bound,
        },
    )


def child(log: str, arguments: Sequence[str]) -> None:
    """The command line with a short interval between checkpoints, which writes down when it computes."""
    from functools import partial

    import cmpcheck.cli
    from cmpcheck import single

    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    plain = single.simulate

    def simulate(case: Any, folder: Path, progress: Any, resume: bool) -> Any:
        def noted(fraction: float) -> None:
            os.write(descriptor, np.float64(time.time()).tobytes())
            progress(fraction)

        return partial(plain, checkpoint_interval=INTERVAL)(case, folder, noted, resume)

    single.simulate = simulate
    sys.argv[1:] = arguments
    cmpcheck.cli.main()


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        child(sys.argv[2], sys.argv[3:])
    else:
        for found in findings("--full" in sys.argv):
            print(found.line(), flush=True)
