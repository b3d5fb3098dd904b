"""Closed forms of impacts with springs, dashpots and friction, against quadrature and integrated motion."""

from __future__ import annotations

import math

import pytest
from scipy.integrate import quad, solve_ivp

from cmpcheck.published import load_benchmark
from cmpcheck.published.scene import contact_of
from reference.exact import hertz
from reference.exact.oblique import INERTIA, Law, oblique_impact, sliding, sliding_angle

TIGHT = {"rtol": 1e-12, "atol": 1e-15, "method": "DOP853"}


@pytest.mark.parametrize(
    "name, material, deepest, force, duration",  # um, kN, us: the numbers, to their last digit
    [
        ("chung_ooi_1", 0, 274.113, 10.6969, 40.339),
        ("chung_ooi_1", 1, 368.304, 7.1082, 54.201),
        ("chung_ooi_2", 0, 49.717, 11.3699, 731.66),
        ("chung_ooi_2", 1, 52.123, 7.2327, 767.07),
    ],
)
def test_hertz_gives_the_published_extremes(name, material, deepest, force, duration):
    benchmark = load_benchmark(name)
    contact = contact_of(benchmark, benchmark.material[material], "hertz", 1.0)
    found = contact.impact(contact.speed)
    assert found.deepest * 1e6 == pytest.approx(deepest, abs=6e-4)
    assert found.force / 1e3 == pytest.approx(force, abs=6e-5)
    assert found.duration * 1e6 == pytest.approx(duration, abs=6e-3)


def test_the_duration_of_hertz_is_the_quadrature_of_its_speed():
    mass, stiffness, speed = 2.0, 3.0, 0.5
    found = hertz.hertz_impact(mass, stiffness, speed)
    # x = deepest (1 - q^2) takes the root out of the integrand at the turning point
    half, _ = quad(
        lambda q: 2.0 * q / math.sqrt(1.0 - (1.0 - q * q) ** 2.5), 0.0, 1.0, epsabs=1e-13, epsrel=1e-13
    )
    assert found.duration == pytest.approx(2.0 * half * found.deepest / speed, rel=1e-11)


@pytest.mark.parametrize("power", [1.0, 1.5])
@pytest.mark.parametrize("e", [0.2, 0.5, 0.98])
@pytest.mark.parametrize("speed", [0.3, 7.0])
def test_the_dashpot_returns_e_at_every_speed_and_pulls_as_said(power, e, speed):
    k, of_hertz = 40.0, power == 1.5
    law = Law(k, 1.0, of_hertz, 0.0, e, 1.0)
    start = 1e-9 * speed

    def rates(_, y):
        d = max(y[0], 0.0)
        return [y[1], -law.normal_force(d, y[1]), abs(law.normal_force(d, y[1]))]

    def left(_, y):
        return y[0]

    left.terminal, left.direction = True, -1
    done = solve_ivp(rates, (0.0, 50.0), [start, speed, 0.0], events=left, **TIGHT)
    depth, v, total = done.y[:, -1]
    assert depth == pytest.approx(0.0, abs=1e-8)
    assert -v / speed == pytest.approx(e, abs=1e-6)
    assert total / speed == pytest.approx(1.0 + 2.0 * hertz.fastest_return(e) - e, abs=1e-6)


def law_of(hertz_contact: bool, friction: float = 0.092, e: float = 0.98, **changes) -> Law:
    m = 4.0 / 3.0 * math.pi * 0.0025**3 * 4000.0
    stiffness = 2.67e10 / m if hertz_contact else 1.72e7 / m
    shear = 3.48e10 / m if hertz_contact else 1.48e7 / m
    return Law(stiffness, shear, hertz_contact, friction, e, 0.0025, **changes)


@pytest.mark.parametrize("hertz_contact", [True, False])
@pytest.mark.parametrize("angle", [40.0, 60.0, 85.0])
def test_the_law_slides_as_the_closed_form_says(hertz_contact, angle):
    law = law_of(hertz_contact, e=1.0)
    normal, tangential = 3.9 * math.cos(math.radians(angle)), 3.9 * math.sin(math.radians(angle))
    found, exact = oblique_impact(law, normal, tangential), sliding(normal, tangential, 0.092, 1.0)
    assert found.normal == pytest.approx(1.0, abs=1e-8)
    assert found.tangential == pytest.approx(exact.tangential, abs=1e-8)
    assert found.surface_speed == pytest.approx(exact.surface_speed, rel=1e-7)
    assert found.angle(normal) == pytest.approx(exact.angle(normal), abs=1e-5)


def test_without_slip_the_spring_turns_back_what_it_took():
    """Endless friction and a spring: the contact's velocity is u cos(w t), w^2 = (7/2) k_t/m."""
    law = law_of(False, friction=1e9, e=1.0)
    found = oblique_impact(law, 3.9, 0.1)
    duration = math.pi / math.sqrt(law.stiffness)
    exact = 0.1 * math.cos(math.sqrt((1.0 + 1.0 / INERTIA) * law.shear) * duration)
    assert found.contact == pytest.approx(exact, abs=1e-8)


@pytest.mark.parametrize("hertz_contact", [True, False])
@pytest.mark.parametrize("angle", [2.0, 10.0, 25.0])
@pytest.mark.parametrize("shortening", [0.0, 0.5])
def test_stick_and_slip_are_those_of_small_steps(hertz_contact, angle, shortening):
    law = law_of(hertz_contact, shortening=shortening)
    v, u0 = 3.9 * math.cos(math.radians(angle)), 3.9 * math.sin(math.radians(angle))
    deepest = (1.25 * v**2 / law.stiffness) ** 0.4 if hertz_contact else v / math.sqrt(law.stiffness)
    dt, d, vn, vt, w, xi = deepest / v / 4000, 0.0, v, u0, 0.0, 0.0
    d += 0.5 * dt * vn
    while d > 0.0:
        arm = 1.0 - law.shortening * d / law.radius
        xi += dt * (vt - arm * w)
        xi = max(-law.limit(d, vn), min(law.limit(d, vn), xi))
        pull = law.shear_stiffness(d) * xi
        vn, vt, w = vn - dt * law.normal_force(d, vn), vt - dt * pull, w + dt * pull * arm / INERTIA
        d += dt * vn
    found = oblique_impact(law, v, u0)
    assert found.tangential * u0 == pytest.approx(vt, abs=5e-4 * u0)  # of first order in 1/4000
    assert found.surface_speed == pytest.approx(w, abs=5e-4 * u0)


def test_it_slides_to_the_end_from_the_published_angle_on():
    assert sliding_angle(0.092, 0.98) == pytest.approx(32.52, abs=5e-3)
    tangent = math.tan(math.radians(sliding_angle(0.092, 0.98)))
    assert sliding(1.0, tangent, 0.092, 0.98).contact == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(ValueError, match="slide to the end"):
        sliding(1.0, 0.99 * tangent, 0.092, 0.98)
