"""Every export is read back and holds what the run holds; what cannot be exported is said in one line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import meshio
import numpy as np
import pandas as pd
import pytest
from polish_example import small_polish
from typer.testing import CliRunner

from cmpcheck.cli import app
from cmpcheck.export import FORMATS, TRAJECTORY, export_run
from cmpcheck.surfaces import surface_mesh, surfaces_over_time
from reference.case import Case
from reference.heightfield import Heightfield, flatness
from reference.ledger import COLUMNS
from reference.recording import Run
from reference.simulation import simulate

EPS = np.finfo(float).eps
DEPOSITS = {"node_depth": {}, "volume": {"deposit": "volume", "acceleration": 1e5}}
runner = CliRunner()
# pandas 2 reads the last digit only when it is told to, pandas 3 warns that it need not be told
EXACT: dict = {} if pd.__version__ >= "3" else {"float_precision": "round_trip"}


@pytest.fixture(scope="module", params=DEPOSITS)
def run(request) -> Run:
    """A polishing run under each deposit rule; removal by volume needs a larger acceleration to be seen."""
    return simulate(small_polish(removal=DEPOSITS[request.param]))


@pytest.fixture(scope="module")
def swarm() -> Run:
    """A run without a surface, periodic along z too."""
    raw = small_polish().model_dump(by_alias=True, exclude_none=True)
    raw = {name: raw[name] for name in ("case", "particles", "material", "contact")}
    raw["particles"] |= {"velocity_min": [-1.0] * 3, "velocity_max": [1.0] * 3}
    raw |= {"surface": {"kind": "none", "size": 4e-6, "height": 5e-6}, "numerics": {"time_step": 1e-8}}
    return simulate(Case.model_validate(raw))


@pytest.fixture(scope="module")
def folder(tmp_path_factory, swarm) -> Path:
    """The swarm's run folder."""
    return swarm.save(tmp_path_factory.mktemp("runs") / "swarm")


def call(*arguments: object):
    result = runner.invoke(app, ["export", *map(str, arguments)])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def complaint(*arguments: object) -> str:
    """The one line that bad input becomes."""
    result = call(*arguments)
    assert (result.exit_code, result.stdout, len(result.stderr.splitlines())) == (2, "", 1), result.stderr
    return result.stderr


def read(path: Path) -> meshio.Mesh:
    return meshio.read(path)


def holds_particles(mesh: meshio.Mesh, run: Run, k: int) -> None:
    """Bit by bit: the files hold doubles."""
    assert [block.type for block in mesh.cells] == ["vertex"]
    np.testing.assert_array_equal(mesh.points, run.positions[k])
    np.testing.assert_array_equal(mesh.cells[0].data[:, 0], np.arange(len(run.diameters)))
    for name, values in (
        ("velocity", run.velocities[k]),
        ("mass", run.masses[k]),
        ("diameter", run.diameters),
    ):
        np.testing.assert_array_equal(mesh.point_data[name], values)


def holds_surface(mesh: meshio.Mesh, surface: Heightfield, before: Heightfield) -> None:
    points, triangles = surface_mesh(surface)
    np.testing.assert_array_equal(mesh.points, points)
    np.testing.assert_array_equal(mesh.get_cells_type("triangle"), triangles)
    nodes = mesh.point_data["height"].reshape(np.add(surface.z.shape, 1))
    np.testing.assert_array_equal(nodes[:-1, :-1], surface.z)
    lowered = mesh.point_data["lowered"].reshape(nodes.shape)
    np.testing.assert_array_equal(lowered[:-1, :-1], before.z - surface.z)


def test_the_patch_has_the_triangles_of_the_heightfield():
    surface = Heightfield(np.random.default_rng(1).random((5, 7)), 0.5)
    points, triangles = surface_mesh(surface)
    assert (points.shape, triangles.shape) == ((6 * 8, 3), (2 * 5 * 7, 3))
    corners = points[triangles]
    upward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (upward[:, 2] > 0.0).all()
    for number, centre in enumerate(corners.mean(axis=1)):
        found = surface.closest_point(centre, 0.1)
        assert found is not None
        assert found[2] == number
        # h/3 twice, and a mean of three heights below 1: a few roundings
        assert found[1] < 16 * EPS
    assert points[:, 0].max() == 5 * 0.5
    np.testing.assert_array_equal(points[-1, 2], surface.z[0, 0])


