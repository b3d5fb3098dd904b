"""Errors in what an impact removes: Eqs 32-36, and the mass that is picked up."""

from __future__ import annotations

from cmpcheck.sensitivity.mutants import Mutant

REMOVAL, COLLISIONS, SCHEMES = "reference/removal.py", "reference/collisions.py", "reference/schemes.py"
ON_A_WALL = ("wall_bounce pickup", "asperity_bounce flank")

MUTANTS = (
    Mutant(
        "axial stress", "sigma_z of Eq 32 is off by a factor",
        f"{REMOVAL}:boussinesq_stress",
        "sigma_z = -3.0 * p * z**3", "sigma_z = -3.0 * (1.0 + SIZE) * p * z**3",
        0.01, "%",
    ),
    Mutant(
        "shear in von Mises", "the shear stress in Eq 33 is off by a factor",
        f"{REMOVAL}:von_mises",
        "3.0 * tau_rz**2", "3.0 * (1.0 + SIZE) * tau_rz**2",
        0.01, "%",
    ),
    Mutant(
        "no root of 3", "Eq 34 lacks the root of 3",
        f"{REMOVAL}:yield_radius",
        "math.sqrt(3.0) * load", "load",
    ),
    Mutant(
        "no Poisson's ratio", "Eq 34 lacks 1 - 2 nu",
        f"{REMOVAL}:yield_radius",
        "load * (1.0 - 2.0 * poisson_ratio)", "load",
    ),
    Mutant(
        "yield stress", "sigma_y in Eq 34 is off by a factor",
        f"{REMOVAL}:yield_radius",
        "math.pi * yield_stress)", "math.pi * (1.0 + SIZE) * yield_stress)",
        0.01, "%",
    ),
    Mutant(
        "height for depth", "Eq 35 gives the height of the sphere's other cap",
        f"{REMOVAL}:indentation_depth",
        "return x_p * x_p / (radius + np.sqrt((radius - x_p) * (radius + x_p)))",
        "return radius + np.sqrt((radius - x_p) * (radius + x_p))",
    ),
    Mutant(
        "diameter in Eq 35", "the diameter stands for the radius",
        f"{REMOVAL}:cap",
        "depth = indentation_depth(x_p, radius)", "depth = indentation_depth(x_p, 2.0 * radius)",
    ),
    Mutant(
        "cap volume", "Eq 36 is off by a factor",
        f"{REMOVAL}:cap_volume",
        "/ 6.0\n", "/ 6.0 * (1.0 + SIZE)\n",
        0.01, "%",
    ),
    Mutant(
        "no hemisphere", "x_p is not limited to the radius",
        f"{REMOVAL}:cap",
        "x_p = np.minimum(yield_radius(load, poisson_ratio, yield_stress), radius)",
        "x_p = yield_radius(load, poisson_ratio, yield_stress)",
    ),
    Mutant(
        "default threshold", "the yield velocity is off by a factor",
        f"{REMOVAL}:yield_velocity",
        "return math.sqrt(26.0", "return (1.0 + SIZE) * math.sqrt(26.0",
        0.05, "%",
    ),
    Mutant(
        "threshold ignored", "impacts below the threshold remove too",
        f"{COLLISIONS}:record_surface_impact",
        "if model.deposit != DEPOSIT_NONE and -v_n >= model.threshold_velocity:",
        "if model.deposit != DEPOSIT_NONE:",
    ),
    Mutant(
        "density of the surface", "rho_s in Eq 36 is off by a factor",
        f"{COLLISIONS}:record_surface_impact",
        "volume * model.surface_density", "(1.0 + SIZE) * volume * model.surface_density",
        0.01, "%",
    ),
    Mutant(
        "mass not picked up", "the particle stays as heavy as it was",
        "reference/timestep.py:accept",
        "            p.mass[i] = mass\n", "            p.mass[i] = p.mass[i]\n",
    ),
    Mutant(
        "mass picked up always", "the particle carries the mass also where mass_pickup is false",
        f"{COLLISIONS}:deliver",
        "            if model.mass_pickup:\n                work.gained",
        "            if model.deposit != DEPOSIT_NONE:\n                work.gained",
    ),
    Mutant(
        "tangential velocity kept", "the mass picked up does not slow the particle along x (Eq 24)",
        f"{SCHEMES}:solve_particle",
        "(jx + dt * k * (ux - vx) - gained * vx) / inertia",
        "(jx + dt * k * (ux - vx)) / inertia",
    ),
    Mutant(
        "m for m + dm", "the particle that has picked up mass moves as if it had not",
        f"{SCHEMES}:solve_particle",
        "inertia = (mass + gained) + dt * k\n", "inertia = mass + dt * k\n",
    ),
    Mutant(
        "dm for m + dm", "the energy lost at the surface is that of the mass picked up",
        f"{COLLISIONS}:impact_energy_lost",
        "after / (2.0 * (mass + gained))", "after / (2.0 * (mass + gained * SIZE))",
        0.5, "% of dm missing",
    ),
    Mutant(
        "acceleration", "A multiplies nothing",
        f"{COLLISIONS}:lower_surface",
        "model.acceleration * depth", "depth",
    ),
    Mutant(
        "no root of 3, in LAMMPS", "Eq 34 lacks the root of 3 on LAMMPS's side only",
        f"{REMOVAL}:yield_radius",
        "math.sqrt(3.0) * load", "load",
        side="lammps", cases=ON_A_WALL,
    ),
    Mutant(
        "no root of 3, in both", "Eq 34 lacks the root of 3 in both engines, which share it",
        f"{REMOVAL}:yield_radius",
        "math.sqrt(3.0) * load", "load",
        side="both", cases=ON_A_WALL,
    ),
    Mutant(
        "cap volume, in LAMMPS", "Eq 36 is off by a factor on LAMMPS's side only",
        f"{REMOVAL}:cap_volume",
        "/ 6.0\n", "/ 6.0 * (1.0 + SIZE)\n",
        0.01, "%", side="lammps", cases=ON_A_WALL,
    ),
    Mutant(
        "cap volume, in both", "Eq 36 is off by a factor in both engines, which share it",
        f"{REMOVAL}:cap_volume",
        "/ 6.0\n", "/ 6.0 * (1.0 + SIZE)\n",
        0.01, "%", side="both", cases=ON_A_WALL,
    ),
)  # fmt: skip
