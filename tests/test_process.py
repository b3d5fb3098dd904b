"""Laws of Section 4: independent random streams, the initial state, and the descending pad."""

from __future__ import annotations

import re
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rounding import ROUND, close
from scipy.stats import kstest

from reference import exact
from reference.case import Case, CaseError, load_case
from reference.process import STREAMS, build_setup, random_streams
from reference.simulation import simulate
from reference.state import DEPOSIT_NONE

pytestmark = pytest.mark.nojit
MATERIALS = {
    "alumina": {"density": 3950.0, "youngs_modulus": 370e9, "poisson_ratio": 0.22},
    "copper": {"density": 8960.0, "youngs_modulus": 120e9, "poisson_ratio": 0.34, "yield_stress": 0.3e9},
}
FLAT = {"kind": "flat", "size": 6e-6, "nodes": 12, "material": "copper"}
ROUGH = FLAT | {"kind": "asperities", "asperity_height": 0.5e-6, "asperity_density": 0.1}
SLURRY = {"count": 20, "mean_diameter": 0.6e-6, "diameter_spread": 0.2, "material": "alumina"}
WATER = {"density": 1000.0, "viscosity": 1e-3, "flow": "couette"}
SHEAR = WATER | {"wall_speed": 0.5, "gap": 5e-6}
REMOVAL = {"deposit": "volume"}


def make(duration=100e-9, outputs=3, seed=1, **sections):
    """A slurry over asperities, with sections replaced; None leaves one out."""
    raw: dict = {
        "case": {"name": "test", "title": "", "description": "", "seed": seed}
        | {"duration": duration, "outputs": outputs},
        "particles": SLURRY | {"z_max": 4e-6},
        "material": MATERIALS,
        "surface": ROUGH,
        "contact": {"restitution": 0.5},
        "numerics": {"time_step": 1e-9},
    }
    return Case.model_validate({key: value for key, value in (raw | sections).items() if value is not None})


def ball(position, velocity=(0.0, 0.0, 0.0), **entries):
    start = {"position": list(map(float, position)), "velocity": list(map(float, velocity))}
    return {"diameter": 1e-6, "material": "alumina"} | start | entries


def test_each_purpose_has_a_stream_of_its_own():
    first = {name: stream.random() for name, stream in random_streams(1).items()}
    again = {name: stream.random() for name, stream in random_streams(1).items()}
    other = {name: stream.random() for name, stream in random_streams(2).items()}
    assert tuple(first) == STREAMS
    assert first == again
    assert len({*first.values(), *other.values()}) == 2 * len(STREAMS)


def test_more_particles_leave_the_surface_as_it_was():
    few, many = (build_setup(make(particles=SLURRY | {"count": n, "z_max": 4e-6})) for n in (5, 40))
    assert few.state.heights.tobytes() == many.state.heights.tobytes()
    assert np.array_equal(many.state.diameter[:5], few.state.diameter)
    assert not np.array_equal(build_setup(make(seed=2)).state.heights, few.state.heights)


def test_another_surface_leaves_diameters_and_velocities_as_they_were():
    part = SLURRY | {"z_min": 1.5e-6, "z_max": 4e-6, "velocity_min": [-1.0] * 3, "velocity_max": [1.0] * 3}
    one, two = (build_setup(make(particles=part, surface=surface)).state for surface in (FLAT, ROUGH))
    assert not np.array_equal(one.heights, two.heights)
    assert np.array_equal(one.diameter, two.diameter)
    assert np.array_equal(one.position, two.position)  # above all asperities
    assert np.array_equal(one.velocity, two.velocity)


@settings(max_examples=20)
@given(st.integers(0, 10_000), st.floats(0.0, 0.5))
def test_diameters_and_velocities_stay_within_their_limits(seed, spread):
    low, high = np.array([-1.0, 0.0, 0.3]), np.array([1.0, 0.0, 0.5])
    part = SLURRY | {"diameter_spread": spread, "z_max": 4e-6}
    part |= {"velocity_min": low.tolist(), "velocity_max": high.tolist()}
    state = build_setup(make(seed=seed, particles=part)).state
    limits = 0.6e-6 * np.array([1 - spread, 1 + spread])
    assert np.all(limits[0] <= state.diameter)
    assert np.all(state.diameter <= limits[1])
    assert np.all((low <= state.velocity) & (state.velocity <= high))
    close(state.mass, 3950.0 * np.pi * state.diameter**3 / 6)
    assert spread < 1e-6 or len(set(state.diameter)) == 20