def test_the_ledger_repeats_every_surface_of_a_run(run):
    surfaces = surfaces_over_time(run)
    assert surfaces is not None
    assert (run.contacts["removed_volume"] > 0).sum() > 50
    np.testing.assert_array_equal(surfaces[0].z, run.surface_initial.z)
    np.testing.assert_array_equal(surfaces[-1].z, run.surface.z)
    cost = run.case.cost
    found = [flatness(now.z, surfaces[0].z, cost.target_height, cost.exponent) for now in surfaces]
    np.testing.assert_array_equal(found, run.history["flatness"])
    assert len(set(found)) == len(run.times)


def test_a_ledger_that_lacks_one_removal_is_not_believed(run):
    hits = np.flatnonzero(run.contacts["removed_volume"] > 0)
    partial = replace(run, contacts=run.contacts.drop(index=hits[len(hits) // 2]))
    assert surfaces_over_time(partial) is None
    assert surfaces_over_time(replace(run, surface=None)) is None


def test_vtu_holds_first_and_last_state(run, tmp_path):
    files = export_run(run, "vtu", tmp_path)
    assert sorted(files) == sorted(tmp_path.iterdir())
    for name, k, surface in (("initial", 0, run.surface_initial), ("final", -1, run.surface)):
        holds_particles(read(tmp_path / f"particles_{name}.vtu"), run, k)
        holds_surface(read(tmp_path / f"surface_{name}.vtu"), surface, run.surface_initial)


def test_pvd_lists_the_same_blocks_at_every_output_time(run, tmp_path):
    *_, index = export_run(run, "pvd", tmp_path)
    root = ElementTree.parse(index).getroot()
    assert (root.tag, root.get("type")) == ("VTKFile", "Collection")
    entries = [entry.attrib for entry in root.iter("DataSet")]
    surfaces = surfaces_over_time(run)
    assert surfaces is not None
    for part, name in enumerate(("particles", "surface")):
        block = [entry for entry in entries if entry["name"] == name]
        assert [float(entry["timestep"]) for entry in block] == list(run.times)
        assert {entry["part"] for entry in block} == {str(part)}
        for k, entry in enumerate(block):
            mesh = read(tmp_path / entry["file"])
            if name == "particles":
                holds_particles(mesh, run, k)
            else:
                holds_surface(mesh, surfaces[k], run.surface_initial)
    assert len(entries) == 2 * len(run.times)


def test_pvd_shows_the_first_surface_where_the_next_ones_are_unknown(run, tmp_path):
    unknown = replace(run, contacts=run.contacts.iloc[:0])
    *_, index = export_run(unknown, "pvd", tmp_path)
    files = [entry.get("file") for entry in ElementTree.parse(index).iter("DataSet")][1::2]
    assert files == ["surface_initial.vtu"] * (len(run.times) - 1) + ["surface_final.vtu"]
    holds_surface(read(tmp_path / "surface_final.vtu"), run.surface, run.surface_initial)


def test_a_run_without_a_surface_has_one_block(swarm, tmp_path):
    *_, index = export_run(swarm, "pvd", tmp_path)
    entries = [entry.attrib for entry in ElementTree.parse(index).iter("DataSet")]
    assert [entry["name"] for entry in entries] == ["particles"] * len(swarm.times)
    holds_particles(read(tmp_path / entries[-1]["file"]), swarm, -1)


@pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")  # meshio, telling text from binary
def test_stl_holds_the_triangles_to_the_last_digit(run, tmp_path):
    for path, surface in zip(
        export_run(run, "stl", tmp_path), (run.surface_initial, run.surface), strict=True
    ):
        points, triangles = surface_mesh(surface)
        mesh = read(path)
        np.testing.assert_array_equal(mesh.points[mesh.get_cells_type("triangle")], points[triangles])
        normals = mesh.cell_data["facet_normals"][0]
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=8 * EPS, atol=0.0)
        assert (normals[:, 2] > 0.0).all()


def test_csv_holds_every_digit_and_says_what_its_columns_are(run, tmp_path):
    export_run(run, "csv", tmp_path)
    tables = {path.stem: pd.read_csv(path, **EXACT) for path in tmp_path.iterdir()}
    trajectory = tables["trajectory"]
    assert list(trajectory) == list(TRAJECTORY)
    shape = run.masses.shape
    for k, axis in enumerate("xyz"):
        np.testing.assert_array_equal(trajectory[axis].to_numpy().reshape(shape), run.positions[:, :, k])
        np.testing.assert_array_equal(
            trajectory[f"v{axis}"].to_numpy().reshape(shape), run.velocities[:, :, k]
        )
    np.testing.assert_array_equal(trajectory["mass"].to_numpy().reshape(shape), run.masses)
    expected = {"time": run.times[:, np.newaxis], "particle": np.arange(shape[1]), "diameter": run.diameters}
    for name, values in expected.items():
        np.testing.assert_array_equal(
            trajectory[name].to_numpy().reshape(shape), np.broadcast_to(values, shape)
        )
    pd.testing.assert_frame_equal(tables["contacts"], run.contacts.reset_index(drop=True), check_exact=True)
    pd.testing.assert_frame_equal(tables["history"], run.history, check_exact=True)
    described = pd.read_csv(tmp_path / "columns.csv", keep_default_na=False)
    written = {f"{name}.csv": list(table) for name, table in tables.items() if name != "columns"}
    assert described.groupby("file")["column"].agg(list).to_dict() == written
    units_given_before = {name for name, meaning in COLUMNS.items() if not meaning}  # ny, nz follow nx
    assert set(described["column"][described["meaning"] == ""]) == units_given_before


def parse_dump(path: Path) -> list[dict]:
    """Snapshots of a LAMMPS text dump: its items by name, and its atoms as a table."""
    snapshots: list[dict] = []
    lines = iter(path.read_text("utf-8").splitlines())
    units, item = None, next(lines, None)
    while item is not None:
        name, body = item.removeprefix("ITEM: "), []
        for line in lines:
            if line.startswith("ITEM: "):
                item = line
                break
            body.append(line.split())
        else:
            item = None
        if name == "UNITS":
            units = body[0][0]
        elif name == "TIME":
            snapshots.append({"units": units, "time": float(body[0][0])})
        elif name.startswith("BOX BOUNDS"):
            snapshots[-1] |= {"boundary": name.split()[2:], "box": np.array(body, float)}
        elif name.startswith("ATOMS"):
            snapshots[-1]["atoms"] = pd.DataFrame(np.array(body, float), columns=name.split()[1:])
        else:
            snapshots[-1][name] = int(body[0][0])
    return snapshots


def holds_trajectory(path: Path, run: Run, boundary: list[str]) -> np.ndarray:
    """Check every snapshot of a dump; return the corners of its box, (2, 3)."""
    snapshots = parse_dump(path)
    assert [snapshot["TIMESTEP"] for snapshot in snapshots] == list(range(len(run.times)))
    tight = {"rtol": EPS, "atol": 0.0}  # one multiplication by a power of ten
    np.testing.assert_allclose([snapshot["time"] for snapshot in snapshots], run.times * 1e6, **tight)
    for k, snapshot in enumerate(snapshots):
        atoms = snapshot["atoms"]
        assert (snapshot["units"], snapshot["boundary"]) == ("micro", boundary)
        assert snapshot["NUMBER OF ATOMS"] == len(run.diameters)
        assert list(atoms["id"]) == list(range(1, len(run.diameters) + 1))
        np.testing.assert_allclose(atoms[["x", "y", "z"]], run.positions[k] * 1e6, **tight)
        np.testing.assert_array_equal(atoms[["vx", "vy", "vz"]], run.velocities[k])
        np.testing.assert_allclose(atoms["diameter"], run.diameters * 1e6, **tight)
        np.testing.assert_allclose(atoms["mass"], run.masses[k] * 1e15, **tight)
        np.testing.assert_array_equal(snapshot["box"], snapshots[0]["box"])
    return snapshots[0]["box"].T


def test_the_dump_holds_the_trajectory_in_units_micro(run, tmp_path):
    (path,) = export_run(run, "dump", tmp_path)
    low, high = holds_trajectory(path, run, ["pp", "pp", "ff"])
    size = run.case.surface.size * 1e6
    digits = 1e-14  # 15 of them are written
    np.testing.assert_allclose(high[:2], size, rtol=digits, atol=0.0)
    assert low[2] <= run.surface.z.min() * 1e6 * (1.0 - digits)
    assert high[2] == 1.6


def test_the_box_of_a_periodic_run_is_its_period(swarm, tmp_path):
    (path,) = export_run(swarm, "dump", tmp_path)
    box = holds_trajectory(path, swarm, ["pp", "pp", "pp"])
    np.testing.assert_array_equal(box, [[0, 0, 0], [4, 4, 5]])


def test_the_box_holds_all_copies_of_a_problem(swarm, tmp_path):
    beside = np.add(swarm.positions, [swarm.case.surface.size, 0.0, 0.0])
    copies = {name: np.concatenate([getattr(swarm, name)] * 2, axis=1) for name in ("velocities", "masses")}
    positions = np.concatenate([swarm.positions, beside], axis=1)
    two = replace(swarm, positions=positions, diameters=np.tile(swarm.diameters, 2), **copies)
    (path,) = export_run(two, "dump", tmp_path)
    np.testing.assert_array_equal(holds_trajectory(path, two, ["pp", "pp", "pp"])[1], [8, 4, 5])


@pytest.mark.parametrize("form", FORMATS)
def test_an_export_is_the_same_bytes_every_time(form, run, tmp_path):
    first, second = export_run(run, form, tmp_path / "a"), export_run(run, form, tmp_path / "b")
    assert [path.name for path in first] == [path.name for path in second]
    assert all(a.read_bytes() == b.read_bytes() for a, b in zip(first, second, strict=True))


def test_the_command_writes_beside_the_run_and_names_the_file(folder):
    result = call(folder, "--format", "dump")
    assert (result.exit_code, result.stderr) == (0, "")
    (path,) = result.stdout.split()
    assert Path(path) == folder / "dump" / "polish.dump"
    assert len(parse_dump(Path(path))) == 6
    assert "exists already" in complaint(folder, "--format", "dump")
    assert call(folder, "--format", "dump", "--force").exit_code == 0
    assert Run.load(folder).provenance["complete"]


def test_a_run_that_is_not_complete_is_exported_with_a_note(swarm, tmp_path):
    replace(swarm, provenance=swarm.provenance | {"complete": False}).save(tmp_path)
    result = call(tmp_path, "--format", "csv", "--out", tmp_path / "out")
    assert result.exit_code == 0
    assert "not complete: it ends at 2e-05 s" in result.stderr


def test_an_unknown_format_is_refused_with_the_nearest(folder):
    line = complaint(folder, "--format", "vtk")
    assert "unknown format 'vtk': did you mean 'vtu'? known: csv, dump, pvd, stl, vtu" in line


def test_a_folder_without_a_run_is_refused(tmp_path):
    assert "not a run folder: it holds no trajectory.h5" in complaint(tmp_path, "--format", "vtu")
    assert "not a run folder" in complaint(tmp_path / "nowhere", "--format", "vtu")


def test_a_folder_of_several_runs_is_refused_with_their_names(folder):
    assert "it holds the runs swarm: name one" in complaint(folder.parent, "--format", "vtu")


def test_a_damaged_run_is_refused(folder, tmp_path):
    for path in folder.glob("*.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "trajectory.h5").write_bytes(b"no HDF5")
    assert "not a run folder" in complaint(tmp_path, "--format", "vtu")


def test_stl_of_a_run_without_a_surface_is_refused_and_nothing_is_made(folder, tmp_path):
    assert "the run has no surface" in complaint(folder, "--format", "stl", "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_an_output_that_is_a_file_is_refused_and_kept(folder, tmp_path):
    (tmp_path / "out").write_text("mine")
    assert "cannot be written" in complaint(folder, "--format", "csv", "--out", tmp_path / "out")
    assert (tmp_path / "out").read_text() == "mine"


def test_an_output_that_cannot_be_made_is_refused(folder, tmp_path):
    (tmp_path / "file").write_text("mine")
    assert "cannot be written" in complaint(folder, "--format", "csv", "--out", tmp_path / "file" / "out")
