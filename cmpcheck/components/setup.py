"""How a case is set up: masses, moduli, times, surface, packing, neighbours and random numbers."""

from __future__ import annotations

import math

import numpy as np

from cmpcheck.components.row import EPS, ROUNDING, count, row, worst
from cmpcheck.results import Comparison
from reference import exact
from reference.case import Case, load_case
from reference.drag import fluid_velocity
from reference.ensemble import sample_case
from reference.heightfield import asperity_surface
from reference.neighbors import neighbor_pairs
from reference.process import build_setup, random_streams
from reference.state import Setup
from reference.units import to_si

SAMPLES = 1000
SURFACES = 64
DEVIATIONS = 4.0  # of a mean: exceeded by chance once in 16 000 times, and the seeds are fixed


def checks() -> list[Comparison]:
    """What all engines are given, from the case and geometry alone."""
    polish, swarm = load_case("polish_pair"), build_setup(load_case("swarm"))
    return [
        _units(),
        *_particles(load_case("pair_slip")),
        *_particles(polish),
        *_pad(polish),
        _asperities(polish),
        *_places(swarm),
        *_random_numbers(polish),
    ]


def _units() -> Comparison:
    """Quantities of case files in SI; a psi is a pound-force on a square inch."""
    psi = 0.45359237 * 9.80665 / 0.0254**2
    texts = [("0.9 um", "m", 9e-7), ("0.3 GPa", "Pa", 3e8), ("50 %", "", 0.5), ("4 psi", "Pa", 4.0 * psi)]
    found = np.array([to_si(text, unit) / value for text, unit, value in texts])
    return worst("units", "", found, np.ones(len(texts)), relative=10 * EPS, reason="rounding, 10 eps")


def _particles(case: Case) -> list[Comparison]:
    """Mass of each particle, its share of the mean diameter, and the modulus of a thin loaded layer."""
    setup, state = build_setup(case), build_setup(case).state
    if case.particles is None:
        materials = [case.material[p.material] for p in case.particle]
    else:
        materials = [case.material[case.particles.material]] * case.particles.count
    volumes = [2.0 * exact.cap_volume(r, r) for r in state.diameter / 2]
    mass = np.array([m.density * v for m, v in zip(materials, volumes, strict=True)])
    modulus = np.array([_plane_strain(m.youngs_modulus, m.poisson_ratio) for m in materials])
    rows = [
        worst("mass", "", state.mass, mass, "kg", variant=case.name),
        worst("plane_strain_modulus", "", state.modulus, modulus, "Pa", variant=case.name),
    ]
    if case.surface.material is not None:
        wafer = case.material[case.surface.material]
        expected = np.array([_plane_strain(wafer.youngs_modulus, wafer.poisson_ratio)])
        found = np.array([setup.model.surface_modulus])
        rows.append(worst("plane_strain_modulus", "", found, expected, "Pa", variant=f"{case.name}, surface"))
    if case.particles is not None:
        part = case.particles
        widest = float(np.abs(state.diameter / part.mean_diameter - 1.0).max())
        # of N uniform numbers the widest lies within 1 - 1e-4^(1/N) of the end, 9999 times in 10 000
        slack = part.diameter_spread * -math.expm1(math.log(1e-4) / part.count)
        rows.append(
            row(
                "diameter_spread", "", widest, part.diameter_spread - 0.5 * slack, 0.5 * slack + ROUNDING,
                f"the widest of {part.count} uniform numbers", kind="precision", variant=case.name,
            )
        )  # fmt: skip
    return rows


def _plane_strain(youngs_modulus: float, poisson_ratio: float) -> float:
    """Stress per strain along x where y cannot yield and z is free, from Hooke's law as a linear system."""
    nu = poisson_ratio
    compliance = np.array([[1.0, -nu, -nu], [-nu, 1.0, -nu], [-nu, -nu, 1.0]]) / youngs_modulus
    # unknowns: sigma_x, sigma_y, strain_z; strain_x = 1, strain_y = 0, sigma_z = 0
    system = np.column_stack([compliance[:, 0], compliance[:, 1], [0.0, 0.0, -1.0]])
    return float(np.linalg.solve(system, np.array([1.0, 0.0, 0.0]))[0])


