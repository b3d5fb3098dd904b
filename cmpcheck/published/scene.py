"""From a benchmark to spheres in a box: one material, one contact law, one time step, the whole sweep.

Every member of the sweep has copies whose first touch lies at equally spaced phases of a step.  The spheres
are so far apart that they never meet another member.  What an engine makes of it is `run_*.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cmpcheck.published.benchmark import Benchmark, Material
from reference.exact import hertz

PHASES = 16
STEPS_PER_CONTACT = 100  # on the coarsest level, of the shortest contact
DAMPED = 4  # times as many where only restitution is measured: one sphere, and its dashpot is of first order
LEVELS = {"quick": 3, "full": 4}  # each halves the step of the one before
LEAD = 2.0  # steps before the first touch
RIGID = 1e9  # a rigid wall's modulus over the sphere's: E* misses the rigid limit by 1e-9 of itself
TIMEOUT = 120.0  # s of wall-clock time for the run of a scene, which takes well below one
MODELS = ("hertz", "spring-dashpot")


@dataclass(frozen=True)
class Contact:
    """A contact law with its constants, and the scales of an impact with it."""

    model: str  # one of MODELS
    mass: float  # effective, kg
    restitution: float
    friction: float
    normal: float  # K, N/m^1.5, or k, N/m
    shear: float  # S of S sqrt(d), N/m^1.5, or k_t, N/m
    speed: float  # the largest speed of approach of the sweep, m/s

    def impact(self, speed: float) -> hertz.ElasticImpact:
        """Extremes of the impact without damping."""
        of_model = hertz.hertz_impact if self.model == "hertz" else hertz.spring_impact
        return of_model(self.mass, self.normal, speed)


@dataclass(frozen=True)
class Scene:
    """Spheres with positions (N, 3), velocities and spins; SI."""

    contact: Contact
    variables: dict[str, float]  # of the deck
    pairs: bool  # particle 2k meets 2k + 1; else each the plane z = 0, at rest
    radius: float
    mass: float
    position: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    time_step: float
    steps: int
    watched: bool  # the deepest approach and the largest force are looked for at every step


@dataclass(frozen=True)
class After:
    """What an engine made of a scene; one row for each particle, in the scene's order."""

    position: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    deepest: np.ndarray  # (N,), m; nan unless watched
    force: np.ndarray  # (N,), N


def contact_of(benchmark: Benchmark, material: Material, model: str, restitution: float) -> Contact:
    """The contact of a material in a model.

    Springs that the publication does not state give the contact Hertz's duration at the largest speed of
    approach, k = m (pi^2 + ln^2 e)/t_c^2, and its ratio of stiffnesses k_t/k = 4 G*/E* (Mindlin 1949).
    """
    pairs, nu = benchmark.against == "sphere", material.poisson_ratio
    modulus = hertz.plane_strain_modulus(material.youngs_modulus, nu)
    shear = hertz.shear_modulus(material.youngs_modulus, nu)
    mass = 4.0 / 3.0 * math.pi * benchmark.radius**3 * material.density
    if pairs:
        modulus, shear = hertz.in_series(modulus, modulus), hertz.in_series(shear, shear)
    elif material.wall_youngs_modulus is not None and material.wall_poisson_ratio is not None:
        wall = material.wall_youngs_modulus, material.wall_poisson_ratio
        modulus = hertz.in_series(modulus, hertz.plane_strain_modulus(*wall))
        shear = hertz.in_series(shear, hertz.shear_modulus(*wall))
    radius, mass = (benchmark.radius / 2.0, mass / 2.0) if pairs else (benchmark.radius, mass)
    speed = max(normal_speeds(benchmark))
    stiffness = hertz.hertz_stiffness(modulus, radius)
    tangential = hertz.mindlin_stiffness(shear, radius)
    if model == "spring-dashpot":
        duration = hertz.hertz_impact(mass, stiffness, speed).duration
        stiffness = mass * (math.pi**2 + math.log(restitution) ** 2) / duration**2
        tangential = stiffness * 4.0 * shear / modulus
        if benchmark.springs is not None:
            stiffness, tangential = benchmark.springs.normal, benchmark.springs.shear
    return Contact(model, mass, restitution, benchmark.friction, stiffness, tangential, speed)


