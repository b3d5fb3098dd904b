"""From a setup to LIGGGHTS: variables of its decks, the wall as STL, the atoms.

Decks say `units si` and mean um, us and kg/m3, because LIGGGHTS takes meshes of micrometres in metres for
mistakes: speeds are in m/s, stresses in Pa, masses in 1e-18 kg and forces in pN.  No simulation here
(`liggghts_run.py`).
"""

from __future__ import annotations

import re
from pathlib import Path

import meshio
import numpy as np

from cmpcheck.engines.lammps_setup import Deck, DeckUnits, variables
from cmpcheck.engines.liggghts_library import Liggghts
from cmpcheck.engines.protocol import Resolution
from cmpcheck.fixes.layout import MICRO
from cmpcheck.surfaces import surface_mesh
from reference.heightfield import Heightfield
from reference.state import Setup, State

MASS = 1e-18  # kg in the unit of mass of a deck
FORCE = 1e-12  # N in the unit of force
UNITS = DeckUnits(MASS, 1.0, MICRO)
OBSERVED = np.array([MICRO, 1.0, FORCE, MASS])  # as `fixes/native.py` takes them
ROOM = 0.5e-6  # m, below surface and above pad: meshes must lie within the box

PAD_SQUARES = 8  # along x

MESH_LINE = re.compile(
    r"^[ \t]*fix[ \t]+(\S+)[ \t]+\S+[ \t]+mesh/surface\S*[ \t].*\$\{surface_mesh\}.*$", re.M
)
PAD_LINE = re.compile(r"^[ \t]*fix[ \t]+(\S+)[ \t]+\S+[ \t]+mesh/surface\S*[ \t].*\$\{pad_mesh\}.*$", re.M)
CONTINUED = r"(?:.*&[ \t]*\n)*.*"  # the rest of a line, with what & continues
WALL_LINE = r"^[ \t]*fix[ \t]+(\S+)[ \t]+\S+[ \t]+wall/gran[ \t]{rest}[ \t]meshes[ \t]+{mesh}\b{rest}$"
STORED = re.compile(r"[ \t]store_force[ \t]+yes\b")


def deck_variables(
    setup: Setup, resolution: Resolution, time_step: float, mesh: Path
) -> dict[str, float | str]:
    """Values of the index variables that the decks read, in their units; `mesh` is the STL of the surface.

    Raises EngineError where the contact law cannot express the setup.
    """
    found = variables(setup, resolution, time_step, UNITS)
    if setup.model.has_surface:
        found["z_low"] = float(setup.state.heights.min() - ROOM) / MICRO
    if setup.model.has_pad:
        found["z_high"] = float(setup.state.pad_height + ROOM) / MICRO
    found["particle_radius"] = float(setup.state.diameter.mean()) / 2 / MICRO
    found["particle_mass"] = float(setup.state.mass.mean()) / MASS
    found["pad_mesh"] = str(mesh.with_name("pad.stl"))
    found["surface_mesh"] = str(mesh)
    return found


def write_surface(surface: Heightfield, path: Path) -> None:
    """Write one period of the surface as STL in um; as text, which LIGGGHTS reads in full precision."""
    points, triangles = surface_mesh(surface)
    meshio.write(path, meshio.Mesh(points / MICRO, [("triangle", triangles)]), "stl", binary=False)


def wall_lines(deck: Deck) -> tuple[str, str, str, str]:
    """The deck's lines that define mesh and wall, and the IDs of both; "" for each without a mesh wall.

    Raises ValueError when the deck has a mesh but no wall of it, or does not store the wall's force.
    """
    mesh = MESH_LINE.search(deck.text)
    if mesh is None:
        return "", "", "", ""
    wall = re.search(WALL_LINE.format(rest=CONTINUED, mesh=re.escape(mesh.group(1))), deck.text, re.M)
    if wall is None or not STORED.search(wall.group()):
        raise ValueError(
            f"{deck.path}: a wall needs two lines:  fix ID all mesh/surface file ${{surface_mesh}} type 2  "
            "and  fix ID all wall/gran ... mesh n_meshes 1 meshes ID store_force yes"
        )
    return mesh.group(), wall.group(), mesh.group(1), wall.group(1)


def pad_id(deck: Deck) -> str:
    """ID of the deck's mesh for the pad, "" without one."""
    found = PAD_LINE.search(deck.text)
    return found.group(1) if found else ""


def write_pad(setup: Setup, path: Path) -> None:
    """Write the pad as STL in um: a flat grid that faces down."""
    model = setup.model
    z = np.full((PAD_SQUARES, round(PAD_SQUARES * model.length_y / model.length_x)), setup.state.pad_height)
    points, triangles = surface_mesh(Heightfield(z, model.length_x / PAD_SQUARES))
    mesh = meshio.Mesh(points / MICRO, [("triangle", triangles[:, ::-1])])
    meshio.write(path, mesh, "stl", binary=False)


def create_atoms(liggghts: Liggghts, state: State) -> None:
    """Put the particles of a state into LIGGGHTS: particle i becomes the atom with tag i + 1.

    Raises ValueError when LIGGGHTS takes not all of them.
    """
    for x, y, z in state.position / MICRO:
        liggghts.command(f"create_atoms 1 single {float(x)!r} {float(y)!r} {float(z)!r} units box")
    tags = liggghts.tags()
    if len(tags) != len(state.mass):
        raise ValueError(
            f"LIGGGHTS has created {len(tags)} of {len(state.mass)} particles: some lie outside the box"
        )
    index = tags - 1
    liggghts.scalars(b"radius")[:] = state.diameter[index] / 2 / MICRO
    liggghts.scalars(b"rmass")[:] = state.mass[index] / MASS
    liggghts.scalars(b"density")[:] = state.mass[index] / (np.pi / 6 * state.diameter[index] ** 3)
    liggghts.vectors(b"x")[:] = state.position[index] / MICRO
    liggghts.vectors(b"v")[:] = state.velocity[index]
