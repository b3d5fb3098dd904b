"""What follows from a design run, in numbers and sentences computed from them.

Does the top ten cluster, as the paper says of its own?  Did the stopping rule stop too early?  Which method
of search is best, and is that more than chance?
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from cmpcheck.display import number
from cmpcheck.optimise.methods import Trial
from cmpcheck.optimise.problem import PAPER_KEYS
from cmpcheck.optimise.response import Share, shares
from cmpcheck.optimise.results import TOP, Design, gene_name, gene_text

LEVEL = 0.05
PAPER_RANGES = dict(
    zip(PAPER_KEYS, (0.21, 0.055, 0.23, 2.1), strict=True)
)  # (most - least)/mean in its Table 1
PAPER_CLUSTERS = dict(zip(PAPER_KEYS, (True, True, True, False), strict=True))  # Section 4.1


@dataclass(frozen=True)
class Spread:
    """How far one gene ranges among the top strings, and how it matters among the random ones."""

    key: str
    low: float
    high: float
    least: float  # of the top strings
    most: float
    relative: float  # (most - least)/(high - low)
    over_mean: float  # (most - least)/mean, which needs no bounds
    chance: float  # that as many uniform numbers spread as little or less
    share: Share  # of what the costs of random strings vary by

    @property
    def clusters(self) -> bool:
        """Whether it spreads less than chance would have it."""
        return self.chance < LEVEL


def spreads(design: Design) -> list[Spread]:
    """The spread of each gene among the top ten."""
    top = [one.string for one in design.ranked[:TOP] if math.isfinite(one.cost)]
    found = []
    for k, (gene, share) in enumerate(zip(design.problem.settings.gene, _shares(design), strict=True)):
        values = np.array([string[k] for string in top])
        least, most, mean = (float(f(values)) if top else math.nan for f in (np.min, np.max, np.mean))
        relative = (most - least) / (gene.high - gene.low)
        over_mean = (most - least) / mean if mean else math.nan
        chance = range_chance(relative, len(top))
        found.append(Spread(gene.key, gene.low, gene.high, least, most, relative, over_mean, chance, share))
    return found


def _shares(design: Design) -> list[Share]:
    """What each gene explains of the costs of the random strings."""
    random = {a.found.string: a.found.cost for a in design.asked if a.origin == "random"}
    finite = {string: cost for string, cost in random.items() if math.isfinite(cost)}
    low, high = design.problem.bounds.T
    points = 2.0 * (np.array(list(finite)).reshape(len(finite), len(low)) - low) / (high - low) - 1.0
    return shares(points, np.array(list(finite.values())))


def range_chance(relative: float, n: int) -> float:
    """The probability that n uniform numbers range over `relative` or less: n r^(n-1) - (n - 1) r^n.

    >>> range_chance(1.0, 10), round(range_chance(0.5, 2), 12)
    (1.0, 0.75)
    """
    return n * relative ** (n - 1) - (n - 1) * relative**n if n > 1 else 1.0


def conclusion(design: Design) -> str:
    """The paper's conclusion on its Table 1 against ours."""
    found = {spread.key: spread for spread in spreads(design)}
    known = {key: said for key, said in PAPER_CLUSTERS.items() if key in found}
    if not known or not design.ranked or not math.isfinite(design.ranked[0].cost):
        return "The paper's conclusion on its Table 1 cannot be compared: none of its genes was varied here."
    top = min(TOP, len(design.top_samples))
    ours = {key: found[key].clusters for key in known}
    parts = [f"{gene_name(key)} over {number(100 * found[key].relative, 2)} %" for key in known]
    listed = f"Among our top {top} the genes range over these parts of their bounds: {', '.join(parts)}."
    limit = number(100 * float(_range_limit(top)), 2)
    rule = (
        f"Less than {limit} % is called a cluster: {top} random values stay within that once in twenty times."
    )
    agree = [gene_name(key) for key, said in known.items() if ours[key] == said]
    differ = [gene_name(key) for key, said in known.items() if ours[key] != said]
    paper = "The paper concludes that V_pad, N and d̄ cluster among its top ten while δd spreads."
    if not differ:
        verdict = f"Ours agrees for {_joined(agree)}."
    else:
        how = [
            f"{gene_name(k)} {'clusters' if ours[k] else 'spreads'}" for k in known if gene_name(k) in differ
        ]
        verdict = (
            f"Ours agrees for {_joined(agree)}, but " if agree else "Ours does not: "
        ) + f"{_joined(how)}."
    caution = "Offspring lie between their parents, so genes that do not matter come to cluster too."
    return " ".join(filter(None, (paper, verdict, listed, rule, _widest(found), caution)))


def _widest(found: dict[str, Spread]) -> str:
    """Whether δd spreads more than the others, by a measure that needs no bounds of the paper."""
    if not set(PAPER_KEYS) <= set(found):
        return ""
    own = {key: found[key].over_mean for key in PAPER_KEYS}
    most = max(own, key=lambda key: own[key])
    ranges = ", ".join(
        f"{gene_name(key)} {number(100 * own[key], 2)} % (paper {number(100 * PAPER_RANGES[key], 2)} %)"
        for key in PAPER_KEYS
    )
    return f"Relative to its mean, {gene_name(most)} spreads most: {ranges}."


