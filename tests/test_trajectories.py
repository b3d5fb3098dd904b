"""Trajectories from files: what is read is what was written, what is wrong is refused, verdicts are right.

The files are the reference's own runs, so that the right answer is known; the errors in them are made here.
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from cmpcheck.cli import app
from cmpcheck.export import export_run
from cmpcheck.judges import judge_of
from cmpcheck.judges.protocol import Impact
from cmpcheck.trajectories import Options, compare_file
from cmpcheck.trajectories.digits import text_resolution
from cmpcheck.trajectories.frames import Columns
from cmpcheck.trajectories.judged import contact_error
from cmpcheck.trajectories.starts import evidence, read
from cmpcheck.trajectories.units import parse_units
from cmpcheck.trajectories.velocities import by_differences
from reference.case import Case, CaseError, load_case
from reference.process import build_setup
from reference.recording import Run
from reference.simulation import simulate

STEP = "20 ps"
STATED = Options(time_step=STEP, contact_duration="0 s")
PAIR, SLIP, WALL, PICKUP = (
    ("pair_head_on", "e0.5"), ("pair_slip", ""), ("wall_bounce", "no_pickup"), ("wall_bounce", "pickup"),
)  # fmt: skip
UNITS = {"csv": "si", "parquet": "", "dump": "", "pvd": "si"}


def variant(name: tuple[str, str]) -> Case:
    return next(case for case in load_case(name[0]).variants() if name[1] in ("", case.variant))


@functools.cache
def run_of(name: tuple[str, str], wrong: float = 1.0, key: str = "restitution") -> Run:
    """The reference's run of a case, with a restitution or friction that is wrong by a factor."""
    case = variant(name)
    value = getattr(case.contact, key) * wrong
    keys = (
        {key: value}
        if key == "restitution"
        else dict.fromkeys(("static_friction", "dynamic_friction"), value)
    )
    changed = {f"contact.{k}": v for k, v in keys.items()} | {"numerics.time_step": 2e-11}
    return simulate(case.replaced(changed))


def table(run: Run) -> pd.DataFrame:
    """The trajectory as rows."""
    times, count = run.masses.shape
    columns = np.column_stack(
        [run.positions.reshape(-1, 3), run.velocities.reshape(-1, 3), run.masses.ravel()]
    )
    rows = pd.DataFrame(columns, columns=["x", "y", "z", "vx", "vy", "vz", "mass"])
    rows.insert(0, "particle", np.tile(np.arange(count), times))
    rows.insert(0, "time", np.repeat(run.times, count))
    return rows


def write(run: Run, form: str, folder: Path) -> Path:
    """The run as a file of a format, which says its units where the format can."""
    if form == "parquet":
        rows = table(run)
        rows.attrs["units"] = "si"
        rows.to_parquet(folder / "mine.parquet", index=False)
        return folder / "mine.parquet"
    files = export_run(run, form, folder / form)
    return next(file for file in files if file.suffix == f".{form}")


def csv(folder: Path, rows: pd.DataFrame, header: str = "# units: si\n", **how) -> Path:
    path = folder / "mine.csv"
    path.write_text(header + rows.to_csv(index=False, **how), "utf-8")
    return path


def statuses(name: tuple[str, str], path: Path, options: Options = STATED) -> dict[str, set[str]]:
    """The statuses of each quantity."""
    case = variant(name)
    rows, *_ = compare_file(case, build_setup(case), path, options)
    found: dict[str, set[str]] = {}
    for row in rows:
        found.setdefault(row.quantity, set()).add(row.status)
    return found


def refusal(name: tuple[str, str], path: Path, options: Options = STATED) -> str:
    """The one line that a file becomes which cannot be compared."""
    with pytest.raises(CaseError) as caught:
        statuses(name, path, options)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(str(path.parent))
    return message


# What is read


