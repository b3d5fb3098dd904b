"""A disk that is full, a folder that is gone, a path that cannot be written: what the commands say and keep.

`python -m benchmarks.reliability_disk [--full]` prints the findings.  A full disk is a limit on the size of
files, and a small file system in memory where mounting is allowed; a lost permission is that file system
becoming read-only, because permissions do not bind root.
"""

from __future__ import annotations

import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmarks.reliability_finding import Finding
from benchmarks.reliability_kill import Compare, Optimise, Run, Subject, damaged_files

LIMITS = {  # bytes that a file may have
    "run": (512, 20_000, 300_000, 2_000_000),
    "compare": (200, 6_000, 60_000),
    "optimise": (512, 20_000, 200_000),
}
ROOM = 3  # MB of the small file system
BEGINS_WITHIN = 120.0  # s


class Reference(Compare):
    """A comparison without LAMMPS, which is missing where its MPI has no room for its shared memory."""

    def command(self, out: Path, resume: bool) -> list[str]:
        """As that of all engines."""
        words = super().command(out, resume)
        return ["reference" if word == "lammps" else word for word in words]


def findings(full: bool = False) -> Iterator[Finding]:
    """Each fault in each command, a full disk also in a comparison with LAMMPS; without `full`, in `run`."""
    for kind in (Run, Reference, Compare, Optimise) if full else (Run,):
        with tempfile.TemporaryDirectory(prefix="cmpcheck-") as place:
            subject = kind(Path(place))
            done = subprocess.run(subject.command(subject.folder / "whole", False), capture_output=True)
            if done.returncode:
                raise RuntimeError(done.stderr.decode())
            expected = subject.digests(subject.folder / "whole")
            yield _limited(subject, expected, LIMITS[subject.name] if full else LIMITS["run"][1:3])
            for name, damage in DAMAGES.items() if kind is not Compare else ():
                yield _damaged(subject, expected, name, damage)
            if kind is Run:
                yield from _small_disk(subject, expected)


def _limited(subject: Subject, expected: dict[str, str], limits: tuple[int, ...]) -> Finding:
    """Files that may not grow beyond a size; then the same command without the limit."""
    wrong: list[str] = []
    stopped = 0
    for limit in limits:
        out = subject.folder / f"limit-{limit}"
        done = subprocess.run(
            subject.command(out, False), capture_output=True, text=True,
            preexec_fn=lambda limit=limit: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
        )  # fmt: skip
        stopped += done.returncode != 0
        wrong += [
            f"limit {limit}: {text}" for text in _complaint(done.returncode, done.stderr, _may_end(subject))
        ]
        wrong += damaged_files(out)
        wrong += _goes_on(subject, out, expected)
        shutil.rmtree(out, ignore_errors=True)
    return _finding(
        f"{_title(subject)}, disk full",
        f"Files limited to {', '.join(map(str, limits))} bytes, then resumed.",
        wrong, {"limits": float(len(limits)), "stopped by them": float(stopped)},
    )  # fmt: skip


def _title(subject: Subject) -> str:
    return f"{subject.name} with LAMMPS" if type(subject) is Compare else subject.name


def _may_end(subject: Subject) -> bool:
    """Whether the command may end by itself: a worker that meets a full disk makes rows with that error."""
    return subject.name == "compare"


def _complaint(code: int, stderr: str, may_end: bool = False) -> list[str]:
    """What is wrong with how a command ended."""
    lines = stderr.strip().splitlines()
    if "Traceback" in stderr:
        return [f"a traceback, exit code {code}: {lines[-1][:200]}"]
    if may_end and not lines and code in (0, 1):
        return []
    told = [line for line in lines if line.startswith("cmpcheck: ") and not line.endswith(" samples")]
    if code not in (1, 2) or len(told) != 1:
        return [f"exit code {code}, {len(told)} lines: {' | '.join(lines)[:200]}"]
    return []


def _goes_on(subject: Subject, out: Path, expected: dict[str, str]) -> list[str]:
    """What is wrong with the command when it is resumed and nothing is in its way.

    A report whose rows are errors is whole: there is nothing to resume, and it is made anew.
    """
    resume = subject.begun(out) and not (_may_end(subject) and subject.complete(out))
    done = subprocess.run(subject.command(out, resume), capture_output=True, text=True)
    if done.returncode not in (0, 2) or (done.returncode == 2 and not subject.complete(out)):
        return [f"not resumed, exit code {done.returncode}: {done.stderr.strip()[-200:]}"]
    found = subject.digests(out)
    return [f"{name} differs after the resumption" for name in expected if found.get(name) != expected[name]][
        :2
    ]


