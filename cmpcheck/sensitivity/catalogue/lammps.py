"""Errors on LAMMPS's side alone: in the Python fix, in its calibration, and in decks."""

from __future__ import annotations

from cmpcheck.sensitivity.mutants import Mutant

FIXES = "cmpcheck/fixes"
WALL = ("wall_bounce pickup",)
OBLIQUE = ("wall_oblique 30deg",)
PAD = ("pad_strike",)

MUTANTS = (
    Mutant(
        "fix: radius in the drag", "the fix takes the drag of a sphere half as wide",
        f"{FIXES}/sweep.py:sweep_form",
        "diameter = 2.0 * (radius[i] * MICRO)", "diameter = radius[i] * MICRO",
        side="lammps", cases=("bounce_train", "pair_drag"),
    ),
    Mutant(
        "fix: drag", "the fix's drag is off by a factor",
        f"{FIXES}/sweep.py:stokes_factor",
        "return drag_factor(0.0, 1.0, model.fluid_density, model.viscosity)",
        "return (1.0 + SIZE) * drag_factor(0.0, 1.0, model.fluid_density, model.viscosity)",
        0.01, "%", side="lammps", cases=("bounce_train",),
    ),
    Mutant(
        "fix: dashpot", "the dashpot of a soft contact with surface or pad is off by a factor",
        f"{FIXES}/calibration.py:spring_dashpot",
        "mass * (spring * overlap - damping * v_n)",
        "mass * (spring * overlap - (1.0 + SIZE) * damping * v_n)",
        0.01, "%", side="lammps", cases=(*WALL, *PAD),
    ),
    Mutant(
        "fix: contact duration", "soft contacts with the surface last shorter than they are asked to",
        f"{FIXES}/calibration.py:spring",
        "omega0 = 2.0 * _half_phase(z) / contact_duration",
        "omega0 = (1.0 + SIZE) * 2.0 * _half_phase(z) / contact_duration",
        0.5, "%", side="lammps", cases=(*WALL, *OBLIQUE, *PAD, "bounce_train"),
    ),
    Mutant(
        "fix: impulse", "the impulse form gives an impulse that is off by a factor",
        f"{FIXES}/contacts.py:impulse_contact",
        "    force = j / acts\n", "    force = (1.0 + SIZE) * j / acts\n",
        0.01, "%", side="lammps", cases=WALL,
    ),
    Mutant(
        "fix: mass not picked up", "the atom stays as heavy as it was",
        f"{FIXES}/particles.py:advance_particle",
        "mass[i] += gained / PICOGRAM", "mass[i] += 0.0 * gained / PICOGRAM",
        side="lammps", cases=WALL,
    ),
    Mutant(
        "fix: tangential velocity kept", "the mass picked up does not slow the atom (Eq 24)",
        f"{FIXES}/contacts.py:close_impact",
        "velocity[axis] *= mass / (mass + gained)", "velocity[axis] *= 1.0",
        side="lammps", cases=OBLIQUE,
    ),
    Mutant(
        "fix: first removal lost", "of all removals of a step the first does not lower the surface",
        f"{FIXES}/particles.py:remove_in_order",
        "if commit_removal(c.model, heights, rows, first, last):",
        "if commit_removal(c.model, heights, rows, first + 1, last):",
        side="lammps", cases=WALL,
    ),
    Mutant(
        "fix: pad's own speed", "the pad strikes as if it did not move",
        f"{FIXES}/contacts.py:impulse_pad",
        "approach = v_half[2] + c.pad_velocity", "approach = v_half[2]",
        side="lammps", cases=PAD,
    ),
    Mutant(
        "fix: soft pad's own speed", "the soft pad is met as if it did not move",
        f"{FIXES}/contacts.py:soft_pad",
        "v_free[2] + c.pad_velocity", "v_free[2]",
        side="lammps", cases=PAD,
    ),
    Mutant(
        "fix: pad descends too slowly", "the pad stays behind by part of each step",
        f"{FIXES}/contacts.py:lower_pad",
        "lowered_pad(model, c.pad_height, lowest, c.time_step)",
        "lowered_pad(model, c.pad_height, lowest, (1.0 - SIZE) * c.time_step)",
        0.01, "%", side="lammps", cases=PAD,
    ),
    Mutant(
        "fix: observed impulse", "the impulse of LAMMPS's own contacts is summed up wrongly",
        f"{FIXES}/pairs.py:follow_pair",
        "contact[PAIR_IMPULSE + axis] += a[PAIR_FORCE + axis] * acts",
        "contact[PAIR_IMPULSE + axis] += (1.0 + SIZE) * a[PAIR_FORCE + axis] * acts",
        0.01, "%", side="lammps", cases=("pair_slip",),
    ),
    Mutant(
        "fix: sampled velocity", "the trajectory has the velocities of half a step before",
        f"{FIXES}/samples.py:store_sample",
        "p[VELOCITY + axis] + p[LAG] * force / p[MASS]",
        "p[VELOCITY + axis] + (1.0 - SIZE) * p[LAG] * force / p[MASS]",
        1.0, "% of half a step", side="lammps", cases=("components",),
    ),
    Mutant(
        "deck: restitution", "the pair deck asks for another restitution",
        "lammps_inputs/in.pair_head_on:variable e",
        "$(ternary(v_restitution<0.999999999,v_restitution,0.999999999))",
        "$(ternary(v_restitution<0.999999999,v_restitution*(1-SIZE),0.999999999))",
        0.01, "%", side="lammps", cases=("pair_head_on e0.5",),
    ),
    Mutant(
        "deck: friction", "the pair deck has another coefficient of friction",
        "lammps_inputs/in.pair_slip:pair_coeff",
        "${friction} damping", "$(v_friction*(1+SIZE)) damping",
        0.01, "%", side="lammps", cases=("pair_slip",),
    ),
    Mutant(
        "deck: no limit_damping", "contacts may pull, so that e means something else and slip is wrong",
        "lammps_inputs/in.pair_slip:pair_coeff",
        "coeff_restitution limit_damping", "coeff_restitution",
        side="lammps", cases=("pair_slip",),
    ),
    Mutant(
        "deck: spheres spin", "the pair deck integrates rotation, which the paper's spheres do not have",
        "lammps_inputs/in.pair_stick:fix integrate",
        "fix integrate all nve ", "fix integrate all nve/sphere ",
        side="lammps", cases=("pair_stick",),
    ),
    Mutant(
        "deck: viscosity", "the drag of the deck is off by a factor",
        "lammps_inputs/in.drag_relaxation:variable k",
        "(6*PI*v_viscosity*c_particle)", "(6*(1+SIZE)*PI*v_viscosity*c_particle)",
        0.01, "%", side="lammps", cases=("drag_relaxation",),
    ),
    Mutant(
        "deck: exponent 0.646", "the second regime of Eq 21 has another exponent in the deck",
        "lammps_inputs/in.drag_regimes:variable k",
        "v_Re^(-0.354)+1.354*v_h", "v_Re^(-0.354+SIZE)+1.354*v_h",
        0.001, "of the exponent", factor=1.0, side="lammps", cases=("drag_regimes",),
    ),
    Mutant(
        "deck: shear rate", "the flow of the deck is steeper",
        "lammps_inputs/in.couette_drift:variable drag_x",
        "v_k*(v_wall_speed*z/v_gap-vx)", "v_k*((1+SIZE)*v_wall_speed*z/v_gap-vx)",
        0.01, "%", side="lammps", cases=("couette_drift",),
    ),
    Mutant(
        "deck: neighbour list", "the deck lists neighbours anew only every 20 000 steps",
        "lammps_inputs/in.swarm:neigh_modify",
        "neigh_modify delay 0 every 1 check yes", "neigh_modify delay 20000 every 20000 check no",
        side="lammps", cases=("swarm",),
    ),
    Mutant(
        "radius in Stokes's drag, in LAMMPS",
        "the fix takes the radius for the diameter in the kernel it shares",
        "reference/drag.py:drag_factor",
        "return 3.0 * math.pi * viscosity * diameter", "return 3.0 * math.pi * viscosity * 0.5 * diameter",
        side="lammps", cases=("bounce_train",),
    ),
    Mutant(
        "radius in Stokes's drag, in both",
        "both engines take the radius for the diameter in the shared kernel",
        "reference/drag.py:drag_factor",
        "return 3.0 * math.pi * viscosity * diameter", "return 3.0 * math.pi * viscosity * 0.5 * diameter",
        side="both", cases=("bounce_train",),
    ),
)  # fmt: skip