@pytest.mark.parametrize("form", UNITS)
@pytest.mark.parametrize("name", [PAIR, PICKUP], ids="/".join)
def test_what_is_read_is_what_was_written(form, name, tmp_path):
    run = run_of(name)
    setup = build_setup(variant(name))
    found = evidence(write(run, form, tmp_path), setup, Options(units=UNITS[form]), judge_of(setup))
    # a number is divided and multiplied by a unit
    for array in ("times", "positions", "velocities", "masses"):
        np.testing.assert_allclose(getattr(found.run, array), getattr(run, array), rtol=1e-15, atol=1e-30)
    assert found.masses_known
    assert not found.differences


@given(
    values=st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=20),
    digits=st.integers(2, 15),
    form=st.sampled_from("fge"),
)
def test_the_last_digit_bounds_what_was_lost_by_writing(values, digits, form):
    texts = [f"{value:.{digits}{form}}" for value in values]
    found = text_resolution({"v": texts}, {"v": max(map(abs, values))})["v"]
    lost = max(abs(float(text) - value) for text, value in zip(texts, values, strict=True))
    assert lost <= found * (1 + 1e-9) + 1e-300


@given(seed=st.integers(0, 2**32 - 1), decimals=st.integers(3, 9), kink=st.integers(3, 9))
def test_velocities_of_free_flight_are_within_their_bound(seed, decimals, kink):
    rng = np.random.default_rng(seed)
    times, before, after = np.arange(13.0), *rng.uniform(-1.0, 1.0, (2, 1, 3))
    exact = np.where(
        (times < kink)[:, None, None],
        before * times[:, None, None],
        before * kink + after * (times - kink)[:, None, None],
    )
    resolution = 0.5 * 10.0**-decimals
    found, bound = by_differences(times, np.round(exact, decimals), resolution * (1 + 1e-9), (kink, kink))
    assert (np.abs(found[0] - before) <= bound[0] * (1 + 1e-9)).all()
    assert (np.abs(found[-1] - after) <= bound[-1] * (1 + 1e-9)).all()
    assert bound[[0, -1]].max() <= resolution * (1 + 1e-6)  # 2 resolution over two intervals or more


def test_velocities_where_forces_act_are_within_their_bound():
    times = np.linspace(0.0, 3.0, 61)
    positions = np.exp(-times)[:, None, None] * np.ones((1, 1, 3))
    found, bound = by_differences(times, positions, 1e-15, None)
    assert (np.abs(found + positions) <= bound).all()
    assert bound[2:-2].max() < 0.01


def test_missing_velocities_are_computed_and_said_to_be(tmp_path):
    path = csv(tmp_path, table(run_of(WALL)).drop(columns=["vx", "vy", "vz"]))
    case = variant(WALL)
    rows, _, notes, _ = compare_file(case, build_setup(case), path, STATED)
    assert {row.status for row in rows} == {"agree"}
    assert any("no velocities" in note for note in notes)


def test_units_may_be_named_one_by_one(tmp_path):
    rows = table(run_of(PAIR))
    for column, factor in {"time": 1e9, "x": 1e6, "y": 1e6, "z": 1e6, "mass": 1e15}.items():
        rows[column] *= factor
    path = csv(tmp_path, rows, "# units: length=um, time=ns, mass=pg, velocity=m/s\n# time_step: 0.02\n")
    assert statuses(PAIR, path, Options(contact_duration="0 s"))["restitution"] == {"agree"}
    assert parse_units("micro").velocity == 1.0


def test_a_dump_with_steps_for_times_needs_the_time_step(tmp_path):
    path = write(run_of(PAIR), "dump", tmp_path)
    lines = path.read_text("utf-8").splitlines()
    cut = [k for k, line in enumerate(lines) if line == "ITEM: TIME"]
    kept = [line for k, line in enumerate(lines) if k not in cut and k - 1 not in cut]
    path.write_text("\n".join(kept) + "\n", "utf-8")
    assert "its times are numbers of steps" in refusal(PAIR, path, Options())
    interval = f"{float(run_of(PAIR).times[1])!r} s"
    assert statuses(PAIR, path, Options(time_step=interval, contact_duration="0 s"))["momentum"] == {"agree"}


