"""Laws of the observer of native wall contacts: it reports the impulse that acted and the removal of the
approach speed, and never skips a contact.  A spring that stands for the engine is integrated here."""

from __future__ import annotations

import numpy as np
import pytest

from cmpcheck.fixes.layout import FREE, PHASE
from cmpcheck.fixes.memory import Memory
from cmpcheck.fixes.native import WALL_COLUMNS, look, plan_steps
from reference import exact
from reference.case import load_case
from reference.process import build_setup

pytestmark = pytest.mark.nojit
UNITS = np.ones(4)  # the engine here counts in SI
DT, OMEGA = 2e-12, 2e9  # s, 1/s: a contact of 1.6 ns


class Spring:
    """A sphere and a wall at z = 0 that pushes with m w^2 x and no damping, by velocity Verlet."""

    def __init__(self, variant="pickup", speed=1.0):
        case = next(c for c in load_case("wall_bounce").variants() if c.variant == variant)
        self.setup = build_setup(case)
        state, n = self.setup.state, 1
        self.memory = Memory(
            self.setup.model, state.modulus, state.heights, "observe", 1e-9, 0, 100, 0, False, np.nan, 0.0
        )
        self.memory.context.time_step = DT
        self.radius = state.diameter / 2
        self.x, self.v = state.position.copy(), np.array([[0.3, 0.0, -speed]])
        self.x[0, 2] = self.radius[0] + 0.101e-9  # half a step deep when it is noticed
        self.mass, self.tags = state.mass.copy(), np.arange(1, n + 1, dtype=np.int32)
        self.contacts, self.step, self.pushed = np.zeros((n, WALL_COLUMNS)), 0, 0.0
        self.force = self.wall_force()

    def wall_force(self):
        overlap = max(self.radius[0] - self.x[0, 2], 0.0)
        return np.array([[0.0, 0.0, self.mass[0] * OMEGA**2 * overlap]])

    def look(self):
        m = self.memory
        failed = look(
            m.context, self.step, UNITS, self.tags, self.x, self.v, self.force, self.force, self.radius,
            self.mass, m.by_tag, m.modulus, m.heights, self.contacts, m.rows, m.position, m.pairs, m.listed,
            m.open_pairs, m.samples,
        )  # fmt: skip
        assert not failed

    def advance(self):
        self.v += 0.5 * DT * self.force / self.mass[0]
        self.x += DT * self.v
        self.force = self.wall_force()
        self.v += 0.5 * DT * self.force / self.mass[0]
        self.pushed += self.force[0, 2] * DT
        self.step += 1
        self.look()

    def until_free(self):
        """Steps through one contact; the ledger's row of it."""
        self.look()
        while self.contacts[0, PHASE] == FREE:
            self.advance()
        while self.contacts[0, PHASE] != FREE:
            self.advance()
        (row,) = self.memory.contacts().itertuples()
        return row


def test_the_impulse_is_the_sum_of_the_forces_and_the_change_of_momentum():
    spring = Spring("no_pickup")
    before = spring.mass[0] * spring.v[0, 2]
    row = spring.until_free()
    # forces are summed in another order: one rounding for each of some 800 steps
    assert row.normal_impulse == pytest.approx(spring.pushed, rel=1e-12, abs=0)
    assert row.normal_impulse == pytest.approx(spring.mass[0] * spring.v[0, 2] - before, rel=1e-12, abs=0)
    assert row.friction_impulse == pytest.approx(0.0, abs=1e-7 * row.normal_impulse)  # root of a difference
    assert row.contact_time == pytest.approx(np.pi / OMEGA, abs=2 * DT, rel=0)


def test_what_is_removed_is_that_of_the_approach_speed():
    spring = Spring("pickup")
    row = spring.until_free()
    model, state = spring.setup.model, spring.setup.state
    assert row.approach_speed == pytest.approx(1.0, rel=1e-12, abs=0)
    from cmpcheck.judges.wall import wall_of

    hit = exact.removing_impact(
        state.mass[0], spring.radius[0], [0.3, 0.0, -1.0], [0.0, 0.0, 1.0], wall_of(spring.setup)
    )
    assert row.removed_volume == pytest.approx(hit.removal.volume, rel=1e-10, abs=0)
    lost = float((state.heights - spring.memory.heights).sum()) * model.spacing**2
    # the heights fall from 0: the loss has the rounding of three products
    assert lost == pytest.approx(hit.removal.volume, rel=1e-12, abs=0)


def test_what_is_picked_up_dilutes_the_velocity():
    spring = Spring("pickup")
    start = spring.mass[0]
    row = spring.until_free()
    assert spring.mass[0] - start == pytest.approx(row.removed_mass, rel=1e-9, abs=0)  # 1e-3 of the mass
    assert spring.mass[0] * spring.v[0, 0] == pytest.approx(0.3 * start, rel=1e-12, abs=0)  # Eq 24


@pytest.mark.parametrize("gap", [0.0, 1e-9, 20e-9, 80e-9, 1e-6])
def test_no_contact_begins_within_the_steps_that_are_skipped(gap):
    spring = Spring()
    spring.x[0, 2] = spring.radius[0] + gap
    spring.look()
    m = spring.memory
    steps, stale = plan_steps(m.context, m.by_tag, m.heights, spring.contacts, m.heights)
    assert not stale
    assert steps >= 1
    speed = float(np.linalg.norm(spring.v))
    assert steps == 1 or steps * DT * speed <= gap
    if 1e-9 < gap < 0.2 * spring.radius[0]:
        assert steps * DT * speed > 0.9 * gap  # and most of the way is skipped


def test_the_engine_reads_the_surface_again_only_where_a_particle_may_touch_it():
    spring = Spring()
    spring.x[0, 2] = spring.radius[0] + DT * 1.0  # one step to go
    spring.look()
    m = spring.memory
    known, lowered = m.heights.copy(), m.heights.copy()
    i, j = (round(c / spring.setup.model.spacing) for c in spring.x[0, :2])
    lowered[i, j] -= 1e-9
    assert plan_steps(m.context, m.by_tag, known, spring.contacts, lowered)[1]
    far = known.copy()
    far[(i + 4) % len(far), (j + 4) % len(far)] -= 1e-9
    assert not plan_steps(m.context, m.by_tag, known, spring.contacts, far)[1]
    spring.v[0, 2] = 1.0  # on its way up
    spring.look()
    assert not plan_steps(m.context, m.by_tag, known, spring.contacts, lowered)[1]
