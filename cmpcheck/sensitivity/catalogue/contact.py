"""Errors in impulses of pairs and of particle and surface: Eqs 3-19, 23-31."""

from __future__ import annotations

from cmpcheck.sensitivity.mutants import Mutant

CONTACT, COLLISIONS = "reference/contact.py", "reference/collisions.py"

MUTANTS = (
    Mutant(
        "pair restitution", "e of two particles is off by a factor",
        f"{CONTACT}:pair_normal_impulse",
        "(1.0 + restitution) * m_eff * v_approach",
        "(1.0 + restitution * (1.0 + SIZE)) * m_eff * v_approach",
        0.01, "%",
    ),
    Mutant(
        "Eq 9 as printed", "the masses under the integrals of Eq 9 are swapped",
        f"{CONTACT}:pair_normal_impulse",
        "ext_i / mass_i - ext_j / mass_j", "ext_i / mass_j - ext_j / mass_i",
    ),
    Mutant(
        "drag in Eq 9", "the drag over the compression of two particles is off by a factor",
        f"{CONTACT}:pair_normal_impulse",
        "v_in - v_jn + ext_i / mass_i - ext_j / mass_j",
        "v_in - v_jn + (1.0 + SIZE) * (ext_i / mass_i - ext_j / mass_j)",
        0.5, "%",
    ),
    Mutant(
        "dynamic friction", "mu_d is off by a factor",
        f"{CONTACT}:friction_impulse_per_slip",
        "return dynamic_friction * normal_impulse / slip_speed",
        "return (1.0 + SIZE) * dynamic_friction * normal_impulse / slip_speed",
        0.01, "%",
    ),
    Mutant(
        "friction drives", "friction has the wrong sign while particles slip",
        f"{CONTACT}:friction_impulse_per_slip",
        "return dynamic_friction * normal_impulse / slip_speed",
        "return -dynamic_friction * normal_impulse / slip_speed",
    ),
    Mutant(
        "slip and stick swapped", "contacts slip within the limit of static friction and stick beyond it",
        f"{CONTACT}:friction_impulse_per_slip",
        "if m_eff * slip_speed <= static_friction * normal_impulse:",
        "if m_eff * slip_speed > static_friction * normal_impulse:",
    ),
    Mutant(
        "static friction", "mu_s, where sticking ends, is off by a factor",
        f"{CONTACT}:friction_impulse_per_slip",
        "<= static_friction * normal_impulse:", "<= (1.0 + SIZE) * static_friction * normal_impulse:",
        0.5, "%",
    ),
    Mutant(
        "stick impulse", "the impulse that cancels the slip is off by a factor",
        f"{CONTACT}:friction_impulse_per_slip",
        "        return m_eff\n", "        return (1.0 + SIZE) * m_eff\n",
        0.01, "%",
    ),
    Mutant(
        "wall restitution", "e of particle and surface is off by a factor",
        f"{CONTACT}:surface_normal_impulse",
        "-(1.0 + restitution) * (mass * v_n + ext)",
        "-(1.0 + restitution * (1.0 + SIZE)) * (mass * v_n + ext)",
        0.01, "%",
    ),
    Mutant(
        "drag pulls in Eq 30", "the drag over the compression at the surface has the wrong sign",
        f"{CONTACT}:surface_normal_impulse",
        "(mass * v_n + ext)", "(mass * v_n - ext)",
    ),
    Mutant(
        "Eq 29", "the velocity after an impact on the surface is off by a factor (the public function)",
        f"{CONTACT}:surface_normal_velocity",
        "/ (mass + mass_removed)", "* (1.0 + SIZE) / (mass + mass_removed)",
        0.01, "%",
    ),
    Mutant(
        "Hertz's duration", "the factor 2.87 is off",
        f"{CONTACT}:impact_duration",
        "return HERTZ *", "return (1.0 + SIZE) * 2.87 *",
        0.01, "%",
    ),
    Mutant(
        "Hertz's speed", "the exponent 1/5 of Hertz's duration is off",
        f"{CONTACT}:impact_duration",
        "speed)) ** 0.2", "speed)) ** (0.2 + SIZE)",
        0.001, "of the exponent", factor=1.0,
    ),
    Mutant(
        "diameter in Hertz's duration", "the diameter stands for the radius",
        f"{COLLISIONS}:record_surface_impact",
        "duration_of(model, mass, radius, effective_modulus(modulus, model.surface_modulus), -v_n)",
        "duration_of(model, mass, diameter, effective_modulus(modulus, model.surface_modulus), -v_n)",
    ),
    Mutant(
        "compression is the whole contact",
        "drag acts over the whole contact in Eqs 9 and 29, not up to delta t_1",
        f"{CONTACT}:compression_impulse",
        "np.minimum(duration, time_step) / (1.0 + restitution)", "np.minimum(duration, time_step)",
    ),
    Mutant(
        "drag in the load", "the drag's part of the load P is off by a factor",
        f"{CONTACT}:mean_load",
        "compression_impulse(external_force, duration, math.inf, restitution)",
        "compression_impulse((1.0 + SIZE) * external_force, duration, math.inf, restitution)",
        0.5, "%",
    ),
    Mutant(
        "effective modulus", "E* is off by a factor",
        f"{CONTACT}:effective_modulus",
        "return modulus_i * modulus_j / (modulus_i + modulus_j)",
        "return (1.0 + SIZE) * modulus_i * modulus_j / (modulus_i + modulus_j)",
        0.01, "%",
    ),
    Mutant(
        "slip keeps its normal part", "the slip of Eq 13 is the whole relative velocity",
        f"{COLLISIONS}:pair_impulse",
        "sx, sy, sz = vx - separation * nx, vy - separation * ny, vz - separation * nz",
        "sx, sy, sz = vx, vy, vz",
    ),
    Mutant(
        "drag in Eq 14", "the drag's part of the slip has the wrong sign along x",
        f"{COLLISIONS}:pair_impulse",
        "wx = sx - ((eix", "wx = sx + ((eix",
    ),
    Mutant(
        "contact distance", "particles collide at another distance than half the sum of their diameters",
        f"{COLLISIONS}:collide_pairs",
        "reach = 0.5 * (d_i + d_j)", "reach = (1.0 + SIZE) * 0.5 * (d_i + d_j)",
        0.01, "%",
    ),
    Mutant(
        "periodic image of pairs", "pairs across the boundary in x do not meet",
        f"{COLLISIONS}:collide_pairs",
        "dx = minimum_image(p.position[j, 0] - p.position[i, 0], model.length_x)",
        "dx = p.position[j, 0] - p.position[i, 0]",
    ),
    Mutant(
        "reaction of j", "particle j does not get the opposite impulse in y (Eq 12)",
        f"{COLLISIONS}:collide_pairs",
        "impulse[j, axis] -= given", "impulse[j, axis] -= given * (axis != 1)",
    ),
    Mutant(
        "energy of a pair", "the energy that a pair loses is booked wrongly",
        f"{COLLISIONS}:pair_impulse",
        "lost -= (normal * normal + friction * friction) / (2.0 * m_eff)",
        "lost -= (1.0 + SIZE) * (normal * normal + friction * friction) / (2.0 * m_eff)",
        0.01, "%",
    ),
)  # fmt: skip