def test_positions_scaled_by_the_box_are_read(tmp_path):
    path = write(run_of(PAIR), "dump", tmp_path)
    lines, low, side = path.read_text("utf-8").splitlines(), [0.0] * 3, [1.0] * 3
    for k, line in enumerate(lines):
        if line.startswith("ITEM: BOX BOUNDS"):
            bounds = [[float(text) for text in row.split()] for row in lines[k + 1 : k + 4]]
            low, side = [a for a, _ in bounds], [b - a for a, b in bounds]
        if line.startswith("ITEM: ATOMS"):
            lines[k] = line.replace("x y z", "xs ys zs")
            for row in (k + 1, k + 2):
                parts = lines[row].split()
                parts[2:5] = [repr((float(parts[2 + a]) - low[a]) / side[a]) for a in range(3)]
                lines[row] = " ".join(parts)
    path.write_text("\n".join(lines) + "\n", "utf-8")
    found = evidence(path, build_setup(variant(PAIR)), Options(), judge_of(build_setup(variant(PAIR))))
    # a division and a multiplication by the box, of coordinates up to it
    np.testing.assert_allclose(found.run.positions, run_of(PAIR).positions, rtol=0, atol=1e-15 * 4e-6 * 4)
    assert statuses(PAIR, path)["restitution"] == {"agree"}


@pytest.mark.parametrize("form", ["vtk", "vtk-ascii", "vtu-ascii"])
def test_other_files_of_a_series_are_read(form, tmp_path):
    """Legacy VTK, and text instead of binary numbers, whose digits are then counted."""
    path, (kind, _, text) = write(run_of(PAIR), "pvd", tmp_path), form.partition("-")
    for k in range(len(run_of(PAIR).times)):
        old = path.parent / f"particles_{k:05d}.vtu"
        mesh = meshio.read(old)
        old.unlink()
        writer = meshio.vtu if kind == "vtu" else meshio.vtk
        writer.write(str(old.with_suffix(f".{kind}")), mesh, binary=not text)
    path.write_text(path.read_text("utf-8").replace(".vtu", f".{kind}"), "utf-8")
    found = statuses(PAIR, path, Options("si", STEP, "0 s"))
    assert found["restitution"] == found["velocity_z"] == {"agree"}


# Verdicts


@pytest.mark.parametrize("form", UNITS)
@pytest.mark.parametrize("name", [PAIR, WALL], ids="/".join)
def test_a_right_file_agrees_and_one_percent_of_restitution_disagrees(form, name, tmp_path):
    options = Options(UNITS[form], STEP, "0 s")
    right = statuses(name, write(run_of(name), form, tmp_path), options)
    assert set().union(*right.values()) == {"agree"}
    (tmp_path / "wrong").mkdir()
    wrong = statuses(name, write(run_of(name, 1.01), form, tmp_path / "wrong"), options)
    assert {q for q, found in wrong.items() if "disagree" in found} >= {"restitution", "normal_impulse"}


def test_two_percent_of_friction_disagree(tmp_path):
    right = statuses(SLIP, csv(tmp_path, table(run_of(SLIP))))
    assert set().union(*right.values()) == {"agree"}
    wrong = statuses(SLIP, csv(tmp_path, table(run_of(SLIP, 1.02, "dynamic_friction"))))
    assert wrong["friction_impulse"] == wrong["energy_lost"] == {"disagree"}
    assert wrong["momentum"] == {"agree"}


@pytest.mark.parametrize("wrong, status", [(1.0, "agree"), (1.005, "not_tested"), (1.02, "disagree")])
def test_without_time_step_the_detection_limit_decides(wrong, status, tmp_path):
    path = csv(tmp_path, table(run_of(PAIR, wrong)))
    assert statuses(PAIR, path, Options())["restitution"] == {status}


