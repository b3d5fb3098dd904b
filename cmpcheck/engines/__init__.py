"""The engines by name.  What an engine is stands in `protocol.py`.

Engines of other packages are found by their entry points in the group `cmpcheck.engines`: a name, and what
makes the engine when it is called without arguments.
"""

from __future__ import annotations

from importlib.metadata import EntryPoints, entry_points
from pathlib import Path

from cmpcheck.engines.protocol import Engine, Resolution
from cmpcheck.engines.reference import ReferenceEngine
from cmpcheck.results import EngineInfo
from reference.recording import Run
from reference.state import Setup

ENGINES = ("reference", "lammps", "liggghts")  # that ship
GROUP = "cmpcheck.engines"


class BrokenPlugin:
    """Stands for an engine of another package that cannot be made, and says why."""

    surface_forms: tuple[str, ...] = ("native",)

    def __init__(self, name: str, problem: str) -> None:
        self.name, self.problem = name, " ".join(problem.split())

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
    found = sorted({point.value for point in _plugins() if point.name == name})
    if len(found) > 1:
        return BrokenPlugin(name, f"several packages bring an engine {name}: {', '.join(found)}")
    try:
        engine: Engine = next(iter(_plugins().select(name=name))).load()()
        info = engine.info()
        if not isinstance(info, EngineInfo) or engine.name != name or not callable(engine.run):
            raise TypeError(f"it is no engine named {name}: see cmpcheck.engines.protocol")
    except Exception as problem:  # somebody else's code
        return BrokenPlugin(name, f"{found[0]}: {type(problem).__name__}: {problem}")
    return engine
