"""Drag, shear and the bounce train of reference.exact, checked by matrix exponentials, closed forms and ODEs.

No model file takes part; what a model does in the same flow is in test_drag.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rounding import ROUND, close, repeatable, unit
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from reference import exact


def test_stokes_and_couette_motion_solve_their_linear_equation():
    tau, wall, gap = 0.3, 2.0, 1.5
    start, v = np.array([0.1, 0.2, 0.4]), np.array([1.0, -2.0, 0.7])
    # state (r, v): r' = v, v' = (u - v)/tau, u_x = (V/H) z
    system = np.zeros((6, 6))
    system[:3, 3:] = np.eye(3)
    system[3:, 3:] = -np.eye(3) / tau
    times = np.array([0.0, 0.05, 0.4, 3.0])
    flow = np.array([0.5, 0.0, -0.1])
    still = np.array([expm(system * t) @ [*start, *(v - flow)] for t in times])
    uniform = exact.stokes_motion(times, start, v, flow, tau)
    close(uniform.positions, still[:, :3] + flow * times[:, None], scale=1.0)
    close(uniform.velocities, still[:, 3:] + flow, scale=1.0)
    system[3, 2] = wall / gap / tau
    sheared = np.array([expm(system * t) @ [*start, *v] for t in times])
    couette = exact.couette_motion(times, start, v, wall, gap, tau)
    close(np.hstack([couette.positions, couette.velocities]), sheared, scale=1.0)


def test_implicit_euler_on_stokes_drag_converges_at_first_order():
    errors = [
        exact.implicit_euler_speed(n, 1.0, 0.2, 1.0 / n, 0.5) - (0.2 + 0.8 * np.exp(-2)) for n in (500, 1000)
    ]
    order = np.log2(errors[0] / errors[1])
    # the next term of the error is of relative size dt/tau: 4e-3 at n = 500
    np.testing.assert_allclose(order, 1.0, rtol=0, atol=4e-3)
    v = 1.0
    for _ in range(7):
        v = (v + 0.1 / 0.5 * 0.2) / (1 + 0.1 / 0.5)
    close(exact.implicit_euler_speed(7, 1.0, 0.2, 0.1, 0.5), v)


def test_iterating_the_implicit_position_has_the_fixed_point_ratio():
    dt, tau, v = 0.3, 2.0, 1.0
    r = [v * dt]
    for _ in range(4):
        r.append(v * dt - dt**2 / tau * (r[-1] / dt))
    changes = np.diff(r)
    close(changes[1:] / changes[:-1], exact.fixed_point_ratio(dt, tau), rtol=1e-11)


@pytest.mark.parametrize(
    "limit, below, above",
    [(1.0, 24.0, 24.0), (400.0, 0.50036, 0.5), (3e5, 0.5, 0.08034), (2e6, 0.18079, 0.18)],
)
def test_the_table_has_its_known_jumps(limit, below, above):
    got = [exact.drag_coefficient(limit), exact.drag_coefficient(limit * (1 + 1e-9))]
    # values are given to five digits: half a unit of the last
    np.testing.assert_allclose(got, [below, above], rtol=0, atol=5e-6)
    with pytest.raises(ValueError, match="positive"):
        exact.drag_coefficient(0.0)


def power_law_motion(t, speed, mass, diameter, density, viscosity):
    """Slip and distance at t by integrating u' = -k u^(2+b) in closed form, row after row."""
    scale = density * diameter / viscosity
    area = np.pi * diameter**2 / 4
    distance = 0.0
    rows = list(zip(exact.flow.REGIMES, [0.0, *(row[0] for row in exact.flow.REGIMES)], strict=False))
    for (limit, a, b), lower in reversed(rows):
        if not lower < speed * scale <= limit * (1 + 1e-12):
            continue
        k = density * area * a * scale**b / (2 * mass)
        end = lower / scale
        if b == -1.0:
            return speed * np.exp(-k * t), distance + speed * -np.expm1(-k * t) / k
        p = 1 + b
        needed = (end**-p - speed**-p) / (p * k)
        time = min(t, needed)
        after = (speed**-p + p * k * time) ** (-1 / p)
        distance += (
            np.log(speed / after) / k if p == 1.0 else (speed ** (1 - p) - after ** (1 - p)) / (k * (1 - p))
        )
        t, speed = t - time, end if time == needed else after
        if t <= 0:
            break
    return speed, distance