def test_too_few_digits_are_no_test_and_no_disagreement(tmp_path):
    case = variant(WALL)
    path = csv(tmp_path, table(run_of(WALL)), float_format="%.3g")
    rows, *_ = compare_file(case, build_setup(case), path, STATED)
    assert "disagree" not in {row.status for row in rows}
    (row,) = [row for row in rows if row.quantity == "restitution"]
    assert row.tolerance > 1e-3
    path = csv(tmp_path, table(run_of(WALL)).drop(columns=["vx", "vy", "vz"]), float_format="%.4g")
    rows, *_ = compare_file(case, build_setup(case), path, STATED)
    assert "disagree" not in {row.status for row in rows}
    (row,) = [row for row in rows if row.quantity == "velocity_z"]
    assert row.status == "not_tested" or row.tolerance > 1e-4


def test_without_masses_what_depends_on_them_is_not_tested_where_they_change(tmp_path):
    rows = table(run_of(PICKUP)).drop(columns="mass")
    found = statuses(PICKUP, csv(tmp_path, rows))
    assert found["removed_mass"] == found["energy_lost"] == found["restitution"] == {"not_tested"}
    assert found["velocity_z"] == {"agree"}


@given(
    restitution=st.floats(0.15, 0.999),
    steps=st.integers(20, 400),
    phase=st.floats(0.0, 1.0, exclude_max=True),
    pulls=st.booleans(),
)
@settings(max_examples=60)
def test_a_spring_and_dashpot_in_steps_is_within_the_bound_of_a_contact(restitution, steps, phase, pulls):
    """Leap-frog on a unit mass that meets a wall at speed 1, contact duration 1, noticed at any phase."""
    loss = -math.log(restitution)
    stiffness, damping, dt = math.pi**2 + loss**2, 2.0 * loss, 1.0 / steps
    if not pulls:  # cut off where it would pull: another restitution, solved for
        phi = math.atan2(math.sqrt(stiffness - loss**2), loss)
        restitution = math.exp(-2.0 * phi / math.tan(phi)) if phi != math.pi / 2 else restitution
    x, v = phase * dt, -1.0
    for _ in range(3 * steps):
        x += v * dt
        if x >= 0.0 and v > 0.0:
            break
        force = -stiffness * x - damping * v if x < 0.0 else 0.0
        v += dt * (force if pulls else max(force, 0.0))
    normal = np.array([0.0, 0.0, 1.0])
    impact = Impact(0.0, (0,), normal, (1.0 + restitution) * normal, 1.0, np.zeros(3), 0.0)
    duration = 1.0 if pulls else 2.0 * math.atan2(math.pi, loss) / math.sqrt(stiffness)
    bound = contact_error(impact, restitution, dt, duration, 0.0).along
    assert abs(v - restitution) <= bound


# What is refused


def changed(
    column: str, change: Callable, rows: slice = slice(None)
) -> Callable[[pd.DataFrame], pd.DataFrame]:
    def apply(table: pd.DataFrame) -> pd.DataFrame:
        table.loc[table.index[rows], column] = change(table.loc[table.index[rows], column])
        return table

    return apply


