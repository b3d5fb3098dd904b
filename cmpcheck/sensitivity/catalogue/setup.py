"""Errors in what a run starts from, in random numbers, and in the genetic algorithm (Sections 3.2 and 4)."""

from __future__ import annotations

from cmpcheck.sensitivity.mutants import Mutant

PROCESS, NEIGHBORS = "reference/process.py", "reference/neighbors.py"

MUTANTS = (
    Mutant(
        "units", "quantities with a unit are off by a factor",
        "reference/units.py:_text_to_si",
        "return float(Decimal(number) * _factor(given, unit))",
        "return (1.0 + SIZE) * float(Decimal(number) * _factor(given, unit))",
        1e-6, "ppm", factor=1e6,
    ),
    Mutant(
        "mass of a sphere", "the mass of every particle is off by a factor",
        f"{PROCESS}:build_setup",
        "mass=density * math.pi * diameter**3 / 6.0",
        "mass=(1.0 + SIZE) * density * math.pi * diameter**3 / 6.0",
        0.01, "%",
    ),
    Mutant(
        "plane strain", "E/(1 - nu^2) is E/(1 + nu^2)",
        f"{PROCESS}:_plane_strain_modulus",
        "(1.0 - material.poisson_ratio**2)", "(1.0 + material.poisson_ratio**2)",
    ),
    Mutant(
        "diameter spread", "the spread of the diameters is off by a factor",
        f"{PROCESS}:_particle_materials",
        "spread = part.diameter_spread *", "spread = (1.0 + SIZE) * part.diameter_spread *",
        0.5, "%",
    ),
    Mutant(
        "descent of the pad", "V_z is off by a factor",
        f"{PROCESS}:build_model",
        "/ (PAD_DESCENT * case.case.duration)", "/ (PAD_DESCENT * case.case.duration) * (1.0 + SIZE)",
        0.01, "%",
    ),
    Mutant(
        "largest step", "dt_lim = gamma d/V is off by a factor",
        f"{PROCESS}:_pad_step",
        "case.numerics.gamma * mean", "(1.0 + SIZE) * case.numerics.gamma * mean",
        0.01, "%",
    ),
    Mutant(
        "number of asperities", "N_a is off by a factor, as with one triangle per square",
        "reference/heightfield.py:asperity_surface",
        "size=(round(density * nodes**2), 2)", "size=(round((1.0 + SIZE) * density * nodes**2), 2)",
        1.0, "%",
    ),
    Mutant(
        "packing", "particles are packed nearer than they may be",
        "reference/packing.py:_insert",
        "reach = radius + 0.5 * diameter[other]", "reach = (1.0 - SIZE) * (radius + 0.5 * diameter[other])",
        0.1, "% of the distance",
    ),
    Mutant(
        "streams in one sample", "surface, diameters, positions, ... are drawn from one stream",
        f"{PROCESS}:random_streams",
        "np.random.default_rng(child) for", "np.random.default_rng(children[0]) for",
    ),
    Mutant(
        "streams of samples", "every two samples share their random numbers",
        "reference/ensemble.py:sample_case",
        "spawn_key=(SAMPLES, k)", "spawn_key=(SAMPLES, k // 2)",
    ),
    Mutant(
        "stopping rule", "the mean is held against that of two samples before",
        "reference/ensemble.py:StoppingRule.enough",
        "abs(fmean(values) - fmean(values[:-1]))", "abs(fmean(values) - fmean(values[:-2]))",
    ),
    Mutant(
        "two cells", "an axis with two cells is not searched whole, so that neighbours are met twice",
        f"{NEIGHBORS}:neighbor_pairs",
        "if counts[axis] < 3:", "if counts[axis] < 2:",
    ),
    Mutant(
        "last cell", "pairs across the upper end of an axis are missed",
        f"{NEIGHBORS}:_scan_cells",
        "for a in range(index[0] - reach[0], index[0] + reach[0] + 1):",
        "for a in range(index[0] - reach[0], min(index[0] + reach[0] + 1, counts[0])):",
    ),
    Mutant(
        "GA drops a parent", "the best string does not stay among the parents",
        "reference/genetic.py:GeneticAlgorithm._advance",
        "kept = slice(0, self.parents)", "kept = slice(1, self.parents)",
    ),
    Mutant(
        "GA offspring", "offspring lie beyond their parents: Phi A + Phi B",
        "reference/genetic.py:GeneticAlgorithm._offspring",
        "phi * first + (1.0 - phi) * second", "phi * first + phi * second",
    ),
    Mutant(
        "GA population", "S - K strings are new, not S - 2K: the text's example",
        "reference/genetic.py:GeneticAlgorithm._advance",
        "self._random(self.population - 2 * self.parents)", "self._random(self.population - self.parents)",
    ),
)  # fmt: skip