def _pad(case: Case) -> list[Comparison]:
    """The largest step, the pad's way, and the shear layer under it at two heights of the pad."""
    setup, pad = build_setup(case), case.pad
    assert pad is not None
    assert case.particles is not None
    step = case.numerics.gamma * case.particles.mean_diameter / pad.speed
    largest = float(setup.state.diameter.max())
    way = pad.initial_height - setup.model.pad_descent * 0.7 * case.case.duration
    z, heights = 0.4e-6, np.array([1.6e-6, 1.1e-6])
    found = np.array([fluid_velocity(setup.model, h, z)[0] for h in heights])
    return [
        worst("time_step", "40", np.array([setup.time_step]), np.array([step]), "s", variant="from gamma"),
        worst("pad_height", "", np.array([way]), np.array([1.01 * largest]), "m", variant="at 0.7 T"),
        worst("velocity_x", "20", found, pad.speed * z / heights, "m/s", variant="fluid under the pad"),
    ]


def _asperities(case: Case) -> Comparison:
    """The share of raised nodes of many surfaces: squares of four nodes, N_a = rho_a n^2, may overlap."""
    nodes, density = 20, 0.05
    squares = round(density * nodes**2)
    raised = [
        float((asperity_surface(nodes, 1e-5, 1.0, density, np.random.default_rng(k)).z > 0.0).mean())
        for k in range(SURFACES)
    ]
    expected = 1.0 - (1.0 - 4.0 / nodes**2) ** squares
    error = float(np.std(raised, ddof=1)) / math.sqrt(SURFACES)
    reason = f"{DEVIATIONS:g} standard errors of {SURFACES} surfaces"
    return row(
        "raised_nodes", "44", float(np.mean(raised)), expected, DEVIATIONS * error, reason, kind="precision"
    )


def _places(swarm: Setup) -> list[Comparison]:
    """A packed start has no overlap, and every pair within reach is listed once."""
    state, model = swarm.state, swarm.model
    periods = np.array([model.length_x, model.length_y, model.length_z])
    apart = state.position[:, np.newaxis] - state.position
    apart -= periods * np.round(apart / periods)
    distance = np.linalg.norm(apart, axis=2)
    reach = 0.5 * (state.diameter[:, np.newaxis] + state.diameter)
    overlaps = int((np.triu(distance < reach * (1.0 - 1e-12), 1)).sum())
    rows = [count("overlaps", "", overlaps, 0, "all pairs of a packed start, by nearest image", "swarm")]
    for share in (0.16, 0.4):  # of the box: six cells a side, and two, where neighbours meet twice
        cutoff = share * float(periods[0])
        found = [tuple(sorted(pair)) for pair in neighbor_pairs(state.position, cutoff, periods).tolist()]
        near = {tuple(pair) for pair in np.argwhere(np.triu(distance < cutoff, 1)).tolist()}
        wrong = (
            len(near - set(found)) + sum(pair not in near for pair in found) + len(found) - len(set(found))
        )
        rows.append(count("wrong_pairs", "", wrong, 0, "missing, twice or too far", f"cutoff {share:g} D"))
    return rows


def _random_numbers(case: Case) -> list[Comparison]:
    """Samples of one case, and what is drawn in one, share no random numbers."""
    seeds = {sample_case(case, k).case.seed for k in range(SAMPLES)}
    streams = random_streams(case.case.seed)
    draws = {float(stream.random()) for stream in streams.values()}
    first, second = (build_setup(sample_case(case, k)).state for k in (0, 1))
    shared = int(np.isin(first.position, second.position).sum())
    return [
        count("seeds", "", len(seeds), SAMPLES, "samples have seeds of their own"),
        count("streams", "", len(draws), len(streams), "surface, diameters, ... are drawn independently"),
        count("shared_positions", "", shared, 0, "of two samples"),
    ]
