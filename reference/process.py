"""From a case to what is simulated: surface, particles, constants and times (Section 4).

Random numbers come from streams of the case's seed, one for each purpose, so that changing the number of
particles leaves the surface as it was.  Validation of single entries is `case.py`.
"""

from __future__ import annotations

import math

import numpy as np

from reference.case import Case
from reference.case_sections import Material
from reference.contact import effective_modulus
from reference.drag import fluid_velocity
from reference.heightfield import Heightfield, asperity_surface, raise_squares, surface_contact
from reference.neighbors import neighbor_pairs
from reference.packing import PackingError, pack
from reference.removal import yield_velocity
from reference.state import (
    DEPOSIT_NODE_DEPTH,
    DEPOSIT_NONE,
    DEPOSIT_VOLUME,
    FLOW_COUETTE,
    FLOW_NONE,
    FLOW_UNIFORM,
    Model,
    Setup,
    State,
)
from reference.toml_source import MISSING, CaseError

STREAMS = ("surface", "diameters", "positions", "velocities", "jitter")
BOLTZMANN = 1.380649e-23  # J/K
TEMPERATURE = 293.0  # K
MOST_WORK = 1e13  # steps times particles
PAD_DESCENT = 0.7  # part of the duration in which the pad reaches its lowest height


def random_streams(seed: int) -> dict[str, np.random.Generator]:
    """One independent generator for each purpose, spawned from the case's seed."""
    children = np.random.SeedSequence(seed).spawn(len(STREAMS))
    return {name: np.random.default_rng(child) for name, child in zip(STREAMS, children, strict=True)}


def build_setup(case: Case) -> Setup:
    """Everything that is needed to run a case (one of its `variants()`).

    Raises CaseError when the particles cannot be placed, or lie in the surface or in each other, when what
    follows from the case is no number that can be computed with, and when it would take years.
    """
    try:
        with np.errstate(over="ignore", under="ignore", divide="ignore", invalid="ignore"):
            setup = _setup(case)
    except (OverflowError, ZeroDivisionError) as problem:
        raise _beyond_numbers(case, str(problem)) from None
    _check_numbers(setup)
    return setup


def _setup(case: Case) -> Setup:
    streams = random_streams(case.case.seed)
    surface = build_surface(case, streams["surface"])
    diameter, density, modulus = _particle_materials(case, streams["diameters"])
    model = build_model(case, surface, diameter, float(density.max()), float(modulus.max()))
    pad_height = case.pad.initial_height if case.pad else math.nan
    heights = surface.z if surface else np.zeros((0, 0))
    position = _place(case, model, diameter, heights, pad_height, streams)
    state = State(
        time=0.0,
        position=position,
        velocity=_velocities(case, model, position, pad_height, streams["velocities"]),
        mass=density * math.pi * diameter**3 / 6.0,
        diameter=diameter,
        modulus=modulus,
        heights=heights,
        pad_height=pad_height,
    )
    setup = Setup(
        case=case,
        model=model,
        state=state,
        time_step=case.numerics.time_step or _pad_step(case, diameter),
        end_time=case.case.duration,
        output_times=np.linspace(0.0, case.case.duration, case.case.outputs),
    )
    setup.notes.extend(_warnings(setup))
    return setup


def _beyond_numbers(case: Case, what: str) -> CaseError:
    return CaseError(
        f"{case.path or case.name}: the values of this case are too large or too small to compute with "
        f"({what}); allowed: values of which masses, moduli and steps are finite and not zero"
    )


def _check_numbers(setup: Setup) -> None:
    """Refuse what overflows or vanishes in floating point, and what no machine would finish."""
    case, state = setup.case, setup.state
    arrays = {"mass": state.mass, "modulus": state.modulus, "diameter^3": state.diameter**3}
    for name, values in arrays.items():
        if not (np.isfinite(values) & (values > 0.0)).all():
            raise _beyond_numbers(case, f"the {name} of a particle is {values.min():g} to {values.max():g}")
    constants = {name: value for name, value in setup.model._asdict().items() if isinstance(value, float)}
    for name, value in constants.items():
        if not math.isfinite(value):
            raise _beyond_numbers(case, f"{name} is {value:g}")
    if setup.model.has_surface and not 0.0 < setup.model.spacing**3 < math.inf:
        raise _beyond_numbers(case, f"the spacing of the nodes is {setup.model.spacing:g} m")
    if not 0.0 < setup.time_step < math.inf:
        raise _beyond_numbers(case, f"the time step is {setup.time_step:g} s")
    if not (np.diff(setup.output_times) > 0.0).all():
        raise _beyond_numbers(case, "output times do not rise")
    work = len(state.mass) * (setup.end_time / setup.time_step)
    if not work <= MOST_WORK:
        raise case.error(
            "case.duration",
            case.case.duration,
            f"{work:.1e} steps times particles, with steps of {setup.time_step:g} s; allowed: up to "
            f"{MOST_WORK:.0e}, weeks of computing",
        )


