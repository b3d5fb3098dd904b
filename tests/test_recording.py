"""Laws of recording.py and of the record of a run: whole, reproducible, and plain about failure."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import h5py
import numba
import numpy as np
import pytest
from rounding import close

from reference import recording, simulation
from reference.case import Case, CaseError, load_case
from reference.ledger import COLUMNS
from reference.recording import HISTORY, Run
from reference.simulation import SimulationError, simulate

pytestmark = pytest.mark.nojit
ARRAYS = ("times", "positions", "velocities", "masses", "diameters")
FILES = ("case.toml", "trajectory.h5", "contacts.parquet", "history.parquet", "provenance.json")


def variant(name, k=0, **sections):
    """Variant k of a case that ships, with keys of its sections replaced."""
    case = load_case(name).variants()[k]
    parts = {key: getattr(case, key).model_copy(update=values) for key, values in sections.items()}
    return case.model_copy(update=parts)


def diverging():
    """Two particles, of which the second is so fast that its Reynolds number overflows."""
    raw = load_case("drag_relaxation").model_dump(by_alias=True, exclude_none=True)
    calm = raw["particle"][0]
    return Case.model_validate(
        raw | {"particle": [calm, calm | {"position": [3e-6, 3e-6, 3e-6], "velocity": [1e200, 0.0, 0.0]}]}
    )


@pytest.fixture(scope="module")
def impact():
    return simulate(variant("asperity_bounce", 4))


def test_a_run_is_loaded_as_it_was_saved(tmp_path, impact):
    folder = impact.save(tmp_path / "deep" / "run")
    again = Run.load(folder)
    assert sorted(os.listdir(folder)) == sorted(FILES)
    for name in ARRAYS:
        assert getattr(again, name).tobytes() == getattr(impact, name).tobytes()
    assert again.contacts.equals(impact.contacts)
    assert again.history.equals(impact.history)
    assert again.case == impact.case
    assert again.provenance == impact.provenance
    for name in ("surface_initial", "surface"):
        assert np.array_equal(getattr(again, name).z, getattr(impact, name).z)
        assert getattr(again, name).spacing == getattr(impact, name).spacing
    assert not np.array_equal(again.surface.z, again.surface_initial.z)


def test_a_run_without_surface_and_contacts_is_loaded_too(tmp_path):
    run = simulate(variant("drag_relaxation"), tmp_path / "run")
    again = Run.load(tmp_path / "run")
    assert again.surface is again.surface_initial is None
    assert len(again.contacts) == 0
    assert again.contacts.dtypes.equals(run.contacts.dtypes)
    assert again.history["flatness"].isna().all()


def test_the_record_has_the_columns_and_times_that_were_promised(impact):
    case = impact.case
    n, t = len(case.particle), case.case.outputs
    assert tuple(impact.contacts.columns) == tuple(COLUMNS)
    assert set(HISTORY) <= set(impact.history.columns)
    assert impact.positions.shape == impact.velocities.shape == (t, n, 3)
    assert impact.masses.shape == (t, n)
    close(impact.times, np.linspace(0, case.case.duration, t), scale=case.case.duration)
    assert np.array_equal(impact.history["time"], impact.times)
    assert impact.contacts["kind"].tolist() == ["surface", "surface"]
    assert impact.contacts["time"].is_monotonic_increasing
    # in the history: what the state says, and sums over the ledger until then
    close(impact.history["kinetic_energy"], 0.5 * (impact.masses * (impact.velocities**2).sum(-1)).sum(-1))
    close(impact.history["momentum_z"], (impact.masses * impact.velocities[..., 2]).sum(-1))
    for column in ("removed_volume", "removed_mass"):
        expected = [
            impact.contacts[column][impact.contacts["time"] < now * (1 - 1e-9)].sum() for now in impact.times
        ]
        close(impact.history[column], expected)
    assert impact.provenance["complete"] is True
    assert impact.provenance["seed"] == case.case.seed
    assert impact.provenance["steps"] == round(case.case.duration / case.numerics.time_step)


def test_slow_contacts_are_counted_but_not_kept_in_the_ledger():
    """All the sums stay; the rows that remove nothing and are slower than `ledger_speed` go."""
    every = simulate(variant("bounce_train"))
    few = simulate(variant("bounce_train", numerics={"ledger_speed": 0.1}))
    slow = (every.contacts["approach_speed"] < 0.1) & (every.contacts["removed_volume"] == 0)
    none = simulate(
        variant("bounce_train", removal={"threshold_velocity": 9.0}, numerics={"ledger_speed": 9.0})
    )
    kept = every.contacts[~slow].reset_index(drop=True)
    assert few.contacts.equals(kept)
    assert few.history.equals(every.history)
    assert none.contacts.empty
    assert none.history["contacts"].iloc[-1] == every.history["contacts"].iloc[-1] == len(every.contacts)


def test_a_state_that_is_not_finite_names_particle_and_time_and_keeps_the_record(tmp_path):
    case = diverging()
    with np.errstate(all="ignore"), pytest.raises(SimulationError) as stopped:
        simulate(case, tmp_path / "run")
    assert "not finite: particle 1 at t = 0 s" in str(stopped.value)
    assert "\n" not in str(stopped.value)
    kept = Run.load(tmp_path / "run")
    assert kept.provenance["complete"] is False
    assert len(kept.times) == len(stopped.value.run.times) >= 1
    assert np.isfinite(kept.positions).all()


def test_what_was_recorded_before_the_end_is_kept(tmp_path, monkeypatch):
    """The third interval fails: two are kept, and the moment of failure.  The first call compiles."""
    advance, calls = simulation.advance, []

    def failing(model, numerics, scalars, *rest):
        calls.append(scalars[simulation.P.time])
        scalars[simulation.P.culprit] = 0
        return simulation.NOT_FINITE if len(calls) == 4 else advance(model, numerics, scalars, *rest)

    monkeypatch.setattr(simulation, "advance", failing)
    with pytest.raises(SimulationError, match=f"particle 0 at t = {0.9e-6 * 2 / 75:.6g} s"):
        simulate(variant("drag_relaxation"), tmp_path / "run")
    kept = Run.load(tmp_path / "run")
    assert kept.provenance["complete"] is False
    close(kept.times, np.array([0, 1, 2, 2]) * 0.9e-6 / 75, scale=0.9e-6)


def test_an_interrupted_run_keeps_its_record(tmp_path):
    def interrupt(done):
        if done > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(variant("drag_relaxation"), tmp_path / "run", progress=interrupt)
    kept = Run.load(tmp_path / "run")
    assert kept.provenance["complete"] is False
    assert 0.5 < kept.times[-1] / 0.9e-6 < 0.6


@pytest.mark.parametrize("missing", ["folder", "all", *FILES])
def test_a_folder_that_is_no_run_is_refused_in_one_line(tmp_path, impact, missing):
    folder = tmp_path / "run"
    if missing == "all":
        folder.mkdir()
    elif missing != "folder":
        impact.save(folder)
        (folder / missing).unlink()
    with pytest.raises(CaseError, match="run") as refused:
        Run.load(folder)
    assert "\n" not in str(refused.value)
    assert str(folder) in str(refused.value)


@pytest.mark.parametrize("file", [name for name in FILES if name != "case.toml"])
def test_a_damaged_file_is_refused_in_one_line(tmp_path, impact, file):
    folder = impact.save(tmp_path / "run")
    (folder / file).write_bytes((folder / file).read_bytes()[:40])
    with pytest.raises(CaseError, match="run") as refused:
        Run.load(folder)
    assert "\n" not in str(refused.value)


def test_a_trajectory_without_velocities_is_refused(tmp_path, impact):
    folder = impact.save(tmp_path / "run")
    with h5py.File(folder / "trajectory.h5", "a") as file:
        del file["velocities"]
    with pytest.raises(CaseError, match="not a run folder"):
        Run.load(folder)


@pytest.mark.parametrize("before", [False, True])
def test_a_folder_half_written_is_not_complete(tmp_path, impact, monkeypatch, before):
    """provenance.json is written last; and what an earlier run said there is not said of the new one."""
    folder = tmp_path / "run"
    if before:
        impact.save(folder)

    def full(path, pieces):
        raise OSError(28, "no space left")

    monkeypatch.setattr(recording, "_write_ledger", full)
    with pytest.raises(OSError, match=r"(?i)no space left"):
        impact.save(folder)
    assert (folder / "trajectory.h5").exists()
    assert not (folder / "contacts.parquet").exists() or before
    path = folder / "provenance.json"
    assert not path.exists() or not json.loads(path.read_text())["complete"]


@pytest.mark.parametrize("name, k", [("asperity_bounce", 4), ("pair_slip", 0)])
def test_the_same_case_and_seed_give_the_same_bytes(tmp_path, name, k):
    for folder in ("one", "two"):
        simulate(variant(name, k), tmp_path / folder)
    for file in FILES[:-1]:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes(), file
    one, two = (Run.load(tmp_path / folder).provenance for folder in ("one", "two"))
    assert one.pop("timing")["wall_time"] != two.pop("timing")["wall_time"]
    assert one == two
    other = simulate(variant("asperity_bounce", 4, case={"seed": 2}))
    assert not np.array_equal(other.positions, Run.load(tmp_path / "one").positions)


@pytest.mark.parametrize("scheme", ["point_implicit", "fixed_point"])
def test_the_size_of_the_ledger_buffer_does_not_matter(monkeypatch, scheme):
    """With room for one row the kernel stops and starts again, which rounds the length of its steps anew."""
    case = variant("bounce_train", numerics={"scheme": scheme})
    one = simulate(case)
    monkeypatch.setattr(simulation, "LEDGER_ROWS", 1)
    two = simulate(case)
    assert len(one.contacts) >= 4
    assert one.contacts["kind"].tolist() == two.contacts["kind"].tolist()
    assert one.provenance["steps"] == two.provenance["steps"]
    # four bounces under drag, each of which amplifies round-off by less than 10
    close(two.contacts.drop(columns="kind"), one.contacts.drop(columns="kind"), scale=0, rtol=1e-9)
    close(two.velocities, one.velocities, scale=100.0)


PAIR = ("pair_slip", 0, {"contact": {"impact_duration": 3e-9}})
EXACT = pytest.param("drag_relaxation", 0, {}, 0.0, id="drag"), pytest.param(*PAIR, 0.0, id="pair")
POWERS = (
    pytest.param("asperity_bounce", 4, {}, 1e-13, id="surface"),
    pytest.param("pair_slip", 0, {}, 1e-13, id="hertz"),
)


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="compares compiled code with this")
@pytest.mark.parametrize("name, k, sections, rtol", [*EXACT, *POWERS])
def test_compiled_and_plain_python_agree(tmp_path, name, k, sections, rtol):
    """To the bit where only + - * / sqrt occur: Stokes's drag, pairs of constant duration; else to 1e-13."""
    case = variant(name, k, **sections)
    case.save(tmp_path / "case.toml")
    code = "import reference; reference.simulate(reference.load_case('case.toml'), 'plain')"
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path, env=environment, timeout=120)
    plain, compiled = Run.load(tmp_path / "plain"), simulate(case)
    for key in ("times", "positions", "velocities", "masses"):
        np.testing.assert_allclose(
            getattr(plain, key), getattr(compiled, key), rtol=rtol, atol=0, err_msg=key
        )
    numbers = [run.contacts.drop(columns="kind") for run in (plain, compiled)]
    # what an impact loses is a difference of energies that are 1/(1 - e^2) larger
    np.testing.assert_allclose(*numbers, rtol=10 * rtol, atol=0)
    assert len(compiled.contacts) == {"drag_relaxation": 0, "pair_slip": 1, "asperity_bounce": 2}[name]
