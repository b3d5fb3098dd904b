"""How long swarms can be compared contact by contact, and what gives an erroneous engine away until then.

Ledgers made by hand show what counts as the same, a small swarm which errors are noticed.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from cmpcheck.compare import compare_study, limits
from cmpcheck.engines.protocol import Resolution
from cmpcheck.engines.reference import ReferenceEngine
from cmpcheck.horizon import FEWEST_CONTACTS, Parting, compare_ledgers, first_parting, study_horizon
from cmpcheck.judges import Judge, judge_of
from cmpcheck.results import Comparison
from cmpcheck.study import Level, Study, align_outputs, engine_study, reference_study
from reference.case import CASES, load_case
from reference.process import build_setup
from reference.recording import Run
from reference.state import Setup

NEVER = Parting(math.inf)
CHAIN = [(1.0, 0, 1), (2.0, 1, 2), (3.0, 3, 4), (4.0, 0, 1)]
EPS = float(np.finfo(float).eps)


def ledger(*contacts: tuple[float, int, int], impulse: float = 1.0) -> pd.DataFrame:
    """Contacts (time, i, j)."""
    rows = pd.DataFrame(list(contacts), columns=["time", "i", "j"])
    return rows.assign(normal_impulse=impulse, friction_impulse=0.5 * impulse)


def parting(one: pd.DataFrame, other: pd.DataFrame) -> Parting:
    """The parting of two ledgers, which must not depend on which is named first."""
    runs = SimpleNamespace(contacts=one), SimpleNamespace(contacts=other)
    found = first_parting(*runs)
    assert first_parting(*reversed(runs)) == found
    return found


def test_equal_partners_in_equal_order_never_part_whatever_the_times_and_rows():
    assert parting(ledger(*CHAIN), ledger(*CHAIN)) == NEVER
    later = [(time + 0.1 * k, i, j) for k, (time, i, j) in enumerate(CHAIN)]
    assert parting(ledger(*CHAIN), ledger(*later)) == NEVER
    turned = [(time, j, i) for time, i, j in reversed(CHAIN)]
    assert parting(ledger(*CHAIN), ledger(*turned)) == NEVER
    assert parting(ledger(), ledger()) == NEVER


def test_contacts_that_share_no_particle_may_swap():
    assert parting(ledger(*CHAIN), ledger((1.0, 0, 1), (3.0, 1, 2), (2.0, 3, 4), (4.0, 0, 1))) == NEVER


def test_contacts_that_share_a_particle_may_not_swap():
    swapped = ledger((2.0, 0, 1), (1.0, 1, 2), (3.0, 3, 4), (4.0, 0, 1))
    assert parting(ledger(*CHAIN), swapped).time == 1.0


@pytest.mark.parametrize("missing", range(len(CHAIN)))
def test_runs_part_at_the_contact_that_only_one_of_them_has(missing):
    rest = [contact for k, contact in enumerate(CHAIN) if k != missing]
    time, i, j = CHAIN[missing]
    found = parting(ledger(*CHAIN), ledger(*rest))
    assert (found.time, {found.i, found.j}) == (time, {i, j})


def test_the_first_of_several_partings_counts():
    assert parting(ledger(*CHAIN), ledger(CHAIN[0], CHAIN[3])).time == 2.0
    assert parting(ledger(*CHAIN), ledger()).time == 1.0


# The comparison of two ledgers

OUTPUTS = np.linspace(0.0, 100.0, 11)
ROW = [(5.0 * k + 2.0, k, k + 1) for k in range(FEWEST_CONTACTS + 5)]


def made(engine: str, contacts: pd.DataFrame, offset: float = 0.0) -> Study:
    """A study of three equal levels: particles move along x at unit speed, `offset` from their place."""
    model = SimpleNamespace(length_x=0.0, length_y=0.0, length_z=0.0)
    start = np.zeros((20, 3))
    setup = SimpleNamespace(model=model, state=SimpleNamespace(position=start))
    path = start + OUTPUTS[:, np.newaxis, np.newaxis] * [1.0, 0.0, 0.0] + offset
    masses, velocities = np.ones(path.shape[:2]), np.ones(path.shape) * [1.0, 0.0, 0.0]
    run = SimpleNamespace(
        times=OUTPUTS, contacts=contacts, positions=path, masses=masses, velocities=velocities
    )
    return Study(
        engine, "", {"time step": [Level(setup, Resolution(step), run, []) for step in (4.0, 2.0, 1.0)]}
    )


def compared(one: Study, other: Study, *horizons: Parting) -> tuple[Comparison, str]:
    ours, theirs = horizons or (NEVER, NEVER)
    return compare_ledgers(load_case("swarm"), (one, ours), (other, theirs))


def added(study: Study) -> dict[str, tuple[str, float]]:
    return {m.quantity: (m.place, float(m.values[0])) for m in study.finest.measured}


def test_equal_ledgers_agree_and_count_every_contact():
    row, note = compared(made("reference", ledger(*ROW)), made("lammps", ledger(*ROW)))
    assert (row.quantity, row.engine, row.status) == ("contact_order", "lammps", "agree")
    assert (row.reference, row.measured, row.error) == (15.0, 15.0, 0.0)
    assert note.count("never part") == 2


def test_an_engine_that_parts_before_the_horizon_disagrees_and_the_contact_is_named():
    row, _ = compared(made("reference", ledger(*ROW)), made("lammps", ledger(*ROW[:12], *ROW[13:])))
    assert (row.status, row.reference, row.measured, row.error) == ("disagree", 15.0, 12.0, 3.0)
    assert "part at 62000000000.0 ns, at the contact of 12 and 13" in row.reason


def test_what_happens_after_the_horizon_is_not_compared():
    wild = pd.concat([ledger(*ROW[:12]), ledger((62.0, 0, 9), impulse=99.0)])
    for horizons in ((Parting(60.0, 3, 4), NEVER), (NEVER, Parting(60.0, 3, 4))):
        ours, theirs = made("reference", ledger(*ROW)), made("lammps", wild)
        row, note = compared(ours, theirs, *horizons)
        assert (row.status, row.reference, row.measured) == ("agree", 12.0, 12.0)
        assert note.count("own runs part at") == 1
        for study in (ours, theirs):
            assert added(study)["normal_impulse"] == ("mean of 12 contacts", 1.0)
            assert added(study)["friction_impulse"] == ("mean of 12 contacts", 0.5)


def test_too_few_contacts_before_the_horizon_are_no_test():
    horizon = Parting(ROW[FEWEST_CONTACTS - 1][0], 0, 1)  # one contact fewer
    ours, theirs = made("reference", ledger(*ROW)), made("lammps", ledger(*ROW))
    row, _ = compared(ours, theirs, horizon, NEVER)
    assert (row.status, row.reference) == ("not_tested", FEWEST_CONTACTS - 1.0)
    assert "normal_impulse" not in added(ours)


def test_impulses_that_an_engine_could_not_measure_are_left_out_on_every_level():
    rows = ledger(*ROW)
    rows.loc[3, "normal_impulse"] = math.nan
    ours, theirs = made("reference", ledger(*ROW)), made("lammps", rows)
    compared(ours, theirs)
    assert {added(study)["normal_impulse"] for study in (ours, theirs)} == {("mean of 14 contacts", 1.0)}


def test_distances_are_those_at_the_last_output_before_the_horizon():
    ours, theirs = made("reference", ledger(*ROW)), made("lammps", ledger(*ROW), offset=0.3)
    compared(ours, theirs, Parting(65.0, 0, 1), NEVER)
    place, value = added(theirs)["trajectory_distance"]
    assert place == "at 60000000000 ns"
    assert value == pytest.approx(0.3 * math.sqrt(3.0), rel=100 * EPS, abs=0.0)  # of coordinates up to 60
    assert "trajectory_distance" not in added(ours)


# A swarm of 60 spheres, 51 contacts in 1 us

Change = Callable[[Setup], Setup]
Spoil = Callable[[Run], Run]


def swarm_setup(folder: Path, *changes: tuple[str, str]) -> Setup:
    text = (CASES / "swarm.toml").read_text("utf-8")
    for old, new in (("count = 200", "count = 60"), ('"8 um"', '"5.4 um"'), *changes):
        assert old in text
        text = text.replace(old, new)
    path = folder / "mine.toml"
    path.write_text(text, "utf-8")
    return align_outputs(build_setup(load_case(path)))


@dataclass(frozen=True)
class Fake:
    """The reference under another engine's name, with a fault in what it is given or in what it returns."""

    change: Change = lambda setup: setup
    spoil: Spoil = lambda run: run
    name = "lammps"

    def run(self, setup: Setup, resolution: Resolution) -> Run:
        run = ReferenceEngine().run(self.change(setup), resolution)
        return self.spoil(replace(run, provenance=run.provenance | {"engine": self.name}))


