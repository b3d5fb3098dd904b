"""Statistics of ensembles: are two engines equivalent where trajectories can no longer be compared?

Pure functions on arrays; nothing here knows a case, an engine or an observable.  One number per sample (a
seed) goes in, and engines are paired by seed: `difference[k] = measured[k] - reference[k]`.  Running the
samples is `reference/ensemble.py`, the time until trajectories can be compared `cmpcheck/horizon.py`.
"""

from cmpcheck.statistics.bands import Band, difference_band, mean_band
from cmpcheck.statistics.equivalence import Equivalence, paired_difference, relative_differences
from cmpcheck.statistics.families import control_family, fewest_pairs
from cmpcheck.statistics.power import detectable_difference, power_of_equivalence, sample_size
from cmpcheck.statistics.unpaired import Unpaired, kolmogorov_smirnov

__all__ = [
    "Band",
    "Equivalence",
    "Unpaired",
    "control_family",
    "detectable_difference",
    "difference_band",
    "fewest_pairs",
    "kolmogorov_smirnov",
    "mean_band",
    "paired_difference",
    "power_of_equivalence",
    "relative_differences",
    "sample_size",
]