def test_diameters_and_velocities_are_uniform():
    part = SLURRY | {"count": 2000, "diameter_spread": 0.3, "z_max": 1e-3}
    part |= {"velocity_min": [-1.0] * 3, "velocity_max": [1.0] * 3}
    state = build_setup(make(particles=part, surface=FLAT)).state
    # at a fixed seed; a thousandth of all seeds would fail each
    assert kstest(state.diameter / 0.6e-6, "uniform", (0.7, 0.6)).pvalue > 1e-3
    assert kstest(state.velocity.ravel(), "uniform", (-1.0, 2.0)).pvalue > 1e-3
    assert kstest(state.diameter**2 / 0.36e-12, "uniform", (0.49, 1.2)).pvalue < 1e-5  # the twin


def test_without_velocities_particles_start_with_the_local_fluid():
    layer = build_setup(make(fluid=SHEAR)).state
    close(layer.velocity, layer.position[:, 2:] * [1.0, 0.0, 0.0] * 0.5 / 5e-6)
    assert np.ptp(layer.velocity[:, 0]) > 0.1
    uniform = {"density": 1000.0, "viscosity": 1e-3, "flow": "uniform", "velocity": [0.1, -0.2, 0.3]}
    assert np.all(build_setup(make(fluid=uniform)).state.velocity == [0.1, -0.2, 0.3])
    assert np.all(build_setup(make()).state.velocity == 0.0)
    under = build_setup(make(particles=SLURRY, pad={"speed": 0.8, "initial_height": 4e-6}, fluid=WATER)).state
    close(under.velocity, under.position[:, 2:] * [1.0, 0.0, 0.0] * 0.8 / 4e-6)


def test_the_default_threshold_is_the_yield_velocity():
    """sqrt(26 (Y/E*)^4 Y/rho): 1.25 cm/s for alumina on copper."""
    modulus = 1 / ((1 - 0.22**2) / 370e9 + (1 - 0.34**2) / 120e9)
    speed = build_setup(make(removal=REMOVAL)).model.threshold_velocity
    close(speed, np.sqrt(26 * (0.3e9 / modulus) ** 4 * 0.3e9 / 3950.0))
    np.testing.assert_allclose(speed, 0.0125, rtol=0, atol=5e-5)  # three digits
    assert build_setup(make(removal=REMOVAL | {"threshold_velocity": 0.05})).model.threshold_velocity == 0.05
    assert build_setup(make(removal=REMOVAL | {"threshold_velocity": 0.0})).model.threshold_velocity == 0.0
    assert build_setup(make()).model.deposit == DEPOSIT_NONE


def test_a_threshold_that_a_pressed_particle_passes_at_every_step_is_noted():
    """2 U dt/tau, of the smallest particle; tau = m/(3 pi mu d)."""
    quick, slow = (
        build_setup(make(fluid=SHEAR, removal=REMOVAL | {"threshold_velocity": v})) for v in (0.2, 0.002)
    )
    tau = exact.stokes_time(slow.state.mass.min(), slow.state.diameter.min(), 1e-3)
    assert 0.002 < 2 * 0.5 * 1e-9 / tau < 0.2
    assert quick.notes == []
    (note,) = slow.notes
    assert f"{2 * 0.5 * 1e-9 / tau:.3g} m/s" in note


def thermal_notes(case):
    return [note for note in build_setup(case).notes if "thermal" in note]


def test_brownian_motion_that_is_faster_than_the_pad_is_noted():
    """sqrt(3 k T/m) at 293 K: 0.47 m/s of 30 nm of alumina, 3 mm/s of 0.9 um; pads of 4 cm/s and 1 m/s."""
    (note,) = thermal_notes(load_case("fine_abrasive"))
    mass = build_setup(load_case("fine_abrasive")).state.mass.mean()
    assert f"{np.sqrt(3 * 1.380649e-23 * 293 / mass):.3g} m/s at 293 K" in note
    assert "= 0.46" in note
    assert "the pad's 0.04 m/s" in note
    assert thermal_notes(load_case("polish")) == []


@pytest.mark.parametrize("speed, noted", [(1e-3, True), (1e-2, False)])
def test_brownian_motion_is_compared_with_the_fastest_of_flow_and_particles(speed, noted):
    """A particle of 0.6 um has a thermal speed of 5 mm/s."""
    still = {"density": 1000.0, "viscosity": 1e-3, "flow": "uniform", "velocity": [0.0, 0.0, 0.0]}
    one = make(
        particles=None, particle=[ball((1e-6, 1e-6, 2e-6), (0, speed, 0), diameter=0.6e-6)], fluid=still
    )
    flow = make(fluid=still | {"velocity": [0.0, 0.0, speed]})
    wall = make(fluid=SHEAR | {"wall_speed": speed})
    for case, what in (one, "particles' own"), (flow, "flow's"), (wall, "wall's"):
        notes = thermal_notes(case)
        assert [f"the {what} {speed:.3g} m/s" in note for note in notes] == [True] * noted
    assert thermal_notes(make()) == []  # without a fluid