def _remove(out: Path) -> None:
    shutil.rmtree(out)


def _replace(out: Path) -> None:
    out.rename(out.with_suffix(".moved"))
    out.write_text("a file\n", "utf-8")


Damage = Callable[[Path], None]
DAMAGES: dict[str, Damage] = {
    "folder removed": _remove,
    "folder replaced by a file": _replace,
}


def _damaged(subject: Subject, expected: dict[str, str], name: str, damage: Damage) -> Finding:
    """The output folder goes away in mid-run; then the command is given again."""
    out = subject.folder / "damaged"
    code, said = _in_mid_run(subject, out, damage)
    wrong = _complaint(code, said)
    out.unlink(missing_ok=True) if out.is_file() else shutil.rmtree(out, ignore_errors=True)
    wrong += _goes_on(subject, out, expected)
    shutil.rmtree(out, ignore_errors=True)
    shutil.rmtree(out.with_suffix(".moved"), ignore_errors=True)
    return _finding(
        f"{_title(subject)}, {name}",
        "In mid-run, when something had been kept.",
        wrong,
        {"exit code": str(code)},
    )


def _in_mid_run(subject: Subject, out: Path, damage: Damage) -> tuple[int, str]:
    """Exit code and standard error of a command whose folder is damaged once something is kept in it."""
    with tempfile.TemporaryFile("w+") as said:
        process = subprocess.Popen(subject.command(out, False), stdout=subprocess.DEVNULL, stderr=said)
        end = time.monotonic() + BEGINS_WITHIN
        while process.poll() is None and time.monotonic() < end and not subject.has_kept(out):
            time.sleep(0.02)
        for _ in range(100):
            try:
                damage(out)
                break
            except OSError:  # a file came while the folder went
                time.sleep(0.01)
        code = process.wait()
        said.seek(0)
        return code, said.read()


def _small_disk(subject: Subject, expected: dict[str, str]) -> list[Finding]:
    """On a file system of a few megabytes, and on one that becomes read-only in mid-run."""
    small, large = subject.folder / "small", subject.folder / "large"
    found = []
    with _mounted(small, ROOM) as mounted:
        if not mounted:
            return [Finding("run, small file system", "Mounting is not allowed here.", "not tried", True)]
        done = subprocess.run(subject.command(small / "out", False), capture_output=True, text=True)
        wrong = _complaint(done.returncode, done.stderr) + damaged_files(small / "out")
        shutil.copytree(small / "out", subject.folder / "saved")
        wrong += _goes_on(subject, subject.folder / "saved", expected)
        what = f"A file system of {ROOM} MB; resumed from a copy on a larger one."
        found.append(_finding("run, small file system", what, wrong, {"exit code": str(done.returncode)}))
    with _mounted(large, 200):

        def lock(out: Path) -> None:
            remounted = subprocess.run(["mount", "-o", "remount,ro", str(large)], capture_output=True)
            if remounted.returncode:
                raise OSError("a file is open")

        code, said = _in_mid_run(subject, large / "out", lock)
        wrong = _complaint(code, said) + damaged_files(large / "out")
        subprocess.run(["mount", "-o", "remount,rw", str(large)], check=True, capture_output=True)
        wrong += _goes_on(subject, large / "out", expected)
        found.append(
            _finding(
                "run, read-only",
                "The file system became read-only in mid-run.",
                wrong,
                {"exit code": str(code)},
            )
        )
    return found


@contextmanager
def _mounted(folder: Path, megabytes: int) -> Iterator[bool]:
    """A file system in memory at a folder, which is made; whether that is allowed."""
    folder.mkdir()
    options = ["-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs", str(folder)]
    try:
        allowed = subprocess.run(["mount", *options], capture_output=True).returncode == 0
    except OSError:
        allowed = False
    try:
        yield allowed
    finally:
        if allowed:
            subprocess.run(["umount", "-l", str(folder)], check=True, capture_output=True)


def _finding(name: str, done: str, wrong: list[str], numbers: dict[str, float | str]) -> Finding:
    outcome = "; ".join(wrong[:3]) or "one line; what was there is whole; then the same arrays"
    return Finding(name, done, outcome, not wrong, numbers)


if __name__ == "__main__":
    for found in findings("--full" in sys.argv):
        print(found.line(), flush=True)
