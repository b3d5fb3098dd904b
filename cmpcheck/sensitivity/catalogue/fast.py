"""Errors in the fast stepper; the plain one, the answer key, does it right."""

from __future__ import annotations

from cmpcheck.sensitivity.mutants import Mutant

FAST = "reference/fast"

MUTANTS = (
    Mutant(
        "fast: impulse of a pair", "e of two particles is off by a factor",
        f"{FAST}/pairs.py:impulse_on_first",
        "(1.0 + restitution) * separation", "(1.0 + (1.0 + SIZE) * restitution) * separation", 0.01, "%",
    ),
    Mutant(
        "fast: second of a pair", "the second particle of a pair receives another impulse than the first",
        f"{FAST}/few.py:march",
        "f.jz[j] -= c[B.jz + k]", "f.jz[j] -= (1.0 + SIZE) * c[B.jz + k]", 0.01, "%",
    ),
    Mutant(
        "fast: effective mass", "the duration of Hertz's contact has m* in the wrong power",
        f"{FAST}/pairs.py:approach", "separation * per_mass * per_mass", "separation * per_mass",
    ),
    Mutant(
        "fast: bounce", "e of a particle and the surface is off by a factor where nothing is removed",
        f"{FAST}/events.py:bounce",
        "surface_normal_impulse(mass, -closing, model.restitution, external)",
        "surface_normal_impulse(mass, -closing, (1.0 + SIZE) * model.restitution, external)", 0.01, "%",
    ),
    Mutant(
        "fast: pad", "the pad's restitution is off by a factor", f"{FAST}/sweep.py:depart",
        "leaving - restitution * v", "leaving - (1.0 + SIZE) * restitution * v", 0.01, "%",
    ),
    Mutant(
        "fast: shear", "the shear of the flow is off by a factor", f"{FAST}/sweep.py:glide_sheared",
        "(shear * z[i] - w[i])", "((1.0 + SIZE) * shear * z[i] - w[i])", 0.01, "%",
    ),
    Mutant(
        "fast: mass in the drag", "the share of the slip that a step takes is off by a factor",
        f"{FAST}/swarm.py:adapt",
        "(s.mass[i] + dt * s.drag[i])", "((1.0 + SIZE) * s.mass[i] + dt * s.drag[i])", 0.01, "%",
    ),
    Mutant(
        "fast: late look", "a particle is looked at later than it can touch the surface",
        f"{FAST}/watch.py:steps_until", "int(SAFETY * distance / (dt * speed))",
        "int((1.0 + SIZE) * distance / (dt * speed))", 1.0, "%",
    ),
    Mutant(
        "fast: narrow list", "pairs are listed as near within less than the list's way holds for",
        f"{FAST}/near.py:list_narrow_of", "reach = touching + skin", "reach = touching + (1.0 - SIZE) * skin",
        1.0, "% of the skin",
    ),
    Mutant(
        "fast: ceiling", "the map of surface maxima looks along x alone", f"{FAST}/ceiling.py:raise_ceiling",
        "for k in range(-span, span + 2):", "for k in range(0, 1):",
    ),
    Mutant(
        "fast: drag in a contact", "the drag over the duration of a contact is off by a factor",
        f"{FAST}/pairs.py:acceleration",
        "return rate * (shear * z - vx)", "return (1.0 + SIZE) * rate * (shear * z - vx)", 0.01, "%",
    ),
    Mutant(
        "fast: surface", "what the surface does is off by a factor", f"{FAST}/particle.py:hit_surface",
        "s.jz[i] += normal * nz", "s.jz[i] += (1.0 + SIZE) * normal * nz", 0.01, "%",
    ),
    Mutant(
        "fast: impulses", "what all contacts of a step give along z is off by a factor",
        f"{FAST}/sweep.py:depart", "v + jz[i] * per", "v + (1.0 + SIZE) * jz[i] * per", 0.01, "%",
    ),
    Mutant(
        "fast: impulses twice", "a part of what contacts give is given again in the next step",
        f"{FAST}/sweep.py:glide_along",
        "(flow - w[i])\n        v[i] = s\n        x[i] += dt * s\n        j[i] = 0.0",
        "(flow - w[i])\n        v[i] = s\n        x[i] += dt * s\n        j[i] *= SIZE", 0.01, "%",
    ),
    Mutant(
        "fast: pad and drag", "the pad's impulse is off by a factor where the drag is not linear",
        f"{FAST}/particle.py:solve_special", "- pushed,", "- (1.0 + SIZE) * pushed,", 0.01, "%",
    ),
    Mutant(
        "fast: linear drag", "drag is taken for linear beyond Re = 1", f"{FAST}/known.py:renew",
        "over = 4.0 *", "over = 4.0 / (1.0 + SIZE) *", 1.0, "% of Re^2",
    ),
    Mutant(
        "fast: mass not picked up", "an impact that removes adds no mass",
        f"{FAST}/particle.py:solve_special", "mass[i] += gained[i]", "mass[i] += (1.0 - SIZE) * gained[i]",
        1.0, "% of the mass",
    ),
    Mutant(
        "fast: other triangles", "only those triangles are looked at that were close at the last look",
        f"{FAST}/particle.py:find_surface",
        "steps = min(steps, int(known[row + K.until]) - step)", "known[row + K.until] = math.inf",
    ),
)  # fmt: skip