def normal_speeds(benchmark: Benchmark) -> np.ndarray:
    """Speed of approach of each member of the sweep, of two spheres together, m/s."""
    sweep = benchmark.sweep
    if sweep.kind == "angle":
        return sweep.speed * np.cos(np.radians(sweep.values))
    return np.full(len(sweep.values), sweep.speed * (2.0 if benchmark.against == "sphere" else 1.0))


def tangential_speeds(benchmark: Benchmark) -> np.ndarray:
    """Speed along the wall of each member of the sweep, m/s."""
    sweep = benchmark.sweep
    if sweep.kind == "angle":
        return sweep.speed * np.sin(np.radians(sweep.values))
    return np.array(sweep.values) if sweep.kind == "tangential_speed" else np.zeros(len(sweep.values))


def build_scene(benchmark: Benchmark, material: Material, contact: Contact, level: int) -> Scene:
    """The whole sweep at one level of refinement, 0 the coarsest."""
    pairs, r = benchmark.against == "sphere", benchmark.radius
    sweep = benchmark.sweep
    values = sweep.values if sweep.kind != "restitution" else (contact.restitution,)
    normal, tangential = normal_speeds(benchmark), tangential_speeds(benchmark)
    if sweep.kind == "restitution":
        normal, tangential = normal[:1], tangential[:1]
    steps_per_contact = STEPS_PER_CONTACT * (DAMPED if sweep.kind == "restitution" else 1)
    time_step = contact.impact(contact.speed).duration / (steps_per_contact * 2**level)
    z = hertz.damping_ratio(contact.restitution)
    # with its dashpot a linear contact lasts 1/sqrt(1 - z^2) as long, a Hertz one a little longer; z is room
    longest = (1.1 + z) * contact.impact(float(normal.min())).duration / math.sqrt(1.0 - z * z)
    steps = math.ceil(LEAD + 2.0 + longest / time_step)
    lead = time_step * (LEAD + np.arange(PHASES) / PHASES)
    members, copies = np.meshgrid(np.arange(len(values)), np.arange(PHASES), indexing="ij")
    gap = normal[members] * lead[copies]
    cell = 6.0 * r if pairs else 4.0 * r
    x, y = cell * (members + 0.5), 4.0 * r * (copies + 0.5)
    zero = np.zeros_like(gap)

    def rows(*columns: np.ndarray) -> np.ndarray:
        return np.stack([column.ravel() for column in columns], axis=1)

    if pairs:
        half = r + gap / 2.0
        speed = normal[members] / 2.0
        first, second = rows(x - half, y, zero + r), rows(x + half, y, zero + r)
        position = np.stack([first, second], axis=1).reshape(-1, 3)
        velocity = np.stack([rows(speed, zero, zero), rows(-speed, zero, zero)], axis=1).reshape(-1, 3)
        omega = np.array(values)[members] if sweep.kind == "spin" else zero
        spin = np.stack([rows(zero, zero, omega), rows(zero, zero, -omega)], axis=1).reshape(-1, 3)
    else:
        position = rows(x, y, r + gap)
        velocity = rows(tangential[members], zero, -normal[members])
        spin = np.zeros_like(velocity)
    wall = (material.wall_youngs_modulus, material.wall_poisson_ratio)
    variables = {
        "hertz": float(contact.model == "hertz"),
        "radius": r,
        "density": material.density,
        "restitution": contact.restitution,
        "friction": contact.friction,
        "youngs_modulus": material.youngs_modulus,
        "poisson_ratio": material.poisson_ratio,
        "wall_youngs_modulus": wall[0] or RIGID * material.youngs_modulus,
        "wall_poisson_ratio": material.poisson_ratio if wall[1] is None else wall[1],
        "normal_stiffness": contact.normal,
        "shear_stiffness": contact.shear,
        "time_step": time_step,
        "length_x": cell * len(values),
        "length_y": 4.0 * r * PHASES,
        "height": 4.0 * r,
    }
    mass = contact.mass * (2.0 if pairs else 1.0)
    return Scene(
        contact, variables, pairs, r, mass, position, velocity, spin, time_step, steps, sweep.kind == "normal"
    )


def separation(scene: Scene, position: np.ndarray) -> np.ndarray:
    """Gap of each particle to what it strikes, m; negative while they touch."""
    if not scene.pairs:
        return position[:, 2] - scene.radius
    gap = np.linalg.norm(position[1::2] - position[::2], axis=1) - 2.0 * scene.radius
    return np.repeat(gap, 2)
