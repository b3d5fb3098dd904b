"""The engines by name.  What an engine is stands in `protocol.py`.

Engines of other packages are found by their entry points in the group `cmpcheck.engines`: a name, and what
makes the engine when it is called without arguments.  An engine is imported when it is made: a child process
that only looks for LAMMPS needs none.
"""

from __future__ import annotations

from importlib.metadata import EntryPoints, entry_points
from pathlib import Path
from typing import TYPE_CHECKING

from cmpcheck.engines.protocol import Engine, Resolution
from cmpcheck.results import EngineInfo

if TYPE_CHECKING:
    from reference.recording import Run
    from reference.state import Setup

ENGINES = ("reference", "lammps", "liggghts")  # that ship
GROUP = "cmpcheck.engines"


class Ambiguous:
    """Stands for the engines of several packages under one name, and says so."""

    surface_forms: tuple[str, ...] = ("native",)

    def __init__(self, name: str, problem: str) -> None:
        self.name, self.problem = name, problem

    def info(self) -> EngineInfo:
        """It is not available."""
        return EngineInfo(self.name, "", False, self.problem)

    def run(self, setup: Setup, resolution: Resolution) -> Run:
        """Raises RuntimeError."""
        raise RuntimeError(self.problem)


def engine_names() -> tuple[str, ...]:
    """The engines that ship, then those of other packages."""
    return (*ENGINES, *sorted({point.name for point in _plugins()} - set(ENGINES)))


def is_plugin(name: str) -> bool:
    """Whether another package brings the engine."""
    return name not in ENGINES and any(point.name == name for point in _plugins())


def _plugins() -> EntryPoints:
    return entry_points(group=GROUP)


def make_engine(name: str, decks: dict[str, Path] | None = None) -> Engine:
    """The engine of that name; `decks` replaces the LAMMPS decks that ship, by case.

    Raises ValueError for a name that is not in `engine_names()`.  A plugin that cannot be made is an engine
    that is not available.
    """
    if name == "reference":
        from cmpcheck.engines.reference import ReferenceEngine

        return ReferenceEngine()
    if name == "lammps":
        from cmpcheck.engines.lammps import LammpsEngine

        return LammpsEngine(decks or {})
    if name == "liggghts":
        from cmpcheck.engines.liggghts import LiggghtsEngine

        return LiggghtsEngine()
    if is_plugin(name):
        return _make_plugin(name)
    raise ValueError(f"unknown engine {name!r}; allowed: {', '.join(engine_names())}")


def _make_plugin(name: str) -> Engine:
    from cmpcheck.engines.plugin import PluginEngine

    found = {point.value: point for point in _plugins() if point.name == name}
    if len(found) > 1:
        return Ambiguous(name, f"several packages bring an engine {name}: {', '.join(sorted(found))}")
    return PluginEngine(*found.values())