@pytest.mark.parametrize("jitter", [0.0, 0.2e-6])
def test_a_particle_in_an_asperity_is_refused_in_one_line(tmp_path, jitter):
    """Plateaus are 0.5 um high; a centre at 0.99 um is too low over one, not over the plain."""
    surface = FLAT | {"kind": "asperities", "asperity_height": 0.5e-6, "raised": [[4, 4]]}
    over, plain = (
        make(particles=None, particle=[ball((x, x, 0.99e-6), position_jitter=jitter)], surface=surface)
        for x in (2.25e-6, 4e-6)
    )
    assert len(build_setup(plain).state.mass) == 1
    over.save(tmp_path / "over.toml")
    with pytest.raises(CaseError) as refused:
        build_setup(load_case(tmp_path / "over.toml"))
    assert re.fullmatch(
        r".*over\.toml:\d+: particle\[0\]\.position = \[.*\]: .*in the surface; allowed: above it",
        str(refused.value),
    )


def test_a_packing_that_is_impossible_is_refused_within_seconds():
    start = time.perf_counter()
    with pytest.raises(CaseError, match=r"particles\.count") as refused:
        build_setup(make(particles=SLURRY | {"count": 900, "z_max": 4e-6}))
    assert time.perf_counter() - start < 20.0
    message = str(refused.value)
    assert "900" in message
    assert "\n" not in message
    with pytest.raises(CaseError, match="no room"):
        build_setup(make(particles=SLURRY | {"z_max": 0.2e-6}))
    with pytest.raises(CaseError, match=r"particles\.z_max"):
        build_setup(make(particles=SLURRY))


# The pad


def polish(duration=200e-9, outputs=21, spheres=(), pad=(), **sections):
    """A pad that comes down on spheres at explicit places."""
    spheres = list(spheres) or [ball((1e-6, 1e-6, 1e-6))]
    plane = {"speed": 1.0, "initial_height": 2e-6, "minimum_height": 1.3e-6, "restitution": 0.4} | dict(pad)
    return make(
        duration, outputs, particles=None, particle=spheres, pad=plane, **{"surface": FLAT} | sections
    )


def test_an_impact_on_the_descending_pad_is_that_on_a_moving_wall():
    """The sphere meets the pad at v_z + V_z and leaves it at e_pad of that: J = (1+e_pad) m (v_z + V_z)."""
    case = polish(spheres=[ball((1e-6, 1e-6, 1.2e-6), (0.3, 0.1, 2.0))])
    descent = 0.7e-6 / (0.7 * 200e-9)
    run = simulate(case)
    hit, *later = run.contacts.itertuples()
    assert all(other.time > hit.time + 20e-9 for other in later)
    assert (hit.kind, hit.i, hit.j, hit.nz) == ("pad", 0, -1, -1.0)
    mass = run.masses[0, 0]
    close(hit.approach_speed, 2.0 + descent)
    close(hit.normal_impulse, 1.4 * mass * (2.0 + descent))
    after = -0.4 * (2.0 + descent) - descent
    struck = run.velocities[run.times > hit.time + 1e-9][0, 0]
    close(struck, [0.3, 0.1, after])
    close(hit.energy_lost, 0.5 * mass * (2.0**2 - after**2), scale=mass * after**2)
    # where they meet: 1.7 um + 2 t = 2 um - V_z t, found at the end of a step
    meeting = 0.3e-6 / (2.0 + descent)
    assert meeting <= hit.time <= meeting + 1e-9
    pushed = run.contacts[run.contacts["kind"] == "pad"]["normal_impulse"].sum()
    close(run.history["pad_work"].iloc[-1], pushed * descent)
    assert abs(after + 0.4 * 2.0) > 1.0  # a pad at rest would be told apart


def test_a_pad_that_has_stopped_is_a_wall_at_rest():
    """Held at its lowest height it gives back e_pad of v_z, and does no work."""
    case = polish(spheres=[ball((1e-6, 1e-6, 1.2e-6), (0.0, 0.0, 2.0))], pad={"minimum_height": 2e-6})
    run = simulate(case)
    hit = run.contacts[run.contacts["kind"] == "pad"].iloc[0]
    close(hit.normal_impulse, 1.4 * run.masses[0, 0] * 2.0)
    stopped = polish(
        400e-9,
        spheres=[ball((1e-6, 1e-6, 1.15e-6), (0.0, 0.0, 0.5))],
        pad={"initial_height": 1.81e-6, "minimum_height": 1.8e-6},
    )
    run = simulate(stopped)
    hit = run.contacts[run.contacts["kind"] == "pad"].iloc[0]
    assert hit.time > 0.7 * 400e-9
    close(hit.approach_speed, 0.5)
    assert run.history["pad_work"].iloc[-1] == 0.0