def swarm_of(folder: Path, seed: int) -> tuple[Setup, Judge, Study, Parting]:
    """Setup, judge, study of the reference, and its horizon."""
    table = ('contact_duration = "4 ns"', 'contact_duration = "8 ns"'), ("contact = 50", "contact = 8")
    setup = swarm_setup(folder, ("seed = 1", f"seed = {seed}"), ('"1 ns"', '"2 ns"'), *table)
    judge, engine = judge_of(setup), ReferenceEngine()
    study = reference_study(engine, judge, setup, "quick")
    return setup, judge, study, study_horizon(engine, study)


@pytest.fixture(scope="module")
def swarm(tmp_path_factory) -> tuple[Setup, Judge, Study, Parting]:
    return swarm_of(tmp_path_factory.mktemp("swarm"), seed=1)


def rows_of(swarm: tuple[Setup, Judge, Study, Parting], engine: Fake) -> list[Comparison]:
    setup, judge, study, horizon = swarm
    ours, theirs = copy.deepcopy(study), engine_study(engine, judge, setup, "quick", "native")
    row, _ = compare_ledgers(setup.case, (ours, horizon), (theirs, study_horizon(engine, theirs)))
    return [row, *compare_study(setup.case, theirs, limits(ours))]


def model(**factors: float) -> Change:
    def change(setup: Setup) -> Setup:
        wrong = {name: factor * getattr(setup.model, name) for name, factor in factors.items()}
        return replace(setup, model=setup.model._replace(**wrong))

    return change