def importance(design: Design) -> str:
    """Which genes matter among the random strings, which no parents bias."""
    found = [spread for spread in spreads(design) if math.isfinite(spread.share.chance)]
    if not found:
        return "There are too few random strings to tell which genes matter among them."
    parts = [
        f"{gene_name(s.key)} {number(100 * s.share.explained, 2)} % (p = {number(s.share.chance, 1)})"
        for s in found
    ]
    least = min(found, key=lambda s: s.share.explained)
    return (
        "Which genes matter is better told by the random strings, which have no parents. A second-order "
        "polynomial in all genes, fitted to the ranks of their costs, explains this part of what it leaves "
        f"unexplained without the gene: {', '.join(parts)}. {gene_name(least.key)} matters least."
    )


def bound_remark(design: Design) -> str:
    """Genes of the best string that lie within 2 % of a bound."""
    best, near = design.ranked[0].string, []
    for gene, value in zip(design.problem.settings.gene, best, strict=True):
        for end, bound in (("lower", gene.low), ("upper", gene.high)):
            if abs(value - bound) <= 0.02 * (gene.high - gene.low):
                near.append(f"the {end} bound of {gene_name(gene.key)}, {gene_text(gene.key, bound)}")
    return f"The best string lies at {_joined(near)}: a better one may lie beyond." if near else ""


def stopping(design: Design) -> str:
    """Where the paper's rule stopped too early for its tolerance."""
    part = design.problem.settings
    finite = [one for one in design.ranked if math.isfinite(one.cost)]
    early = [one for one in finite if one.settled and one.standard_error > part.tolerance]
    open_ = [one for one in finite if not one.settled]
    text = (
        f"The stopping rule ended {len(early)} of {len(finite)} ensembles too early: two consecutive means "
        f"differed by the tolerance, {part.tolerance:g}, or less, while the standard error was larger"
    )
    if early:
        worst = max(early, key=lambda one: one.standard_error)
        needed = math.ceil(worst.samples * (worst.standard_error / part.tolerance) ** 2)
        median = float(np.median([one.standard_error for one in early]))
        text += f" (median {number(median, 2)}, at most {number(worst.standard_error, 2)}, where it takes "
        text += f"about {needed} samples to come down to the tolerance)"
    ended = f" {len(open_)} ended at the maximum of {part.maximum_samples} samples." if open_ else ""
    return f"{text}.{ended}"


def selection(design: Design) -> str:
    """How much of the best cost is luck: the best of many noisy means is too low."""
    best = design.ranked[0]
    own = [d for d in design.distributions if d.string == best.string]
    if not own or len(own[0].costs) < best.samples + 2:
        return ""
    fresh = own[0].costs[best.samples :]
    error = fresh.std(ddof=1) / math.sqrt(len(fresh))
    name = design.problem.cost_name
    return (
        f"The best string was chosen for {name} = {number(best.cost, 3)} on {best.samples} samples; on "
        f"{len(fresh)} others, which did not choose it, {name} = {number(float(fresh.mean()), 3)} ± "
        f"{number(error, 2)} (standard error)."
    )


def indistinct(design: Design) -> str:
    """How many of the top ten cannot be told from the best, sample by sample on the same surfaces."""
    if len(design.top_samples) < 2:
        return ""
    best, alike = design.top_samples[0], 1
    for costs in design.top_samples[1:]:
        n = min(len(best), len(costs))
        difference = costs[:n] - best[:n]
        alike += _chance(difference) > LEVEL
    if alike == 1:
        return f"A paired t test at 5 % tells the best from all others of the top {len(design.top_samples)}."
    return (
        f"{alike} of the top {len(design.top_samples)}, itself included, cannot be told from the best by a "
        "paired t test at 5 %: their order is chance."
    )


def best_method(trials: Sequence[Trial]) -> str:
    """Which method found the best strings, judged on fresh samples, and whether that is more than chance."""
    if not trials:
        return ""
    scores: dict[str, list[float]] = {}
    for trial in sorted(trials, key=lambda trial: trial.seed):
        scores.setdefault(trial.method, []).append(float(trial.fresh.mean()))
    order = sorted(scores, key=lambda method: float(np.mean(scores[method])))
    seeds = len(scores[order[0]])
    parts = [f"{method} {_plus_minus(scores[method])}" for method in order]
    text = f"Mean cost of the best strings on fresh samples, {seeds} seeds each: {'; '.join(parts)}."
    first, second = order[0], order[1]
    lead = np.subtract(scores[second], scores[first])
    if seeds < 2:
        return f"Best with this one seed is: {first}. {text} One seed says nothing about chance."
    verdict = (
        "more than chance" if _chance(lead) <= LEVEL else f"no more than chance may do with {seeds} seeds"
    )
    return f"Best is: {first}; its lead over {second}, {_plus_minus(lead)}, is {verdict}. {text}"


def _chance(differences: np.ndarray) -> float:
    """The p-value of a t test that paired differences are zero on average."""
    if np.ptp(differences) <= 1e-12 * float(np.abs(differences).max()):  # equal but for rounding
        return float(not differences.any())
    return float(stats.ttest_1samp(differences, 0.0).pvalue)


def _plus_minus(values: Sequence[float] | np.ndarray) -> str:
    """Mean and standard error."""
    mean = float(np.mean(values))
    if len(values) < 2:
        return number(mean, 3)
    return f"{number(mean, 3)} ± {number(float(np.std(values, ddof=1)) / math.sqrt(len(values)), 2)}"


def _range_limit(n: int) -> float:
    """The relative range that n uniform numbers stay within with the probability LEVEL."""
    return float(stats.beta(n - 1, 2).ppf(LEVEL)) if n > 1 else 0.0


def _joined(names: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
