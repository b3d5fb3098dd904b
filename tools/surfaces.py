"""Write the surfaces that the LIGGGHTS decks read, lammps_inputs/liggghts/*.stl, from the case files.

Needed after a change to the surface of one of these cases; a test tells.
"""

from __future__ import annotations

from pathlib import Path

from cmpcheck.engines.lammps_setup import deck_folder
from cmpcheck.engines.liggghts_setup import write_surface
from reference.case import load_case
from reference.heightfield import Heightfield
from reference.process import build_setup

CASES = {"flat.stl": "wall_bounce", "asperity.stl": "asperity_bounce"}  # whose surface each file is


def write(folder: Path) -> list[Path]:
    """Write every file into a folder, as the engine writes them; return their paths."""
    paths = []
    for name, case in CASES.items():
        setup = build_setup(load_case(case).variants()[0])
        paths.append(folder / name)
        write_surface(Heightfield(setup.state.heights, setup.model.spacing), paths[-1])
    return paths


if __name__ == "__main__":
    for path in write(deck_folder() / "liggghts"):
        print(path)