DEFECTS = {
    "no position": (lambda t: t.drop(columns="y"), "no column y"),
    "no time": (lambda t: t.drop(columns="time"), "no column time"),
    "no particle": (lambda t: t.drop(columns="particle"), "no column particle"),
    "half a velocity": (lambda t: t.drop(columns="vy"), "of the velocity only vx, vz"),
    "other units": (changed("x", lambda x: x * 1e3), "starts with x"),
    "not a number": (changed("vz", lambda v: np.nan, slice(7, 8)), "row 8 of the table"),
    "infinite": (changed("x", lambda x: np.inf, slice(7, 8)), "finite numbers"),
    "short": (lambda t: t[t.time < 4e-8], "but the case lasts 5e-08 s"),
    "late": (lambda t: t[t.time > 1e-9], "begins at"),
    "a particle less": (lambda t: t.drop(index=9), "1 particles, but the case has 2"),
    "a particle more": (lambda t: pd.concat([t.iloc[:10], t.iloc[9:10], t.iloc[10:]]), "3 particles"),
    "a particle twice": (changed("particle", lambda p: 0), "occurs twice"),
    "another number": (changed("particle", lambda p: 5, slice(9, 10)), "other particle numbers"),
    "times that fall": (lambda t: pd.concat([t, t.iloc[:2]]), "times that rise"),
    "another start": (changed("x", lambda x: x + 1e-9), "another starting state"),
    "another velocity": (changed("vx", lambda v: 1.001 * v), "starts with vx"),
    "another order": (changed("particle", lambda p: 1 - p), "another order"),
    "another mass": (changed("mass", lambda m: 1.01 * m), "has the mass"),
    "no mass at the end": (changed("mass", lambda m: 0.0, slice(-1, None)), "from 1e-06 of its"),
    "a negative mass": (changed("mass", lambda m: -m, slice(-1, None)), "from 1e-06 of its"),
    "another diameter": (lambda t: t.assign(radius=1e-6), "has the diameter"),
    "a column twice": (lambda t: t.assign(xu=t.x), "two columns hold x"),
}


@pytest.mark.parametrize("defect", DEFECTS)
def test_a_defect_of_a_table_is_refused_in_one_line(defect, tmp_path):
    change, message = DEFECTS[defect]
    assert message in refusal(PAIR, csv(tmp_path, change(table(run_of(PAIR)))))


@pytest.mark.parametrize("defect", [name for name in DEFECTS if name not in ("not a number", "infinite")])
def test_the_same_in_parquet(defect, tmp_path):
    change, message = DEFECTS[defect]
    rows = change(table(run_of(PAIR)))
    rows.attrs["units"] = "si"
    rows.to_parquet(tmp_path / "mine.parquet", index=False)
    assert message in refusal(PAIR, tmp_path / "mine.parquet")


def test_values_that_are_not_finite_in_parquet(tmp_path):
    rows = changed("x", lambda x: np.nan, slice(7, 8))(table(run_of(PAIR)))
    rows.to_parquet(tmp_path / "mine.parquet", index=False)
    assert "row 8: x is not finite" in refusal(PAIR, tmp_path / "mine.parquet")


@pytest.mark.parametrize(
    "header, options, message",
    [
        ("", Options(), "neither the file nor --units says them"),
        ("# units: furlong\n", Options(), "allowed: si, cgs, micro, nano"),
        ("# units: length=um,time=us\n", Options(), "no mass"),
        ("# units: length=s,time=us,mass=pg\n", Options(), "wrong dimension"),
        ("# units: micro\n", Options(), "ends at 5e-14 s"),
        ("# units: si\n", Options(units="micro"), "its units are 'si', --units says 'micro'"),
        ("# units: si\n# units: cgs\n", Options(), "units is 'si' and 'cgs'"),
        ("# units: si\n# time_step: soon\n", Options(), "time_step = 'soon'"),
        ("# units: si\n", Options(time_step="-1 ns"), "time_step = '-1 ns'"),
    ],
)
def test_units_and_times_are_declared_or_refused(header, options, message, tmp_path):
    assert message in refusal(PAIR, csv(tmp_path, table(run_of(PAIR)), header), options)


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("ITEM: UNITS\nmicro", "ITEM: UNITS\nlj", "units 'lj'"),
        ("ITEM: UNITS\nmicro\n", "", "neither the file nor --units"),
        ("NUMBER OF ATOMS\n2", "NUMBER OF ATOMS\n3", "values for"),
        ("NUMBER OF ATOMS\n2", "NUMBER OF ATOMS\n99999999999999999999999", "number of atoms"),
        ("ATOMS id type x y z", "ATOMS id type a b c", "no column x, y, z"),
        ("ITEM: ATOMS id", "ITEM: ATOMS id id", "values for"),
        ("ITEM: TIMESTEP\n0\n", "", "without a TIMESTEP"),
        ("ITEM: TIMESTEP", "TIMESTEP", "where a line ITEM"),
        ("BOX BOUNDS pp pp ff\n", "BOX BOUNDS xy xz yz pp pp ff\n0 4 0\n", "triclinic boxes are not read"),
    ],
)
def test_a_defect_of_a_dump_is_refused_in_one_line(old, new, message, tmp_path):
    path = write(run_of(PAIR), "dump", tmp_path)
    text = path.read_text("utf-8")
    assert old in text
    path.write_text(text.replace(old, new), "utf-8")
    assert message in refusal(PAIR, path)


