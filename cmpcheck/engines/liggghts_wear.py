"""Wear of single impacts in LIGGGHTS: its `fix mesh/surface/stress ... wear finnie`, by triangle.

Runs the deck `liggghts/in.finnie_wear` down to its line `if "${driver}` in a child process, and reads the
dump that LIGGGHTS writes, the only way to its wear.  What it should be is `reference/exact/wear.py`.
"""

from __future__ import annotations

import shutil
from itertools import takewhile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cmpcheck.engines.child import Child, ChildError
from cmpcheck.engines.lammps_library import EngineError
from cmpcheck.engines.lammps_setup import Deck, deck_path, input_flags, last_words
from cmpcheck.engines.liggghts import NOISE
from cmpcheck.engines.liggghts_library import opened
from cmpcheck.fixes.layout import MICRO

DECK = "finnie_wear"
DUMP = "wear.vtk"
TIMEOUT = 60.0  # s for one impact, which takes a tenth of one
PRINTED = 0.5e-10  # largest relative rounding of a number in the dump, which has 11 digits


class Impact(NamedTuple):
    """A sphere that strikes a wall without friction, and how finely its contact is resolved."""

    speed: float  # m/s
    angle: float  # degrees, from the wall
    coefficient: float  # k_finnie, 1/Pa
    steps_per_contact: int = 200
    restitution: float = 0.5
    contact_duration: float = 1e-9  # s
    diameter: float = 0.9e-6  # m
    density: float = 3950.0  # kg/m3

    @property
    def mass(self) -> float:
        """Mass of the sphere, kg."""
        return self.density * np.pi * self.diameter**3 / 6


class FinnieDeck:
    """The deck in a child process of its own, which `close` ends.

    Parameters: path, the deck; mesh, the wall as STL in um; both those that ship by default.
    Raises EngineError where there is no such deck.
    """

    def __init__(self, path: Path | None = None, mesh: Path | None = None) -> None:
        self.path = path or deck_path(DECK, "liggghts")
        self.mesh = mesh or deck_path(DECK, "liggghts").parent / "triangle.stl"
        self.definitions = Deck.read(self.path).definitions()
        self.child = Child()

    def removed(self, impact: Impact) -> np.ndarray:
        """Volumes (triangles,) in m3 that LIGGGHTS wears off by one impact, its depths times the areas.

        Raises EngineError, with LIGGGHTS's own words, when it fails.
        """
        shutil.copy(self.mesh, self.child.folder / "wall.stl")
        values = {
            "surface_mesh": "wall.stl", "wear_dump": DUMP, "speed": impact.speed, "angle": impact.angle,
            "coefficient": impact.coefficient, "restitution": impact.restitution,
            "steps_per_contact": impact.steps_per_contact, "density": impact.density,
            "contact_duration": impact.contact_duration / MICRO, "diameter": impact.diameter / MICRO,
        }  # fmt: skip
        try:
            depths: np.ndarray = self.child.call(worn_depths, self.definitions, values, timeout=TIMEOUT)
        except ChildError as error:
            said = last_words(self.child.output, NOISE)
            raise EngineError(f"{self.path.name}: LIGGGHTS: {error}{said}") from None
        return depths * MICRO**3

    def close(self) -> None:
        """End the child process."""
        self.child.stop()


def worn_depths(definitions: str, values: dict[str, float | str]) -> np.ndarray:
    """Run the deck in this process, whose working directory gets files: wear times area (triangles,), um3."""
    Path(DUMP).unlink(missing_ok=True)
    with opened(definitions, input_flags(values)):
        pass  # the deck runs by itself and writes its dump
    words = Path(DUMP).read_text("utf-8").split()
    corners = _numbers(words, "POINTS", "float").reshape(-1, 3, 3)  # each triangle has its own three
    along, across = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    depths = _numbers(words, "wear", "double")
    return depths * 0.5 * np.linalg.norm(np.cross(along, across), axis=1)


def _numbers(words: list[str], name: str, kind: str) -> np.ndarray:
    """The numbers of an array of a VTK file, up to the next word that is none."""
    begin = words.index(kind, words.index(name)) + 1
    return np.array(list(takewhile(_is_number, words[begin:])), dtype=float)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
