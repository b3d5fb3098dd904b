"""Laws of whole runs: what is conserved, what leaves the surface, invariances, and limits.

One step is `test_timestep.py`; the initial state and the pad are `test_process.py`; reproducibility and
files are `test_recording.py`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rounding import ROUND, close
from scipy.spatial.transform import Rotation

from reference import exact
from reference.case import Case, load_case
from reference.heightfield import surface_contact
from reference.process import build_setup
from reference.simulation import simulate, simulate_setup

pytestmark = pytest.mark.nojit
EPS = np.finfo(float).eps
MATERIALS = {
    "alumina": {"density": 3950.0, "youngs_modulus": 370e9, "poisson_ratio": 0.22},
    "copper": {"density": 8960.0, "youngs_modulus": 120e9, "poisson_ratio": 0.34, "yield_stress": 8.2e6},
}  # copper so soft that an impact at 1 m/s removes 1e-3 of the particle's mass
FLAT = {"kind": "flat", "size": 6e-6, "nodes": 6, "material": "copper"}
ROUGH = FLAT | {"kind": "asperities", "asperity_height": 0.4e-6, "raised": [[1, 1], [3, 2], [0, 4]]}
WATER = {"density": 1000.0, "viscosity": 1e-3, "flow": "uniform", "velocity": [0.0, 0.0, 0.0]}
THIN = WATER | {"viscosity": 1e-4}  # Re of some tens: Eq 21 beyond Stokes
SCHEMES = ["point_implicit", "fixed_point"]


def make(steps=200, outputs=3, seed=1, **sections):
    """A case of `steps` steps of 1 ns in an open box, with sections replaced."""
    raw: dict = {
        "case": {"name": "test", "title": "", "description": "", "seed": seed}
        | {"duration": steps * 1e-9, "outputs": outputs},
        "material": MATERIALS,
        "surface": {"kind": "none", "size": 6e-6},
        "contact": {"restitution": 0.5},
        "numerics": {"time_step": 1e-9, "tolerance": 1e-14},
    }
    return Case.model_validate(raw | sections)


def ball(position, velocity, diameter=1e-6):
    return {
        "diameter": diameter,
        "position": [float(x) for x in position],
        "velocity": [float(v) for v in velocity],
        "material": "alumina",
    }


def swarm(count=40, outputs=3, fluid=None, **contact):
    """A periodic cube, 18 % full, at 1 m/s."""
    return make(
        steps=600,
        outputs=outputs,
        fluid=fluid,
        particles={
            "count": count, "mean_diameter": 0.9e-6, "diameter_spread": 0.2, "material": "alumina",
            "velocity_min": [-1.0] * 3, "velocity_max": [1.0] * 3,
        },
        surface={"kind": "none", "size": 4.4e-6, "height": 4.4e-6},
        contact={"restitution": 0.9, "static_friction": 0.3, "dynamic_friction": 0.2} | contact,
    )  # fmt: skip


def rain(outputs=3, removal=(), **sections):
    """Spheres that fall on asperities at 1 m/s."""
    places = [(1.3, 1.2), (2.6, 3.1), (4.4, 2.3), (0.4, 5.2), (5.1, 4.9)]
    spheres = [ball((x * 1e-6, y * 1e-6, 0.85e-6), (0.1, -0.05, -1.0), 0.8e-6) for x, y in places]
    optional = {} if removal is None else {"deposit": "volume", "threshold_velocity": 0.05} | dict(removal)
    return make(600, outputs, particle=spheres, surface=ROUGH, removal=optional or None, **sections)


def drop(speed, **removal):
    """One sphere that falls on flat ground, nearest to node (2, 3)."""
    start = [ball((2.2e-6, 3.1e-6, 0.505e-6), (0, 0, -speed))]
    removal = {"deposit": "volume", "threshold_velocity": 0.05} | removal
    return make(40, particle=start, surface=FLAT, removal=removal)


def kinetic(run, k):
    return 0.5 * (run.masses[k] * (run.velocities[k] ** 2).sum(axis=1)).sum()


def momentum(run, k):
    return (run.masses[k][:, None] * run.velocities[k]).sum(axis=0)


# A step without contact leaves v + 0/m = v as it is, so round-off comes with contacts only.


def test_momentum_is_conserved_in_a_swarm_with_friction():
    run = simulate(swarm())
    assert len(run.contacts) >= 20
    size = (run.masses[0][:, None] * np.abs(run.velocities[0])).sum()
    close(momentum(run, -1), momentum(run, 0), scale=size)
    assert np.abs(run.velocities[-1] - run.velocities[0]).max() > 0.1


def test_the_energy_lost_is_that_of_the_ledger():
    run = simulate(swarm())
    contacts = run.contacts
    ends = np.concatenate([contacts[["time", "i"]].to_numpy(), contacts[["time", "j"]].to_numpy()])
    assert len(np.unique(ends, axis=0)) == len(ends)  # nobody meets two at once: see the next law
    lost = kinetic(run, 0) - kinetic(run, -1)
    assert lost > 0.05 * kinetic(run, 0)
    close(contacts["energy_lost"].sum(), lost, scale=kinetic(run, 0))
    assert contacts["energy_lost"].min() > 0
    assert contacts["friction_impulse"].min() > 0


def test_losses_and_the_work_of_the_fluid_make_up_the_change_of_energy():
    run = simulate(swarm(fluid=THIN))
    sums = run.history.iloc[-1]
    close(
        kinetic(run, -1) - kinetic(run, 0), sums["fluid_work"] - sums["contact_loss"], scale=kinetic(run, 0)
    )
    close(sums["contact_loss"], run.contacts["energy_lost"].sum())
    assert sums["fluid_work"] < -0.1 * kinetic(run, 0)
    assert sums["contact_loss"] > 0.01 * kinetic(run, 0)


def overlaps(run, k, pairs):
    """(i, j) of all pairs, or (i, -1) of all spheres on the surface, that overlap and approach in frame k."""
    r, v, radius = run.positions[k], run.velocities[k], 0.5 * run.diameters
    if pairs:
        apart = r[None] - r[:, None]
        apart -= 4.4e-6 * np.round(apart / 4.4e-6)
        distance = np.linalg.norm(apart, axis=-1)
        approach = ((v[None] - v[:, None]) * apart).sum(axis=-1) < 0
        found = np.triu(distance < radius[None] + radius[:, None], 1) & approach
        return sorted(map(tuple, np.argwhere(found).tolist()))
    z, h = run.surface.z, run.surface.spacing
    hits = [(i, surface_contact(z, h, *r[i], radius[i])) for i in range(len(r))]
    return [(i, -1) for i, hit in hits if hit[0] and v[i] @ hit[2:5] < 0]


@pytest.mark.parametrize("pairs", [True, False], ids=["pairs", "surface"])
def test_every_overlap_that_approaches_is_in_the_ledger_and_no_other(pairs):
    """Lists of neighbors and distances flown since the last look at the surface leave nobody out."""
    wind = WATER | {"velocity": [0.6, 0.3, -0.3]}  # presses them down and drives them over the asperities

    def run_with(outputs):
        return simulate(swarm(outputs=outputs) if pairs else rain(outputs, None, fluid=wind))

    every, few = run_with(601), run_with(2)  # lists and distances are begun anew at each output
    ledger = every.contacts
    assert len(ledger) >= 20
    for k, now in enumerate(every.times[:-1]):
        rows = ledger[np.abs(ledger["time"] - now) < 0.1e-9]
        assert sorted(zip(rows["i"], rows["j"], strict=True)) == overlaps(every, k, pairs)
    assert np.array_equal(few.contacts[["i", "j"]], ledger[["i", "j"]])
    close(few.contacts["time"], ledger["time"], scale=600e-9)


def test_impulses_of_simultaneous_contacts_are_added():
    """The twin of the energy balance: the ledger leaves out J_1.J_2/m of a sphere hit twice at once."""
    hit = ball((3.0002e-6, 3.0002e-6, 3e-6), (0, 0, 0))
    hitting = [ball((2e-6, 3.0002e-6, 3e-6), (0.5, 0, 0)), ball((3.0002e-6, 2e-6, 3e-6), (0.1, 0.5, 0))]
    run = simulate(make(4, particle=[*hitting, hit]))
    contacts = run.contacts
    assert contacts["time"].nunique() == 1
    assert len(contacts) == 2
    n, impulse = contacts[["nx", "ny", "nz"]].to_numpy(), contacts["normal_impulse"].to_numpy()
    close(run.velocities[-1][2], (impulse[:, None] * n).sum(axis=0) / run.masses[0, 2])
    cross = impulse[0] * impulse[1] * (n[0] @ n[1]) / run.masses[0, 2]
    lost = kinetic(run, 0) - kinetic(run, -1)
    close(lost, contacts["energy_lost"].sum() - cross, scale=kinetic(run, 0))


def test_an_elastic_swarm_without_friction_keeps_its_energy():
    smooth = {"static_friction": 0.0, "dynamic_friction": 0.0}
    run = simulate(swarm(restitution=1.0, **smooth))
    assert len(run.contacts) >= 20
    close(kinetic(run, -1), kinetic(run, 0))
    loses = simulate(swarm(restitution=0.99, **smooth))  # the twin
    assert abs(kinetic(loses, -1) / kinetic(loses, 0) - 1) > 1e-3


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_spheres_and_walls_return_the_restitution(restitution):
    pair = [ball((2e-6, 3e-6, 3e-6), (0.8, 0, 0)), ball((2.97e-6, 3e-6, 3e-6), (0, 0, 0), 0.9e-6)]
    run = simulate(make(60, particle=pair, contact={"restitution": restitution}))
    close(run.velocities[-1][1, 0] - run.velocities[-1][0, 0], 0.8 * restitution, scale=0.8)
    fall = [ball((2e-6, 3e-6, 0.51e-6), (0.3, 0, -0.8))]
    run = simulate(make(60, particle=fall, surface=FLAT, contact={"restitution": restitution}))
    close(run.velocities[-1][0], [0.3, 0.0, 0.8 * restitution], scale=0.8)
    # at e = 0 it stays, but for round-off, and is not hit again
    assert (run.contacts["approach_speed"] > 10 * EPS).sum() == 1


# Removal


@pytest.mark.parametrize("pickup", [True, False])
def test_the_mass_gained_is_the_mass_lost_by_the_surface(pickup):
    """rho_s (V_0 - V) = sum of dm.  A node of height z rounds by eps z/2 at each of 3 n lowerings."""
    run = simulate(rain(removal={"mass_pickup": pickup}))
    n, density = len(run.contacts), MATERIALS["copper"]["density"]
    assert n >= 5
    lost = density * (run.surface_initial.volume() - run.surface.volume())
    gained = (run.masses[-1] - run.masses[0]).sum()
    rounding = density * 3 * n * EPS * 0.4e-6 * run.surface.spacing**2
    np.testing.assert_allclose(lost, run.contacts["removed_mass"].sum(), rtol=ROUND, atol=rounding)
    assert rounding < 1e-4 * lost
    if pickup:
        np.testing.assert_allclose(gained, lost, rtol=ROUND, atol=rounding + n * EPS * run.masses.max())
    else:
        assert np.array_equal(run.masses[-1], run.masses[0])
    close(run.history["removed_mass"].iloc[-1], run.contacts["removed_mass"].sum())
    close(run.history["removed_volume"].iloc[-1] * density, run.history["removed_mass"].iloc[-1])


@pytest.mark.parametrize("speed, removes", [(0.7 * (1 - 1e-9), False), (0.7, True)])
def test_nothing_is_removed_below_the_threshold(speed, removes):
    run = simulate(drop(speed, threshold_velocity=0.7))
    assert len(run.contacts) == 1
    assert (run.contacts["removed_volume"].iloc[0] > 0) == removes
    assert (run.masses[-1, 0] > run.masses[0, 0]) == removes
    assert np.array_equal(run.surface.z, run.surface_initial.z) == (not removes)


@pytest.mark.parametrize("deposit", ["volume", "node_depth"])
def test_acceleration_multiplies_what_is_removed_and_never_the_mass(deposit):
    """One impact on flat ground, where no second impact meets what the first has left."""
    one, ten = (simulate(drop(1.0, deposit=deposit, acceleration=a)) for a in (1.0, 10.0))
    close(ten.surface.z, 10 * one.surface.z)
    assert np.array_equal(ten.masses, one.masses)
    assert np.array_equal(ten.contacts["removed_volume"], one.contacts["removed_volume"])
    assert one.surface.z.min() < 0


def test_volume_takes_the_cap_and_node_depth_takes_its_depth_off_one_node():
    runs = {deposit: simulate(drop(1.0, deposit=deposit)) for deposit in ("volume", "node_depth")}
    row = runs["volume"].contacts.iloc[0]
    modulus = 1 / ((1 - 0.22**2) / 370e9 + (1 - 0.34**2) / 120e9)
    wall = exact.Wall(0.5, modulus, 0.34, 8.2e6, 8960.0, threshold_velocity=0.05)
    hit = exact.removing_impact(runs["volume"].masses[0, 0], 0.5e-6, [0, 0, -1.0], [0, 0, 1.0], wall)
    close([row["yield_radius"], row["depth"], row["removed_volume"]], hit.removal, rtol=1e-9)  # quadrature
    close(-runs["volume"].surface.volume(), row["removed_volume"])
    lowered = np.argwhere(runs["node_depth"].surface.z)
    assert lowered.tolist() == [[2, 3]]
    close(-runs["node_depth"].surface.volume(), 1e-12 * row["depth"])  # h^2 dh
    # a cap of base x_p is pi x_p^2 dh/2 but for (dh/x_p)^2/3: the rules differ by 2 h^2/(pi x_p^2), a hundred
    ratio = 1e-12 * row["depth"] / row["removed_volume"]
    np.testing.assert_allclose(
        ratio,
        2e-12 / (np.pi * row["yield_radius"] ** 2),
        rtol=(row["depth"] / row["yield_radius"]) ** 2,
        atol=0,
    )


# Stationarity


@pytest.mark.parametrize("scheme", ["point_implicit", "fixed_point"])
@pytest.mark.parametrize("flow", ["uniform", "couette"])
def test_particles_that_move_with_the_fluid_do_so_for_ever(scheme, flow):
    """Away from walls, with v = u, no velocity changes by a single bit."""
    part = {"count": 10, "mean_diameter": 0.5e-6, "diameter_spread": 0.3, "material": "alumina"}
    if flow == "uniform":
        fluid, part["z_max"] = WATER | {"velocity": [0.123, -0.0456, 0.0]}, 4e-6
        surface = {"kind": "none", "size": 6e-6}
    else:  # centres are kept at heights where no two meet: each moves at the speed of its own layer
        fluid = {"density": 1000.0, "viscosity": 1e-3, "flow": "couette", "wall_speed": 0.4, "gap": 6e-6}
        surface = FLAT
        part |= {"count": 3, "z_min": 1e-6, "z_max": 5e-6}
    case = make(particles=part, fluid=fluid, surface=surface, numerics={"time_step": 1e-9, "scheme": scheme})
    run = simulate(case)
    assert run.contacts.empty
    assert np.array_equal(run.velocities[-1], run.velocities[0])
    assert np.abs(run.velocities[0][:, 0]).min() > 0.05


def test_a_particle_out_of_step_with_the_fluid_does_not_keep_its_velocity():
    """The twin: one part in 1e9 is seen."""
    u = np.array([0.123, -0.0456, 0.0])
    run = simulate(make(particle=[ball((2e-6,) * 3, u * (1 + 1e-9))], fluid=WATER | {"velocity": list(u)}))
    assert not np.array_equal(run.velocities[-1], run.velocities[0])
    assert np.abs(run.velocities[-1] - u).max() < np.abs(run.velocities[0] - u).max()


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_fluid_at_rest_stops_a_particle_and_no_fluid_does_not(scheme):
    start, numerics = [ball((2e-6,) * 3, (0.2, 0.1, -0.1))], {"time_step": 1e-9, "scheme": scheme}
    tau = 3950.0 * 1e-12 / (18 * 1e-3)
    still = simulate(make(particle=start, fluid=WATER, numerics=numerics))
    expected = exact.implicit_euler_speed(200, np.array([0.2, 0.1, -0.1]), 0.0, 1e-9, tau)
    # the fixed point: 200 steps, each stopped at 1e-6 dt/tau of the velocity
    np.testing.assert_allclose(still.velocities[-1][0], expected, rtol=200 * 1e-6 * 1e-9 / tau, atol=0)
    free = simulate(make(particle=start, numerics=numerics))
    close(free.velocities[-1], free.velocities[0])


def test_one_particle_flies_through_the_sides_of_the_box():
    run = simulate(make(particle=[ball((2e-6, 5e-6, 3e-6), (-20.0, 31.0, -2.0))], outputs=5))
    straight = np.array([2e-6, 5e-6, 3e-6]) + run.times[:, None] * [-20.0, 31.0, -2.0]
    straight[:, :2] %= 6e-6
    close(run.positions[:, 0], straight, scale=6e-6)
    assert run.positions[-1, 0, 2] > -1e-3  # and nothing stops it along z
    close(run.times, np.linspace(0, 200e-9, 5), scale=2e-7)


# Positions are rounded at eps box/d of a diameter, and a collision amplifies that by (flight + d)/d < 10.


def cluster(move=lambda r: r, turn=lambda v: v, order=slice(None), box=4e-5, fluid=None):
    """Eight spheres that fall together and meet, in a periodic box so large that they never leave it."""
    rng = np.random.default_rng(5)
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    position = 1e-6 * corners + rng.uniform(-0.2e-6, 0.2e-6, corners.shape)
    velocity = -1.0 * corners + rng.uniform(-0.3, 0.3, corners.shape)
    diameter = rng.uniform(0.8e-6, 1e-6, len(corners))
    spheres = [
        ball(move(r), turn(v), d)
        for r, v, d in zip(position[order], velocity[order], diameter[order], strict=True)
    ]
    friction = {"restitution": 0.8, "static_friction": 0.3, "dynamic_friction": 0.2}
    return make(
        1500, 4, particle=spheres, surface={"kind": "none", "size": box}, contact=friction, fluid=fluid
    )


def same(run, other, positions=None, velocities=None):
    """Assert that two runs are the same but for the round-off that their collisions amplify."""
    meetings = np.bincount(np.concatenate([run.contacts["i"], run.contacts["j"]])).max()
    assert len(other.contacts) == len(run.contacts) >= 8
    assert meetings <= 6
    tolerance = 10.0**meetings * EPS * 4e-5 / 0.8e-6
    positions = run.positions if positions is None else positions
    velocities = run.velocities if velocities is None else velocities
    np.testing.assert_allclose(other.velocities, velocities, rtol=0, atol=tolerance * 2.0)
    np.testing.assert_allclose(other.positions, positions, rtol=0, atol=tolerance * 4e-6)


CENTRE = np.full(3, 2e-5)


def test_galilean_invariance_with_drag():
    drift = np.array([0.7, -0.4, 0.25])
    still, moving = THIN | {"velocity": [0.1, 0.0, 0.2]}, THIN | {"velocity": [0.8, -0.4, 0.45]}
    run = simulate(cluster(move=lambda r: r + CENTRE, fluid=still))
    other = simulate(cluster(move=lambda r: r + CENTRE, turn=lambda v: v + drift, fluid=moving))
    shifted = run.positions + run.times[:, None, None] * drift
    same(run, other, shifted, run.velocities + drift)
    wrong = simulate(cluster(move=lambda r: r + CENTRE, turn=lambda v: v + drift, fluid=still))  # the twin
    assert np.abs(wrong.velocities[-1] - run.velocities[-1] - drift).max() > 0.1


def test_rotational_invariance():
    turn = Rotation.from_rotvec([0.4, -0.9, 0.3])
    run = simulate(cluster(move=lambda r: r + CENTRE))
    other = simulate(cluster(move=lambda r: turn.apply(r) + CENTRE, turn=turn.apply))
    turned = (run.positions - CENTRE) @ turn.as_matrix().T + CENTRE
    same(run, other, turned, run.velocities @ turn.as_matrix().T)


def test_the_order_of_particles_does_not_matter():
    order = [3, 7, 1, 0, 6, 4, 2, 5]
    run = simulate(cluster(move=lambda r: r + CENTRE))
    other = simulate(cluster(move=lambda r: r + CENTRE, order=order))
    same(run, other, run.positions[:, order], run.velocities[:, order])


def test_a_cluster_across_the_edge_of_the_box_behaves_as_one_in_its_middle():
    run = simulate(cluster(move=lambda r: r + CENTRE))
    half = np.array([2e-5, 2e-5, 0.0])
    other = simulate(cluster(move=lambda r: np.mod(r + CENTRE + half, [4e-5, 4e-5, 1.0])))
    same(run, other, np.mod(run.positions + half, [4e-5, 4e-5, 1.0]))


def test_a_shift_by_whole_squares_of_the_surface_shifts_the_run():
    """Across the period too: heights are rolled, particles wrapped."""
    shift, size = np.array([4, 3]), 6e-6
    one, raw = rain(), rain().model_dump(by_alias=True, exclude_none=True)
    raw["surface"]["raised"] = [((np.array(square) + shift) % 6).tolist() for square in ROUGH["raised"]]
    for entry in raw["particle"]:
        entry["position"] = [*np.mod(np.add(entry["position"][:2], shift * 1e-6), size), entry["position"][2]]
    run, other = simulate(one), simulate(Case.model_validate(raw))
    assert len(run.contacts) == len(other.contacts) >= 5
    # few impacts on planes and edges, which amplify round-off by less than 100
    close(other.velocities, run.velocities, scale=100.0)
    close(other.surface.z, np.roll(run.surface.z, shift, axis=(0, 1)), scale=1e-6)
    assert np.abs(other.surface.z - run.surface.z).max() > 1e-9


def test_a_particle_moves_with_the_velocity_at_the_end_of_the_step():
    """Implicit Euler: r' = r + dt v', to the bit; with the old velocity v the first step is another one."""
    setup = build_setup(load_case("drag_relaxation").variants()[0])
    dt = setup.time_step
    run = simulate_setup(replace(setup, end_time=dt, output_times=np.array([0.0, dt])))
    assert (run.positions[1] == run.positions[0] + dt * run.velocities[1]).all()
    assert (run.velocities[1] != run.velocities[0]).any()