@pytest.mark.parametrize("reynolds", [0.3, 50.0, 1e4, 1e6, 1e7])
def test_drag_through_all_regimes_has_the_closed_form_of_each(reynolds):
    diameter, density, viscosity = 1e-3, 1000.0, 1e-3
    mass, speed = 2500 * np.pi / 6 * diameter**3, reynolds * viscosity / density / diameter
    times = np.array([0.0, 1e-3, 1e-2, 0.1, 1.0])
    direction = np.array([0.6, 0.0, -0.8])
    motion = exact.drag_motion(
        times, [0, 0, 0], speed * direction, [0, 0, 0], mass, diameter, density, viscosity
    )
    expected = [power_law_motion(t, speed, mass, diameter, density, viscosity) for t in times]
    # rtol 1e-12 on the logarithm, which reaches -30, and on up to 200 steps
    close(motion.velocities @ direction, [slip for slip, _ in expected], rtol=1e-9)
    close((motion.positions @ direction)[1:], [distance for _, distance in expected[1:]], rtol=1e-9)
    # five rows: as many limits are crossed as lie below the initial Reynolds number and are reached
    reached = density * diameter / viscosity * expected[-1][0]
    limits = [row[0] for row in exact.flow.REGIMES[:-1]]
    assert len(motion.crossings) == sum(reached < limit < reynolds for limit in limits)


def test_drag_motion_is_galilean_invariant_and_stokesian_when_slow():
    mass, d, rho, mu = 1e-15, 1e-6, 1000.0, 1e-3
    times, v, flow = np.linspace(0, 1e-6, 11), np.array([0.3, 0.1, -0.2]), np.array([0.1, 0.4, -0.3])
    moving = exact.drag_motion(times, [0, 0, 0], v, flow, mass, d, rho, mu)
    resting = exact.drag_motion(times, [0, 0, 0], v - flow, [0, 0, 0], mass, d, rho, mu)
    close(moving.positions, resting.positions + flow * times[:, None], scale=1e-6, rtol=1e-10)
    slow = exact.stokes_motion(times, [0, 0, 0], v, flow, exact.stokes_time(mass, d, mu))
    close(
        moving.velocities, slow.velocities, rtol=1e-10
    )  # Re <= 0.55; the integrator's 1e-12 over some steps
    close(moving.positions, slow.positions, scale=1e-6, rtol=1e-10)


@pytest.mark.parametrize("reynolds", [0.5, 30.0, 1e4, 1e6, 1e8])
def test_terminal_slip_balances_its_force(reynolds):
    d, rho, mu = 2e-3, 900.0, 2e-3
    slip = reynolds * mu / rho / d
    force = exact.drag_coefficient(reynolds) * 0.5 * rho * slip**2 * np.pi / 4 * d**2
    assert any(abs(found / slip - 1) < ROUND for found in exact.terminal_slips(force, d, rho, mu))


def test_the_drag_crisis_leaves_two_balances():
    def force(reynolds):
        return exact.drag_coefficient(reynolds) * 0.5 * reynolds**2 * np.pi / 4

    assert len(exact.terminal_slips(force(2.5e5), 1.0, 1.0, 1.0)) == 2
    assert len(exact.terminal_slips(force(1e4), 1.0, 1.0, 1.0)) == 1


@repeatable
@given(
    st.just(0.0) | st.floats(1e-3, 5.0),
    st.floats(-3.0, -1e-3),
    st.floats(0.1, 2.0),
    st.floats(0.1, 2.0),
    unit,
)
def test_arrival_solves_the_equation_of_motion(distance, speed, flow, tau, faster):
    if distance > 0:
        speed += 6.0 * faster
    time, arriving = exact.arrival(distance, speed, flow, tau)
    assert time > 0
    # the path: u t + (w0 - u) tau (1 - exp(-t/tau)) towards the wall
    close(flow * time - (speed - flow) * tau * np.expm1(-time / tau), distance, scale=flow * time + 10.0)
    close(arriving, flow + (speed - flow) * np.exp(-time / tau), scale=flow + abs(speed))
    before = np.linspace(0, time, 50)[1:-1]
    assert np.all(flow * before - (speed - flow) * tau * np.expm1(-before / tau) < distance + ROUND)


