"""The engines by name.  What an engine is stands in `protocol.py`."""

from __future__ import annotations

from pathlib import Path

from cmpcheck.engines.protocol import Engine
from cmpcheck.engines.reference import ReferenceEngine

ENGINES = ("reference", "lammps", "liggghts")


def make_engine(name: str, decks: dict[str, Path] | None = None) -> Engine:
    """The engine of that name; `decks` replaces the LAMMPS decks that ship, by case.

    Raises ValueError for a name that is not in ENGINES.
    """
    if name == "reference":
        return ReferenceEngine()
    if name == "lammps":
        from cmpcheck.engines.lammps import LammpsEngine

        return LammpsEngine(decks or {})
    if name == "liggghts":
        from cmpcheck.engines.liggghts import LiggghtsEngine

        return LiggghtsEngine()
    raise ValueError(f"unknown engine {name!r}; allowed: {', '.join(ENGINES)}")
