"""Errors in how the state advances, is recorded and resumed: steps, lists, the pad, the books (Eqs 37-43)."""

from __future__ import annotations

from cmpcheck.sensitivity.mutants import Mutant

STEP, SCHEMES, COLLISIONS = "reference/timestep.py", "reference/schemes.py", "reference/collisions.py"

MUTANTS = (
    Mutant(
        "position moves with the old velocity", "r' = r + dt v along x instead of r + dt v'",
        f"{STEP}:accept",
        "wrap(p.position[i, 0] + dt * vx, model.length_x)",
        "wrap(p.position[i, 0] + dt * (vx - SIZE * (vx - sx)), model.length_x)",
        1.0, "% of the change",
    ),
    Mutant(
        "positions are not wrapped", "a particle that leaves the box along y stays outside",
        f"{STEP}:accept",
        "wrap(p.position[i, 1] + dt * vy, model.length_y)", "p.position[i, 1] + dt * vy",
    ),
    Mutant(
        "removal on a rejected step", "a step that is repeated has already lowered the surface",
        f"{STEP}:advance",
        "                progress[P.rejected] += 1\n",
        "                progress[P.rejected] += 1\n"
        "                commit_removal(model, heights, rows, used, found)\n",
    ),
    Mutant(
        "time of the next step", "time advances by the step to come",
        f"{STEP}:advance",
        "progress[P.time] = time + dt if numerics.fixed_point",
        "progress[P.time] = time + progress[P.step] if numerics.fixed_point",
    ),
    Mutant(
        "exponent of k_d", "the exponent 1/(k_d - 1) of Eq 42 is 1/k_d, as printed",
        f"{SCHEMES}:step_factor",
        "(1.0 / (iterations - 1))", "(1.0 / iterations)",
    ),
    Mutant(
        "exponent of k", "the exponent 1/(k - 1) of Eq 42 is 1/k, as printed",
        f"{SCHEMES}:step_factor",
        "(1.0 / (k - 1))", "(1.0 / k)",
    ),
    Mutant(
        "printed norm", "the error is relative to the distance from the origin (step 3(a) as printed)",
        f"{SCHEMES}:solve_fixed_point",
        "scale = distances if numerics.printed_norm else moves", "scale = distances",
    ),
    Mutant(
        "growth of the step", "the largest growth of the step is off",
        f"{STEP}:advance",
        "min(factor, MAX_GROWTH) * dt", "min(factor, MAX_GROWTH * (1.0 + SIZE)) * dt",
        0.1, "%",
    ),
    Mutant(
        "neighbour list out of date", "pairs are listed anew after a longer way than the skin allows",
        f"{STEP}:advance",
        "if 2.0 * travelled > skin:", "if 2.0 * travelled > skin * (1.0 + SIZE):",
        3.0, "skins", factor=1.0,
    ),
    Mutant(
        "clearance", "particles are not searched for the surface as early as they may touch it",
        f"{STEP}:accept",
        "work.clearance[i] -= dt * speed", "work.clearance[i] -= (1.0 - SIZE) * dt * speed",
        0.1, "%",
    ),
    Mutant(
        "pad one step late", "the pad is where it was one step before",
        f"{STEP}:advance",
        "lowered_pad(model, pad_height, lowest, dt)",
        "lowered_pad(model, pad_height, lowest, dt * (step > 1))",
    ),
    Mutant(
        "pad at rest strikes", "V_z stays in impacts on a pad that has come to rest",
        "reference/pad.py:pad_velocity",
        "return model.pad_descent if pad_height > lowest else 0.0", "return model.pad_descent",
    ),
    Mutant(
        "floor of the pad", "the pad stops higher",
        "reference/pad.py:lowest_pad_height",
        "return max(highest + 0.5 * largest, model.pad_minimum)",
        "return max(highest + 0.5 * largest, (1.0 + SIZE) * model.pad_minimum)",
        0.01, "%",
    ),
    Mutant(
        "pad's own speed", "the pad strikes as if it did not move",
        f"{COLLISIONS}:collide_pad",
        "approach = v[2] + descent", "approach = v[2]",
    ),
    Mutant(
        "pad restitution", "e_pad is off by a factor",
        f"{COLLISIONS}:collide_pad",
        "surface_normal_impulse(p.mass[i], -approach, model.pad_restitution)",
        "surface_normal_impulse(p.mass[i], -approach, model.pad_restitution * (1.0 + SIZE))",
        0.01, "%",
    ),
    Mutant(
        "impulse of the drag", "the drag's impulse is booked off by a factor along x",
        f"{SCHEMES}:solve_particle",
        "dx = part * (", "dx = (1.0 + SIZE) * part * (",
        1e-6, "ppm", factor=1e6,
    ),
    Mutant(
        "kinetic energy", "the kinetic energy of the history is off by a factor",
        "reference/recording.py:history_row",
        "energy = 0.5 * float(", "energy = (1.0 + SIZE) * 0.5 * float(",
        1e-6, "ppm", factor=1e6,
    ),
    Mutant(
        "balance of energy", "the work of the fluid enters the balance with the wrong sign",
        "reference/balances.py:_energy",
        'float(change - last["fluid_work"] + lost)', 'float(change + last["fluid_work"] + lost)',
    ),
    Mutant(
        "sums are not restored", "a run that goes on from a checkpoint has forgotten what was booked before",
        "reference/simulation.py:_Recorder.restore",
        'self.scalars[:] = state["progress"]', 'self.scalars[: P.contacts] = state["progress"][: P.contacts]',
    ),
    Mutant(
        "explicit drag", "the drag of a step is that of its start, not implicit",
        f"{SCHEMES}:solve_particle",
        "        inertia = (mass + gained) + dt * k\n",
        "        inertia = (mass + gained) + dt * k * (1.0 - SIZE)\n",
        1.0, "% of the implicit part",
    ),
)  # fmt: skip
