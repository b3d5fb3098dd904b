"""Laws of drag.py: the regimes of the drag coefficient and their jumps, direction, invariance, the flows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rounding import ROUND, close, directions, repeatable, vectors
from scipy.spatial.transform import Rotation

from reference import drag, exact
from reference.state import FLOW_COUETTE, FLOW_NONE, FLOW_UNIFORM, Model

pytestmark = pytest.mark.nojit
WATER = (1000.0, 1e-3)  # kg/m3, Pa s
reynolds_numbers = st.floats(-6.0, 8.0).map(lambda power: 10.0**power)


@repeatable
@given(reynolds_numbers)
def test_the_coefficient_is_that_of_the_table(reynolds):
    close(drag.drag_coefficient(reynolds), exact.drag_coefficient(reynolds))


@pytest.mark.parametrize(
    "limit, below, above",
    [(1.0, 24.0, 24.0), (400.0, 0.50036, 0.5), (3e5, 0.5, 0.08034), (2e6, 0.18079, 0.18)],
)
def test_the_coefficient_jumps_where_the_table_does(limit, below, above):
    at, past = drag.drag_coefficient(limit), drag.drag_coefficient(limit * (1 + 1e-9))
    # values are given to five digits: half a unit of the last
    np.testing.assert_allclose([at, past], [below, above], rtol=0, atol=5e-6)


def test_the_coefficient_broadcasts():
    reynolds = np.array([[0.5, 1.0], [1e3, 1e7]])
    close(drag.drag_coefficient(reynolds), [[48.0, 24.0], [0.5, 0.18]])
    close(drag.drag_coefficient([0.5, 1000]), [48.0, 0.5])


@repeatable
@given(st.floats(-8.0, 0.0), directions)
def test_slow_drag_is_that_of_stokes(power, n):
    d, (rho, mu) = 1e-6, WATER
    slip = 10.0**power * mu / rho / d * (1 - 1e-9) * n  # Re <= 1
    tau = exact.stokes_time(1.0, d, mu)
    close(drag.drag_force(slip, np.zeros(3), d, rho, mu), slip / tau)


def test_without_slip_there_is_no_drag_at_all():
    v = np.array([0.1, 0.2, -0.3])
    assert np.all(drag.drag_force(v, v, 1e-6, *WATER) == 0.0)
    assert drag.drag_factor(0.0, 2.0, 1.0, 0.5) == 3 * np.pi


@pytest.mark.parametrize("reynolds", [1e-3, 0.99, 30.0, 1e4, 1e6, 1e8])
def test_the_force_balances_at_the_terminal_slip(reynolds):
    d, (rho, mu) = 1e-3, WATER
    slip = reynolds * mu / rho / d
    force = drag.drag_force([slip, 0, 0], [0, 0, 0], d, rho, mu)[0]
    assert any(abs(found / slip - 1) < ROUND for found in exact.terminal_slips(force, d, rho, mu))
    # the twin: the dynamic pressure without its 1/2 balances at another slip
    assert all(abs(found / slip - 1) > 0.1 for found in exact.terminal_slips(2 * force, d, rho, mu)[:1])


@repeatable
@given(vectors, vectors, vectors, directions, reynolds_numbers)
def test_drag_is_galilean_invariant_and_turns_with_the_slip(u, v, drift, axis, size):
    d, (rho, mu) = 1e-3, WATER
    u, v = size * mu / rho / d * u, size * mu / rho / d * v
    force = drag.drag_force(u, v, d, rho, mu)
    scale = np.linalg.norm(force)
    assert force @ (u - v) >= 0  # drag never accelerates the slip
    np.testing.assert_array_equal(drag.drag_force(v, u, d, rho, mu), -force)
    speed, fast = np.linalg.norm(u - v), max(np.linalg.norm(u), np.linalg.norm(v))
    if speed < 1e-3 * fast:
        return  # the slip would be round-off
    if any(abs(rho * speed * d / mu / limit - 1) < 1e-6 for limit in (1.0, 400.0, 3e5, 2e6)):
        return  # round-off decides the side of a jump
    turn = Rotation.from_rotvec(2 * axis)
    # round-off of the velocities relative to the slip is up to 1e-13; drag grows at most as its 2.43rd power
    close(drag.drag_force(turn.apply(u), turn.apply(v), d, rho, mu), turn.apply(force), scale=10 * scale)
    close(drag.drag_force(u + fast * drift, v + fast * drift, d, rho, mu), force, scale=10 * scale)


@repeatable
@given(reynolds_numbers, st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_the_dimensionless_force_depends_on_reynolds_alone(reynolds, size, thick):
    if any(abs(reynolds / limit - 1) < 1e-6 for limit in (1.0, 400.0, 3e5, 2e6)):
        return
    rho, mu, d = 1000.0, 1e-3 * 10.0**thick, 1e-3 * 10.0**size
    force = drag.drag_force([reynolds * mu / rho / d, 0, 0], [0, 0, 0], d, rho, mu)[0]
    close(force * rho / mu**2, drag.drag_force([reynolds, 0, 0], [0, 0, 0], 1.0, 1.0, 1.0)[0])
    close(force * rho / mu**2, exact.drag_coefficient(reynolds) * np.pi / 8 * reynolds**2)


def test_drag_broadcasts_over_particles():
    u = np.array([1e-3, 0, 0])
    v = np.array([[0.0, 0, 0], [1e-3, 0, 0], [0, 2e-3, 0]])
    d = np.array([1e-6, 1e-6, 2e-6])
    many = drag.drag_force(u, v, d, *WATER)
    assert many.shape == (3, 3)
    close(many, [drag.drag_force(u, v[k], d[k], *WATER) for k in range(3)])


def test_the_factor_times_the_slip_is_the_force():
    for slip in (1e-5, 0.01, 1.0, 300.0, 4000.0):
        factor = drag.drag_factor(slip, 1e-3, *WATER)
        close(factor * slip, drag.drag_force([0, slip, 0], [0, 0, 0], 1e-3, *WATER)[1])


def model(**changes):
    numbers = dict.fromkeys(Model._fields, 0.0)
    flags = {"flow": FLOW_NONE, "deposit": 0, "has_surface": False, "mass_pickup": False, "has_pad": False}
    return Model(**{**numbers, **flags, **changes})


def test_the_known_flows():
    uniform = model(flow=FLOW_UNIFORM, flow_x=1.0, flow_y=2.0, flow_z=3.0)
    assert drag.fluid_velocity(uniform, np.nan, 0.4) == (1.0, 2.0, 3.0)
    couette = model(flow=FLOW_COUETTE, wall_speed=2.0, gap=4.0)
    assert drag.fluid_velocity(couette, np.nan, 1.0) == (0.5, 0.0, 0.0)
    assert drag.fluid_velocity(couette, np.nan, 4.0) == (2.0, 0.0, 0.0)
    under_pad = couette._replace(has_pad=True)
    assert drag.fluid_velocity(under_pad, 2.0, 1.0) == (1.0, 0.0, 0.0)
    assert drag.fluid_velocity(model(), np.nan, 1.0) == (0.0, 0.0, 0.0)


def test_a_particle_that_drifts_with_the_shear_feels_nothing():
    couette = model(flow=FLOW_COUETTE, wall_speed=2.0, gap=4e-6)
    u = drag.fluid_velocity(couette, np.nan, 1.7e-6)
    end = exact.couette_motion([1.0], [0, 0, 1.7e-6], [0, 0, 0], 2.0, 4e-6, 1e-7)
    close(end.velocities[0], u, scale=1.0)
    assert np.all(drag.drag_force(u, u, 1e-6, *WATER) == 0.0)


def test_the_coefficient_is_called_by_the_name_of_its_argument():
    assert drag.drag_coefficient(reynolds=1000.0) == 0.5
