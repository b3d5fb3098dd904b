"""What of the engines and their tools is on this machine, and how to install the rest."""

from __future__ import annotations

import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

from cmpcheck import __version__, provenance
from cmpcheck.engines import lammps_library, liggghts_library


@dataclass(frozen=True)
class Finding:
    """One thing that was looked for."""

    name: str
    what_for: str
    version: str  # "" when it is missing
    problem: str = ""
    remedy: str = ""  # the command that installs it

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
    ]


def _reference() -> Finding:
    versions = ", ".join(f"{name} {provenance.version(name)}" for name in ("numba", "numpy"))
    return Finding("reference", "the engine that others are compared with", f"{__version__} ({versions})")


def _lammps() -> Finding:
    what_for = "the engine lammps"
    available, reason = lammps_library.available()
    if not available:
        return Finding("lammps", what_for, "", reason, _pip(lammps_library.INSTALL))
    wheel = provenance.version("lammps")
    return Finding("lammps", what_for, lammps_library.version() + (f" (lammps {wheel})" if wheel else ""))


def _liggghts() -> Finding:
    what_for = "the engine liggghts, which is optional"
    available, reason = liggghts_library.available()
    if not available:
        return Finding("liggghts", what_for, "", reason, liggghts_library.INSTALL)
    return Finding("liggghts", what_for, liggghts_library.version())


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