def test_a_dump_that_was_cut_is_refused(tmp_path):
    path = write(run_of(PAIR), "dump", tmp_path)
    lines = path.read_text("utf-8").splitlines(keepends=True)
    for kept, message in (
        (-1, "the file ends within a section"),
        (-3, "before the atoms"),
        (-13, "lasts 5e-08 s"),
    ):
        path.write_text("".join(lines[:kept]), "utf-8")
        assert message in refusal(PAIR, path)


@pytest.mark.parametrize(
    "old, new, message",
    [
        ('file="particles_00000.vtu"', 'file="/etc/passwd"', "a file beside it or below"),
        ('file="particles_00000.vtu"', 'file="../mine.vtu"', "a file beside it or below"),
        ('file="particles_00000.vtu"', 'file="mine.pickle"', "files ending in .vtu or .vtk"),
        ('file="particles_00003.vtu"', 'file="gone.vtu"', "No such file"),
        ('file="particles_00003.vtu"', 'file="broken.vtu"', "broken.vtu: not read"),
        ("<VTKFile", "<!DOCTYPE a [<!ENTITY b 'c'>]><VTKFile", "document type"),
        ('timestep="0.0"', 'timestep="now"', "not a number"),
        ("</VTKFile>", "", "not a .pvd index"),
    ],
)
def test_a_defect_of_a_series_is_refused_in_one_line(old, new, message, tmp_path):
    path = write(run_of(PAIR), "pvd", tmp_path)
    (path.parent / "broken.vtu").write_text("<VTKFile>", "utf-8")
    text = path.read_text("utf-8")
    assert old in text
    path.write_text(text.replace(old, new), "utf-8")
    assert message in refusal(PAIR, path, Options("si", STEP, "0 s"))


def test_a_series_of_paraview_is_read_and_says_its_units(tmp_path):
    path = write(run_of(PAIR), "pvd", tmp_path)
    files = [
        f'{{"name": "particles_{k:05d}.vtu", "time": {t!r}}}'
        for k, t in enumerate(run_of(PAIR).times.tolist())
    ]
    series = path.with_name("mine.vtu.series")
    series.write_text(
        f'{{"file-series-version": "1.0", "units": "si", "files": [{", ".join(files)}]}}', "utf-8"
    )
    assert statuses(PAIR, series)["restitution"] == {"agree"}
    series.write_text('{"files": [1]}', "utf-8")
    assert "not a .series index" in refusal(PAIR, series)


@pytest.mark.parametrize("name", ["mine.pickle", "mine.npy", "mine"])
def test_an_unknown_ending_is_refused(name, tmp_path):
    (tmp_path / name).write_bytes(b"\x80\x04N.")
    assert "unknown ending" in refusal(PAIR, tmp_path / name)


