"""Errors in the analysis itself: what is measured, extrapolated, and called equivalent."""

from __future__ import annotations

from cmpcheck.sensitivity.mutants import Mutant

CONVERGENCE, STATISTICS = "cmpcheck/convergence.py", "cmpcheck/statistics"

MUTANTS = (
    Mutant(
        "drag over the contact", "the impulse of an engine is corrected for the drag with the wrong sign",
        "cmpcheck/quantities.py:model_impulse",
        'rows["normal_impulse"].to_numpy(float) - rows["external_force"]',
        'rows["normal_impulse"].to_numpy(float) + rows["external_force"]',
        side="both", cases=("bounce_train",),
    ),
    Mutant(
        "volume lost", "the volume that the surface has lost is measured off by a factor",
        "cmpcheck/quantities.py:volume_lost",
        "before.spacing**2 * float((before.z - after.z).sum())",
        "(1.0 + SIZE) * before.spacing**2 * float((before.z - after.z).sum())",
        0.01, "%", side="both", cases=("wall_bounce pickup",),
    ),
    Mutant(
        "observed order", "the extrapolation goes to the other side",
        f"{CONVERGENCE}:extrapolate",
        "correction = (f[0] - f[1]) / (h[1] ** order - 1)",
        "correction = (f[1] - f[0]) / (h[1] ** order - 1)",
        side="both", cases=("pair_head_on e0.5",),
    ),
    Mutant(
        "grid convergence index", "the safety factor of the index is off by a factor",
        f"{CONVERGENCE}:grid_convergence_index",
        "return safety * abs(coarse - fine)", "return (1.0 + SIZE) * safety * abs(coarse - fine)",
        0.1, "%", side="both", cases=("pair_head_on e0.5",),
    ),
    Mutant(
        "phases of a step", "all copies start at the same phase of a step",
        "cmpcheck/phases.py:tile",
        "((np.arange(copies) + 0.5) / copies - 0.5) * time_step",
        "0.0 * ((np.arange(copies) + 0.5) / copies - 0.5)",
        side="both", cases=("pair_head_on e0.5",),
    ),
    Mutant(
        "bound of the phases", "the error of a mean over phases is bounded by less than it can be",
        f"{CONVERGENCE}:phase_error",
        "return 2 * spread / (phases - 1)", "return (1.0 - SIZE) * 2 * spread / (phases - 1)",
        0.5, "%", side="both", cases=("pair_head_on e0.5",),
    ),
    Mutant(
        "interval of equivalence", "equivalence is tested at another level than stated",
        f"{STATISTICS}/equivalence.py:paired_difference",
        "bootstrap.interval(alpha)", "bootstrap.interval((1.0 + SIZE) * alpha)",
        1.0, "% of alpha", side="both", cases=("pair_head_on e0.5",),
    ),
    Mutant(
        "bootstrap", "the bootstrap's standard error is off by a factor",
        f"{STATISTICS}/resampling.py:StudentizedMean.of",
        "error = drawn.std(axis=1, ddof=1) / np.sqrt(n)",
        "error = (1.0 + SIZE) * drawn.std(axis=1, ddof=1) / np.sqrt(n)",
        0.5, "%", side="both", cases=("pair_head_on e0.5",),
    ),
)  # fmt: skip