def build_surface(case: Case, rng: np.random.Generator) -> Heightfield | None:
    """The initial surface, or None."""
    part = case.surface
    if part.kind == "none":
        return None
    assert part.nodes is not None
    if part.kind == "flat":
        return raise_squares(part.nodes, part.size, 0.0, [])
    assert part.asperity_height is not None
    if part.raised is not None:
        return raise_squares(part.nodes, part.size, part.asperity_height, part.raised)
    assert part.asperity_density is not None
    return asperity_surface(part.nodes, part.size, part.asperity_height, part.asperity_density, rng)


def _plane_strain_modulus(material: Material) -> float:
    return material.youngs_modulus / (1.0 - material.poisson_ratio**2)


def _particle_materials(case: Case, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Diameter, density and E/(1-nu^2) of each particle, (N,) each."""
    if case.particles is None:
        materials = [case.material[p.material] for p in case.particle]
        diameter = np.array([p.diameter for p in case.particle])
    else:
        part = case.particles
        materials = [case.material[part.material]] * part.count
        spread = part.diameter_spread * (2.0 * rng.random(part.count) - 1.0)
        diameter = part.mean_diameter * (1.0 + spread)  # d_min + (d_max - d_min) Phi
    density = np.array([material.density for material in materials])
    return diameter, density, np.array([_plane_strain_modulus(material) for material in materials])


def build_model(
    case: Case, surface: Heightfield | None, diameter: np.ndarray, density: float, modulus: float
) -> Model:
    """The constants of a case; density and modulus of the particles set the default threshold."""
    fluid, contact, removal, pad = case.fluid, case.contact, case.removal, case.pad
    flow = FLOW_NONE if fluid is None else {"uniform": FLOW_UNIFORM, "couette": FLOW_COUETTE}[fluid.flow]
    u = fluid.velocity if fluid is not None and fluid.velocity is not None else (0.0, 0.0, 0.0)
    wafer = case.material[case.surface.material] if case.surface.material else None
    surface_modulus = _plane_strain_modulus(wafer) if wafer else 0.0
    deposit, threshold = DEPOSIT_NONE, None
    if removal is not None:
        assert wafer is not None
        assert wafer.yield_stress is not None
        deposit = {"volume": DEPOSIT_VOLUME, "node_depth": DEPOSIT_NODE_DEPTH}[removal.deposit]
        threshold = removal.threshold_velocity
        if threshold is None:
            e_star = float(effective_modulus(modulus, surface_modulus))
            threshold = yield_velocity(density, e_star, wafer.yield_stress)
    pad_minimum, pad_descent = 0.0, 0.0
    if pad is not None:
        pad_minimum = pad.minimum_height or 1.01 * float(diameter.max())
        pad_descent = max(pad.initial_height - pad_minimum, 0.0) / (PAD_DESCENT * case.case.duration)
    return Model(
        length_x=case.surface.size,
        length_y=case.surface.size,
        length_z=case.surface.height or 0.0,
        restitution=contact.restitution,
        static_friction=contact.static_friction,
        dynamic_friction=contact.dynamic_friction,
        impact_duration=contact.impact_duration or 0.0,
        flow=flow,
        fluid_density=fluid.density if fluid else 0.0,
        viscosity=fluid.viscosity if fluid else 0.0,
        flow_x=u[0],
        flow_y=u[1],
        flow_z=u[2],
        wall_speed=pad.speed if pad else (fluid.wall_speed or 0.0) if fluid else 0.0,
        gap=(fluid.gap or 0.0) if fluid else 0.0,
        has_surface=surface is not None,
        spacing=surface.spacing if surface else 0.0,
        surface_modulus=surface_modulus,
        surface_density=wafer.density if wafer else 0.0,
        poisson_ratio=wafer.poisson_ratio if wafer else 0.0,
        yield_stress=(wafer.yield_stress or 0.0) if wafer else 0.0,
        deposit=deposit,
        acceleration=removal.acceleration if removal else 0.0,
        mass_pickup=removal.mass_pickup if removal else False,
        threshold_velocity=threshold or 0.0,
        has_pad=pad is not None,
        pad_restitution=pad.restitution if pad else 0.0,
        pad_descent=pad_descent,
        pad_minimum=pad_minimum,
        new_contacts_only=removal.new_contacts_only if removal else False,
        has_pairs=contact.pairs,
    )


def _place(
    case: Case,
    model: Model,
    diameter: np.ndarray,
    heights: np.ndarray,
    pad_height: float,
    streams: dict[str, np.random.Generator],
) -> np.ndarray:
    """Initial centres (N, 3), packed at random or as the case gives them, and checked."""
    radius = 0.5 * diameter
    periods = np.array([model.length_x, model.length_y, model.length_z])
    if case.particles is not None:
        low = radius if model.has_surface else np.zeros_like(radius)
        low = np.maximum(low, case.particles.z_min) if case.particles.z_min is not None else low
        high = pad_height - radius if model.has_pad else np.full_like(radius, model.length_z or math.inf)
        high = np.minimum(high, case.particles.z_max) if case.particles.z_max is not None else high
        if not np.isfinite(high).all():
            raise case.error("particles.z_max", MISSING, "required where neither a pad nor a period bounds z")
        try:
            return pack(diameter, periods, low, high, heights, model.spacing, streams["positions"])
        except PackingError as problem:
            raise case.error("particles.count", case.particles.count, str(problem)) from None
    position = np.array([p.position for p in case.particle], dtype=float)
    jitter = np.array([p.position_jitter for p in case.particle])[:, np.newaxis]
    position[:, :2] += jitter * (2.0 * streams["jitter"].random((len(case.particle), 2)) - 1.0)
    position[:, :2] %= periods[:2]
    _check_places(case, model, position, radius, heights, periods)
    return position


def _check_places(
    case: Case,
    model: Model,
    position: np.ndarray,
    radius: np.ndarray,
    heights: np.ndarray,
    periods: np.ndarray,
) -> None:
    """Refuse explicit particles that lie in the true surface or, jittered, in each other."""
    for k, (x, y, z) in enumerate(position if model.has_surface else ()):
        if surface_contact(heights, model.spacing, x, y, z, radius[k] * (1.0 - 1e-12))[0]:
            raise case.error(
                f"particle.{k}.position", [x, y, z], "below or in the surface; allowed: above it"
            )
    pairs = neighbor_pairs(position, 2.0 * radius.max() * (1.0 - 1e-12), periods)
    for i, j in pairs:
        apart = position[j] - position[i]
        apart -= np.where(periods > 0, periods, 0.0) * np.round(
            apart / np.where(periods > 0, periods, np.inf)
        )
        if np.linalg.norm(apart) < (radius[i] + radius[j]) * (1.0 - 1e-12):
            raise case.error(
                f"particle.{j}.position", list(position[j]), f"overlaps particle {i}; allowed: apart"
            )


def _velocities(
    case: Case, model: Model, position: np.ndarray, pad_height: float, rng: np.random.Generator
) -> np.ndarray:
    """Initial velocities: v_min + (v_max - v_min) Phi, as given, or the local velocity of the fluid."""
    if case.particles is None:
        return np.array([p.velocity for p in case.particle], dtype=float)
    low, high = case.particles.velocity_min, case.particles.velocity_max
    if low is None or high is None:
        return np.array([fluid_velocity(model, pad_height, z) for z in position[:, 2]], dtype=float)
    return np.array(low) + (np.array(high) - np.array(low)) * rng.random(position.shape)


def _pad_step(case: Case, diameter: np.ndarray) -> float:
    """dt_lim = gamma d/V_pad (footnote 1 of the paper)."""
    assert case.pad is not None
    mean = case.particles.mean_diameter if case.particles else float(diameter.mean())
    return case.numerics.gamma * mean / case.pad.speed


def relaxation_time(setup: Setup) -> float:
    """Tau = m/(3 pi mu d) of Stokes's drag, the shortest of all particles, s."""
    state = setup.state
    return float((state.mass / (3.0 * math.pi * setup.model.viscosity * state.diameter)).min())


def flow_speed(setup: Setup) -> float:
    """U, the largest speed of the fluid or of the pad, m/s."""
    model = setup.model
    return max(abs(model.wall_speed), math.hypot(model.flow_x, model.flow_y, model.flow_z))


def pressed_speed(setup: Setup, time_step: float) -> float:
    """2 U dt/tau: how fast a particle that the flow presses on the surface is struck at every step, m/s."""
    return 2.0 * flow_speed(setup) * time_step / relaxation_time(setup)


def _warnings(setup: Setup) -> list[str]:
    """What a user should know before trusting the run."""
    model, state, notes = setup.model, setup.state, []
    if model.deposit != DEPOSIT_NONE and model.flow != FLOW_NONE and state.mass.size:
        pressed = pressed_speed(setup, setup.time_step)
        if model.threshold_velocity < pressed:
            notes.append(
                f"threshold_velocity {model.threshold_velocity:.3g} m/s is below 2 U dt/tau = "
                f"{pressed:.3g} m/s: a particle pressed on the surface removes material at every step"
            )
    if model.flow != FLOW_NONE and state.mass.size:
        thermal = thermal_speed(float(state.mass.mean()))
        what, speed = max(
            ("flow's", math.hypot(model.flow_x, model.flow_y, model.flow_z)),
            ("pad's" if model.has_pad else "wall's", abs(model.wall_speed)),
            ("particles' own", float(np.linalg.norm(state.velocity, axis=1).max())),
            key=lambda entry: entry[1],
        )
        if thermal > speed:
            notes.append(
                f"the thermal speed of a particle, sqrt(3 k T/m) = {thermal:.3g} m/s at {TEMPERATURE:g} K, "
                f"exceeds the {what} {speed:.3g} m/s: Brownian motion would dominate, and is not in the model"
            )
    return notes


def thermal_speed(mass: float) -> float:
    """Root mean square speed sqrt(3 k T/m) of the Brownian motion of a particle, in m/s.

    The paper has none; cases have no temperature, so that T is 293 K, room temperature.

    >>> round(thermal_speed(1.2135e-20), 3)  # 3 k T = 1.2136e-20 J
    1.0
    """
    return math.sqrt(3.0 * BOLTZMANN * TEMPERATURE / mass)
