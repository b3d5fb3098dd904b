"""How much each gene matters among the random strings, which no parents bias.

A polynomial of second order is fitted to the ranks of their costs: ranks, because a few costs are huge, and
second order, because the best value of a gene may lie between its bounds.
"""

from __future__ import annotations

from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
from scipy import stats


class Share(NamedTuple):
    """What one gene explains."""

    explained: float  # part of what is left unexplained without the gene (partial R^2)
    chance: float  # p-value of the F test that it explains nothing


def shares(points: np.ndarray, costs: np.ndarray) -> list[Share]:
    """The share of each gene, NaN where there are too few strings to tell.

    Parameters: points (m, n), genes between -1 and 1; costs (m,), finite.
    """
    m, n = points.shape
    terms = [pair for order in (1, 2) for pair in combinations_with_replacement(range(n), order)]
    ranks = stats.rankdata(costs)
    full = _residue(points, terms, ranks)
    found = []
    for gene in range(n):
        kept = [pair for pair in terms if gene not in pair]
        dropped, free = len(terms) - len(kept), m - len(terms) - 1
        if free < dropped:
            found.append(Share(np.nan, np.nan))
            continue
        without = _residue(points, kept, ranks)
        ratio = (without - full) / dropped / (full / free) if full > 0 else np.inf
        found.append(Share(float(1.0 - full / without), float(stats.f.sf(ratio, dropped, free))))
    return found


def _residue(points: np.ndarray, terms: list[tuple[int, ...]], ranks: np.ndarray) -> float:
    """Sum of squares that the least-squares polynomial with these terms leaves."""
    columns = [np.ones(len(points)), *(points[:, list(pair)].prod(axis=1) for pair in terms)]
    matrix = np.column_stack(columns)
    solution = np.linalg.lstsq(matrix, ranks, rcond=None)[0]
    return float(((ranks - matrix @ solution) ** 2).sum())