@pytest.mark.parametrize("speed, struck", [(0.9, True), (1.1, False)])
def test_a_sphere_that_flees_faster_than_the_pad_is_not_struck(speed, struck):
    case = polish(1e-6, spheres=[ball((1e-6, 1e-6, 1.5e-6), (0.0, 0.0, -speed))])
    run = simulate(case)
    close(build_setup(case).model.pad_descent, 1.0)
    assert (run.contacts["time"] < 0.5e-6).any() == struck


def heights(run):
    return run.history["pad_height"].to_numpy()


def test_the_pad_descends_at_its_speed_and_stops_at_its_lowest_height():
    """H_min at 0.7 of the duration; each of up to 200 steps rounds the height once."""
    run = simulate(polish(spheres=[ball((1e-6, 1e-6, 0.6e-6))]))
    expected = np.maximum(2e-6 - 0.7e-6 / 0.7 * run.times / 200e-9, 1.3e-6)
    close(heights(run), expected, scale=2e-6)
    assert heights(run)[-1] == 1.3e-6
    assert np.all(np.diff(heights(run)) <= 0)
    default = build_setup(polish(pad={"minimum_height": None})).model
    close(default.pad_minimum, 1.01e-6)


@pytest.mark.parametrize("deposit", [None, "node_depth"])
def test_the_pad_rests_on_the_largest_particle_on_the_highest_node(deposit):
    """H = z_max + d_max/2 is as low as it gets; when nodes fall it follows, no faster than V_z."""
    surface = FLAT | {"kind": "asperities", "asperity_height": 1e-6, "raised": [[4, 4]]}
    spheres = [
        ball((x, y, 1.55e-6), (0, 0, -1.5), diameter=0.9e-6) for x, y in [(2.1e-6, 2.1e-6), (5e-6, 5e-6)]
    ]
    removal = {} if deposit is None else {"removal": {"deposit": deposit, "acceleration": 50.0}}
    case = polish(
        400e-9, 401, spheres, {"minimum_height": 1.0e-6, "initial_height": 2.1e-6}, surface=surface, **removal
    )
    run = simulate(case)
    descent = build_setup(case).model.pad_descent
    falls = -np.diff(heights(run))
    assert np.all(falls >= 0)
    assert falls.max() <= descent * 1e-9 * (1 + ROUND)
    rest = run.surface.z.max() + 0.45e-6
    if deposit is None:
        close(heights(run)[-1], 1.45e-6)
        close(rest, 1.45e-6)
    else:
        assert not np.array_equal(run.surface.z, run.surface_initial.z)
        assert heights(run)[-1] >= rest - 1e-6 * ROUND


def test_a_pad_that_starts_too_low_stays_there():
    """Below z_max + d_max/2 it neither descends nor rises."""
    surface = FLAT | {"kind": "asperities", "asperity_height": 1e-6, "raised": [[8, 8]]}
    run = simulate(
        polish(spheres=[ball((1e-6, 1e-6, 0.6e-6))], pad={"initial_height": 1.35e-6}, surface=surface)
    )
    assert np.all(heights(run) == 1.35e-6)


def test_under_the_pad_particles_drift_with_the_layer():
    """u = V z/H(t): at last at H_min; of the lag exp(-t/tau) is left since the pad stopped."""
    slow = {"minimum_height": 1.9e-6, "speed": 0.2}
    case = polish(4e-6, 3, [ball((1e-6, 1e-6, 0.7e-6), (0.07, 0, 0), diameter=0.8e-6)], slow, fluid=WATER)
    run = simulate(case)
    tau = exact.stokes_time(run.masses[0, 0], 0.8e-6, 1e-3)
    u = 0.2 * 0.7e-6 / np.array([2e-6, 1.9e-6])
    assert run.velocities[0, 0, 0] == 0.07
    still = np.abs(np.diff(u))[0] * np.exp(-0.3 * 4e-6 / tau)
    np.testing.assert_allclose(run.velocities[-1, 0], [u[1], 0, 0], rtol=ROUND, atol=still)
    assert still < 0.01 * abs(u[1] - u[0])


def test_the_largest_step_is_a_part_of_the_way_over_a_diameter():
    """dt_lim = gamma d/V_pad; of the mean diameter."""
    case = polish(pad={"speed": 2.0}, numerics={"gamma": 0.02})
    close(build_setup(case).time_step, 0.02 * 1e-6 / 2.0)
    close(
        build_setup(
            make(particles=SLURRY, pad={"speed": 1.0, "initial_height": 4e-6}, numerics={})
        ).time_step,
        0.6e-8,
    )
