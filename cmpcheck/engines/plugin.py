"""Engines of other packages: each is imported, asked and run in a child process of its own.

In a child, so that one that crashes, ends its process or does not end is an error of that run alone.  How
they are found is `__init__.py`; what they have to be is `protocol.py`.
"""

from __future__ import annotations

import re
from importlib.metadata import EntryPoint

from cmpcheck.engines.child import ChildError, ChildLost, shared_child
from cmpcheck.engines.lammps_library import EngineError
from cmpcheck.engines.lammps_setup import last_words
from cmpcheck.engines.protocol import NotSupported, Resolution, timeout_of
from cmpcheck.results import EngineInfo
from reference.recording import Run
from reference.state import Setup

ANSWERS_WITHIN = 60.0  # s, until it has said whether it is there
NO_NOISE = re.compile(r"(?!)")


class PluginEngine:
    """The engine that an entry point makes, or one that is not available and says why."""

    def __init__(self, point: EntryPoint) -> None:
        self.name, self._value = point.name, point.value
        self._child = shared_child(f"plugin {point.name}")
        try:
            self._info, self.surface_forms = self._child.call(
                describe, self.name, self._value, timeout=ANSWERS_WITHIN
            )
        except ChildError as problem:
            reason = f"{self._value}: {problem}{last_words(self._child.output, NO_NOISE)}"
            self._info = EngineInfo(self.name, "", False, " ".join(reason.split()))
            self.surface_forms = ("native",)

    def info(self) -> EngineInfo:
        """What it said when it was made."""
        return self._info

    def run(self, setup: Setup, resolution: Resolution) -> Run:
        """Simulate a setup.

        Raises NotSupported where the engine does, and EngineError when it fails, dies or takes longer than
        `[engine.NAME] timeout`, with the last that it has printed.
        """
        limit = timeout_of(setup.case, self.name)
        try:
            found = self._child.call(simulate, self.name, self._value, setup, resolution, timeout=limit)
        except ChildLost as problem:
            said = last_words(self._child.output, NO_NOISE)
            raise EngineError(f"{self.name}: {problem}{said}") from None
        except ChildError as problem:
            raise EngineError(" ".join(str(problem).split())) from None
        if isinstance(found, str):
            raise NotSupported(found)
        run: Run = found
        return run


def describe(name: str, value: str) -> tuple[EngineInfo, tuple[str, ...]]:
    """Runs in the child: what the engine says of itself, and its forms of contact with a surface.

    Raises RuntimeError, with the type of what the other package raises, for what is no engine of that name.
    """
    try:
        engine = EntryPoint(name, value, "").load()()
        info = engine.info()
        if not isinstance(info, EngineInfo) or engine.name != name or not callable(engine.run):
            raise TypeError(f"it is no engine named {name}: see cmpcheck.engines.protocol")
        return info, tuple(getattr(engine, "surface_forms", ("native",)))
    except Exception as problem:  # somebody else's code
        raise RuntimeError(f"{type(problem).__name__}: {problem}") from None


def simulate(name: str, value: str, setup: Setup, resolution: Resolution) -> Run | str:
    """Runs in the child: the run, or why the engine was not made for the setup."""
    engine = EntryPoint(name, value, "").load()()
    try:
        run = engine.run(setup, resolution)
    except NotSupported as refusal:
        return str(refusal)
    except RuntimeError:
        raise  # a line that it has written
    except Exception as problem:  # somebody else's code
        raise RuntimeError(f"{type(problem).__name__}: {problem}") from None
    if not isinstance(run, Run):
        raise TypeError(f"{name}: run has returned {type(run).__name__}; allowed: reference.recording.Run")
    return run