@functools.cache
def texts() -> dict[str, bytes]:
    """Files to be spoilt."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        rows = "# units: si\n" + table(run_of(PAIR)).head(12).to_csv(index=False)
        dump = write(run_of(PAIR), "dump", Path(folder)).read_bytes()
        table(run_of(PAIR)).head(12).to_parquet(Path(folder) / "a.parquet")
        return {
            "csv": rows.encode(),
            "dump": dump[:1500],
            "parquet": (Path(folder) / "a.parquet").read_bytes(),
        }


@given(data=st.data(), form=st.sampled_from(["csv", "dump", "parquet", "pvd", "series"]))
@settings(max_examples=150, deadline=None)
def test_no_file_makes_anything_but_one_line(data, form, tmp_path_factory):
    raw = bytearray(texts().get(form, b""))
    if raw:
        for _ in range(data.draw(st.integers(1, 4))):
            at = data.draw(st.integers(0, len(raw) - 1))
            raw[at : at + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=3))
    else:
        raw = bytearray(data.draw(st.binary(max_size=200)))
    path = tmp_path_factory.mktemp("fuzz") / f"mine.{form}"
    path.write_bytes(bytes(raw))
    case = variant(PAIR)
    problem = ""
    try:
        compare_file(case, build_setup(case), path, Options("si"))
    except CaseError as refused:
        problem = str(refused)
    assert "\n" not in problem


def test_a_file_that_goes_a_step_beyond_the_end_is_taken(tmp_path):
    rows = table(run_of(PAIR))
    last = rows[rows.time == rows.time.max()].copy()
    last[["x", "y", "z"]] += last[["vx", "vy", "vz"]].to_numpy() * 2e-11
    last["time"] += 2e-11
    rows = pd.concat([rows[rows.time < rows.time.max()], last])
    assert set().union(*statuses(PAIR, csv(tmp_path, rows)).values()) == {"agree"}


def test_frames_are_read_without_a_case(tmp_path):
    found = read(csv(tmp_path, table(run_of(PAIR))))
    assert len(found.times) == len(found.frames) == len(run_of(PAIR).times)
    assert not isinstance(found, Columns)


# The command


@pytest.mark.parametrize(
    "entry, message",
    [
        ("drag_relaxation", "allowed: CASE=FILE"),
        ("swarm=mine.csv", "with a case that is compared: pair_head_on"),
        ("pair_head_on=mine.csv", "name one as in CASE/VARIANT=FILE; known: e0.2"),
        ("pair_head_on/e0.6=mine.csv", "did you mean 'e0."),
        ("pair_head_on/e0.5=gone.csv", "gone.csv: no such file"),
        ("pair_head_on/e0.5=mine.csv", "mine.csv: no rows"),
    ],
)
def test_what_the_command_refuses_is_one_line(entry, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.csv").write_text("", "utf-8")
    result = CliRunner().invoke(
        app, ["compare", "pair_head_on", "--engine", "reference", "--trajectory", entry]
    )
    assert (result.exit_code, result.stdout, len(result.stderr.splitlines())) == (2, "", 1)
    assert message in result.stderr


def test_the_command_reports_a_wrong_trajectory_and_keeps_it(tmp_path):
    path = csv(tmp_path, table(run_of(SLIP, 1.02, "dynamic_friction")))
    stated = ["--time-step", STEP, "--contact-duration", "0 s", "--jobs", "1", "--out", str(tmp_path / "out")]
    arguments = [
        "compare",
        "pair_slip",
        "--engine",
        "reference",
        "--trajectory",
        f"pair_slip={path}",
        *stated,
    ]
    assert CliRunner().invoke(app, arguments).exit_code == 1
    report = json.loads((tmp_path / "out" / "report.json").read_text("utf-8"))
    wrong = {row["quantity"] for row in report["comparisons"] if row["status"] == "disagree"}
    assert "friction_impulse" in wrong
    assert {row["engine"] for row in report["comparisons"] if row["status"] == "disagree"} == {"trajectory"}
    kept = Run.load(tmp_path / "out" / "data" / "pair_slip" / "trajectory")
    np.testing.assert_array_equal(kept.times, run_of(SLIP).times)