def train(**changes):
    settings_ = {
        "distance": 0.0, "speed": 0.5, "flow_speed": 0.5, "mass": 2.0, "radius": 1.0, "drag_factor": 4.0,
        "wall": exact.Wall(0.5, 1.0, 0.3, 1.0, 0.0, duration=1e-3), "impacts": 6, "removes": False,
    }  # fmt: skip
    return exact.bounce_train(**{**settings_, **changes})


def test_the_bounce_train_of_the_design():
    # three digits are given
    np.testing.assert_allclose(
        train().approach_speeds[:5], [0.5, 0.187, 0.083, 0.039, 0.019], rtol=0, atol=5e-4
    )


def test_the_bounce_train_is_the_integrated_motion():
    tau, flow, e = 0.5, 0.5, 0.5
    speeds, times, now, v = [], [], 0.0, -0.5

    def rate(_, y):
        return [y[1], (-flow - y[1]) / tau]

    def lands(t, y):
        return y[0] if t > 0 else 1.0

    lands.terminal, lands.direction = True, -1
    for _ in range(5):
        speeds.append(-v)
        times.append(now)
        run = solve_ivp(rate, (0, 10), [0, -e * v], "DOP853", events=lands, rtol=1e-12, atol=1e-15)
        now, v = now + run.t[-1], run.y[1, -1]
    exact_train = train(impacts=5)
    # 1e-8: the integrator's tolerance, and the event's, at the last impact (0.019 m/s)
    close(exact_train.approach_speeds, speeds, rtol=1e-8)
    close(exact_train.times, times, rtol=1e-8)
    # drag at impact per mass: (u - v)/tau, both towards the wall
    close(exact_train.external_forces, -2.0 * (0.5 - exact_train.approach_speeds) / 0.5, scale=1.0)
    impulses = [hit.normal_impulse for hit in exact_train.impacts]
    close(impulses, 1.5 * 2.0 * exact_train.approach_speeds - exact_train.external_forces * 1e-3)


def test_late_impacts_lose_speed_by_the_restitution_alone():
    speeds = train(impacts=40, wall=exact.Wall(0.5, 1.0, 0.3, 1.0, 0.0)).approach_speeds
    # drag changes the speed of return by a relative v/(3u), below 2e-10 from the 30th impact on
    close(speeds[31:] / speeds[30:-1], 0.5, rtol=1e-9)


PRESSED = {
    "flow_speed": 0.5, "mass": 1e-15, "radius": 0.5e-6, "drag_factor": 1e-8, "removes": True,
    "wall": exact.Wall(0.5, 1e11, 0.3, 5e7, 9000.0, threshold_velocity=0.01),
}  # fmt: skip


def test_removal_by_a_bounce_train_is_finite_and_joins_the_sphere():
    short, long = train(impacts=10, **PRESSED), train(impacts=30, **PRESSED)
    assert short.removed_volume == long.removed_volume > 0
    close(long.impacts[-1].mass - 1e-15, 9000.0 * long.removed_volume, scale=1e-15)
    assert long.impacts[0].mass > 1e-15
    removing = [hit.removal.volume > 0 for hit in long.impacts]
    assert removing == [speed >= 0.01 for speed in long.approach_speeds]


def test_without_a_threshold_the_pressing_flow_alone_removes_at_every_impact():
    free = train(impacts=30, **{**PRESSED, "wall": PRESSED["wall"]._replace(threshold_velocity=0.0)})
    last = free.impacts[-1]
    close(last.load, 1e-8 * 0.5, rtol=1e-3)  # the impulse of the last impact, 1e-10 m/s, adds less
    assert last.removal.volume > 0