def contacts(change: Callable[[pd.DataFrame], pd.DataFrame]) -> Spoil:
    """A wrong ledger; its rows are given in order of time."""
    return lambda run: replace(run, contacts=change(run.contacts.sort_values("time", ignore_index=True)))


def scaled(factor: float, particles: slice = slice(None), output: int = -1) -> Spoil:
    """Wrong velocities of some particles at one output."""

    def spoil(run: Run) -> Run:
        velocities = run.velocities.copy()
        velocities[output, particles] *= factor
        return replace(run, velocities=velocities)

    return spoil


def exchange(rows: pd.DataFrame) -> pd.DataFrame:
    """The first two contacts that share a particle change places."""
    met = rows[["i", "j"]].to_numpy()
    a, b = next((a, b) for b in range(len(met)) for a in range(b) if set(met[a]) & set(met[b]))
    time = rows["time"].to_numpy().copy()
    time[[a, b]] = time[[b, a]]
    return rows.assign(time=time)


RUBBED = {"friction_impulse", "trajectory_distance"}
IMPULSES = {"normal_impulse", *RUBBED}
FREE = {"momentum", "free_flight"}
MU = ("static_friction", "dynamic_friction")


def test_the_reference_as_an_engine_agrees_with_itself(swarm):
    rows = rows_of(swarm, Fake())
    assert {row.status for row in rows} == {"agree"}
    assert {row.quantity for row in rows} == {"contact_order", "energy_lost", *FREE, *IMPULSES}
    assert rows[0].reference > 2 * FEWEST_CONTACTS


@pytest.mark.parametrize("seed", [8, 13])
def test_the_reference_as_an_engine_agrees_with_itself_for_other_seeds(seed, tmp_path):
    assert {row.status for row in rows_of(swarm_of(tmp_path, seed), Fake())} == {"agree"}


@pytest.mark.parametrize(
    "engine, quantities",
    [
        pytest.param(Fake(model(restitution=1.005)), IMPULSES, id="restitution + 0.5 %"),
        pytest.param(Fake(model(**dict.fromkeys(MU, 1.01))), RUBBED, id="friction + 1 %"),
        pytest.param(Fake(model(dynamic_friction=-1.0)), {"contact_order", *RUBBED}, id="friction drives"),
        pytest.param(Fake(spoil=contacts(lambda rows: rows.drop(index=30))), {"contact_order"}, id="dropped"),
        pytest.param(Fake(spoil=contacts(exchange)), {"contact_order"}, id="order"),
        pytest.param(Fake(spoil=scaled(1 + 1e-8, slice(1))), {"momentum"}, id="momentum leaks"),
        pytest.param(Fake(spoil=scaled(0.99)), FREE, id="energy leaks after the last contact"),
        pytest.param(Fake(spoil=scaled(1 + 1e-9, slice(1), 50)), {"free_flight"}, id="a velocity drifts"),
    ],
)
def test_an_erroneous_engine_is_noticed_by(engine, quantities, swarm):
    assert {row.quantity for row in rows_of(swarm, engine) if row.status == "disagree"} >= quantities


@pytest.mark.parametrize("spoil, balanced", [(lambda run: run, True), (scaled(1 + 1e-8), False)])
def test_the_reference_accounts_for_its_energy_contact_by_contact(spoil, balanced, swarm):
    judge, level = swarm[1], swarm[2].finest
    energy = next(m for m in judge.measure(level.setup, spoil(level.run)) if m.quantity == "energy_balance")
    assert (abs(energy.values[0]) <= energy.rounding) == balanced


def test_a_twin_one_unit_in_the_last_place_away_measures_the_horizon(tmp_path):
    """Without dissipation 70 collisions of each particle amplify 1e-16; with none of them nothing parts."""
    elastic = ("restitution = 0.9", "restitution = 1"), ("friction = 0.3", "friction = 0")
    setup = swarm_setup(tmp_path, ('duration = "1 us"', 'duration = "40 us"'), ('"1 ns"', '"8 ns"'), *elastic)
    engine, resolution = ReferenceEngine(), Resolution(8e-9)
    level = Level(setup, resolution, engine.run(setup, resolution), [])
    horizon = study_horizon(engine, Study("reference", "", {"time step": [level]}))
    assert 0.0 < horizon.time < setup.end_time
    rows = level.run.contacts
    assert (rows["time"] < horizon.time).sum() > 5 * 60  # ten collisions of each of the 60, and more
    assert first_parting(level.run, engine.run(setup, resolution)) == NEVER
