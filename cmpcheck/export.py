"""A run as files that other programs open: ParaView, OVITO, CAD and spreadsheets.

Everything is in SI units but the LAMMPS dump, whose units are `micro`.  What a run folder holds is
`reference/recording.py`; triangles, and the surface between the first and the last time, are `surfaces.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.etree import ElementTree

import meshio
import numpy as np
import pandas as pd

from cmpcheck.outputs import OutputError, writable
from cmpcheck.surfaces import surface_mesh, surfaces_over_time
from reference.case import CaseError
from reference.heightfield import Heightfield
from reference.ledger import COLUMNS
from reference.recording import Run

LENGTH, TIME, MASS = 1e6, 1e6, 1e15  # um, us and pg in SI: LAMMPS's units micro; a speed is a number in m/s
TRAJECTORY = {
    "time": "s",
    "particle": "number of the particle, from 0",
    "x": "m, centre, wrapped into the periodic box",
    "y": "m",
    "z": "m, above the base plane",
    "vx": "m/s",
    "vy": "m/s",
    "vz": "m/s",
    "mass": "kg, with what was picked up",
    "diameter": "m",
}
HISTORY = {
    "time": "s",
    "flatness": "1, Pi of Eq 44; empty where undefined",
    "pad_height": "m, H; empty without a pad",
    "removed_volume": "m3, sum of the caps so far (Eq 36), not accelerated",
    "removed_mass": "kg, rho_s times that",
    "kinetic_energy": "J, of all particles",
    "momentum_x": "kg m/s, of all particles",
    "momentum_y": "kg m/s",
    "momentum_z": "kg m/s",
    "mean_velocity_x": "m/s, mean over the particles",
    "contacts": "number so far, with those too slow for the ledger",
    "removals": "number so far of impacts that removed material",
    "depth_sum": "m, sum of the depths so far (Eq 35), not accelerated",
    "contact_loss": "J, kinetic energy taken by contacts so far, each by itself",
    "simultaneous_loss": "J, what contacts of one particle at once took beyond that",
    "pad_work": "J, done by the pad on the particles so far",
    "fluid_work": "J, done by the drag on the particles so far",
    "fluid_impulse_x": "N s, of the drag on the particles so far",
    "fluid_impulse_y": "N s",
    "fluid_impulse_z": "N s",
    "surface_impulse_x": "N s, of the surface on the particles so far",
    "surface_impulse_y": "N s",
    "surface_impulse_z": "N s",
    "pad_impulse_z": "N s, of the pad on the particles so far",
    "energy_rounding": "J, bound of the round-off in the energies above",
    "momentum_rounding": "N s, bound of the round-off in each component of the impulses",
}


def load_run(folder: Path) -> Run:
    """The run in a folder.  Raises CaseError, in one line, for a folder that holds none."""
    if not (folder / "trajectory.h5").is_file():
        below = sorted(path.parent.name for path in folder.glob("*/trajectory.h5"))
        why = f"it holds the runs {', '.join(below)}: name one" if below else "it holds no trajectory.h5"
        raise CaseError(f"{folder}: not a run folder: {why}")
    return Run.load(folder)


def export_run(run: Run, form: str, folder: Path, force: bool = False) -> list[Path]:
    """Write a run in one of `FORMATS` into a folder, made if need be; the file to open is the last returned.

    Raises OutputError when the folder cannot be written, or holds something already, unless `force`, and
    CaseError when the run has nothing that the format could hold.
    """
    if form == "stl" and run.surface is None:
        raise CaseError(f"{run.case.name}: the run has no surface; stl holds the surface and nothing else")
    if folder.is_dir() and any(folder.iterdir()) and not force:
        raise OutputError(f"{folder}: exists already; choose another folder, or --force to write into it")
    return FORMATS[form](run, writable(folder))


def write_vtu(run: Run, folder: Path) -> list[Path]:
    """First and last state for ParaView: particles, and the surface if there is one."""
    files = []
    for name, k, surface in (("initial", 0, run.surface_initial), ("final", -1, run.surface)):
        files.append(_write_particles(run, k, folder / f"particles_{name}.vtu"))
        if surface is not None:
            files.append(_write_surface(run, surface, folder / f"surface_{name}.vtu"))
    return files


def write_pvd(run: Run, folder: Path) -> list[Path]:
    """Particles and surface at every output time for ParaView, and CASE.pvd, the index that it opens.

    Where the surface between the first and the last time is not known, the first is shown until the last.
    """
    particles = [_write_particles(run, k, folder / f"particles_{k:05d}.vtu") for k in range(len(run.times))]
    blocks = {"particles": particles, "surface": _surface_files(run, folder)}
    index = ElementTree.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
    collection = ElementTree.SubElement(index, "Collection")
    for k, time in enumerate(run.times):  # every time needs the same blocks
        for part, (name, files) in enumerate((name, files) for name, files in blocks.items() if files):
            entry = {"timestep": repr(float(time)), "group": "", "part": str(part), "name": name}
            ElementTree.SubElement(collection, "DataSet", entry | {"file": files[k].name})
    ElementTree.indent(index)
    path = folder / f"{run.case.name}.pvd"
    ElementTree.ElementTree(index).write(path, encoding="utf-8", xml_declaration=True)
    return [*dict.fromkeys(blocks["particles"] + blocks["surface"]), path]


def write_stl(run: Run, folder: Path) -> list[Path]:
    """First and last surface as ASCII STL, which keeps every digit; lengths in m."""
    files = []
    for name, surface in (("initial", run.surface_initial), ("final", run.surface)):
        assert surface is not None
        points, triangles = surface_mesh(surface)
        path = folder / f"surface_{name}.stl"
        meshio.Mesh(points, [("triangle", triangles)]).write(path, file_format="stl", binary=False)
        files.append(path)
    return files


def write_csv(run: Run, folder: Path) -> list[Path]:
    """Tables in SI with every digit: trajectory, contacts and history; columns.csv says what is in them."""
    n_times, n_particles = run.masses.shape
    trajectory = pd.DataFrame(
        np.column_stack(
            [
                np.repeat(run.times, n_particles),
                np.tile(np.arange(n_particles), n_times),
                run.positions.reshape(-1, 3),
                run.velocities.reshape(-1, 3),
                run.masses.ravel(),
                np.tile(run.diameters, n_times),
            ]
        ),
        columns=list(TRAJECTORY),
    ).astype({"particle": int})
    tables = {"trajectory": trajectory, "contacts": run.contacts, "history": run.history}
    said = {"trajectory": TRAJECTORY, "contacts": COLUMNS, "history": HISTORY}
    tables["columns"] = pd.DataFrame(
        [(f"{name}.csv", column, said[name].get(column, "")) for name in tables for column in tables[name]],
        columns=["file", "column", "meaning"],
    )
    files = []
    for name, table in tables.items():
        files.append(folder / f"{name}.csv")
        table.to_csv(files[-1], index=False, lineterminator="\n", encoding="utf-8")
    return files


def write_dump(run: Run, folder: Path) -> list[Path]:
    """The trajectory as a LAMMPS text dump, CASE.dump, for OVITO: units micro, steps numbered by output."""
    path = folder / f"{run.case.name}.dump"
    path.write_text("\n".join(_dump_lines(run)) + "\n", "utf-8", newline="\n")
    return [path]


Writer = Callable[[Run, Path], list[Path]]
FORMATS: dict[str, Writer] = {
    "vtu": write_vtu, "pvd": write_pvd, "stl": write_stl, "csv": write_csv, "dump": write_dump,
}  # fmt: skip


def _write_particles(run: Run, k: int, path: Path) -> Path:
    number = np.arange(len(run.diameters))
    data = {
        "diameter": run.diameters,
        "velocity": run.velocities[k],
        "mass": run.masses[k],
        "particle": number,
    }
    cells = [("vertex", number[:, np.newaxis])]
    meshio.Mesh(run.positions[k], cells, point_data=data).write(path, file_format="vtu")
    return path


def _write_surface(run: Run, surface: Heightfield, path: Path) -> Path:
    """The triangles with the height of each node, and by how much it was lowered, in m."""
    assert run.surface_initial is not None
    points, triangles = surface_mesh(surface)
    before, _ = surface_mesh(run.surface_initial)
    data = {"height": points[:, 2].copy(), "lowered": before[:, 2] - points[:, 2]}
    meshio.Mesh(points, [("triangle", triangles)], point_data=data).write(path, file_format="vtu")
    return path


def _surface_files(run: Run, folder: Path) -> list[Path]:
    """One file for each output time, or none for a run without a surface."""
    known = surfaces_over_time(run)
    if known:
        return [_write_surface(run, now, folder / f"surface_{k:05d}.vtu") for k, now in enumerate(known)]
    if run.surface_initial is None or run.surface is None:
        return []
    first = _write_surface(run, run.surface_initial, folder / "surface_initial.vtu")
    return [first] * (len(run.times) - 1) + [_write_surface(run, run.surface, folder / "surface_final.vtu")]


def _dump_lines(run: Run) -> Iterator[str]:
    low, high, z_periodic = _box(run)
    bounds = [f"{a:.15g} {b:.15g}" for a, b in zip(low * LENGTH, high * LENGTH, strict=True)]
    yield from ("ITEM: UNITS", "micro")
    for k, time in enumerate(run.times):
        yield from ("ITEM: TIME", repr(float(time * TIME)), "ITEM: TIMESTEP", str(k))
        yield from ("ITEM: NUMBER OF ATOMS", str(len(run.diameters)))
        yield from (f"ITEM: BOX BOUNDS pp pp {'pp' if z_periodic else 'ff'}", *bounds)
        yield "ITEM: ATOMS id type x y z vx vy vz diameter mass"
        rows = np.column_stack(
            [run.positions[k] * LENGTH, run.velocities[k], run.diameters * LENGTH, run.masses[k] * MASS]
        )
        for number, row in enumerate(rows.tolist(), start=1):
            yield f"{number} 1 " + " ".join(map(repr, row))


def _box(run: Run) -> tuple[np.ndarray, np.ndarray, bool]:
    """Lower and upper corner (3,) in m of a box that holds the run, and whether it is periodic along z."""
    part, x, z = run.case.surface, run.positions[:, :, 0], run.positions[:, :, 2]
    length_x = part.size * max(1, math.ceil(x.max() / part.size))  # copies of the problem lie side by side
    if part.height is not None:
        return np.zeros(3), np.array([length_x, part.size, part.height]), True
    radius = 0.5 * run.diameters
    grounds = [s.z.min() for s in (run.surface_initial, run.surface) if s is not None]
    low = min([0.0, (z - radius).min(), *grounds])
    high = max((z + radius).max(), run.case.pad.initial_height if run.case.pad else 0.0)
    return np.array([0.0, 0.0, low]), np.array([length_x, part.size, high]), False
