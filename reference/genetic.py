"""The genetic algorithm of Section 3.2, in ask/tell form: strings out, costs in.

What a string means and how its cost is computed is the caller's; a cost may be infinite, never NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike


class GeneticAlgorithm:
    """A population of strings that are ranked, mated and renewed, generation by generation.

    Paper: Section 3.2.  The S strings of a generation are ranked by cost; the top K are mated in pairs
    (1, 2), (3, 4), ...; the next generation is these parents, K offspring and M = S - 2K random strings.
    Departure: the text's example (S = 20, 4 parents, 4 offspring, 16 new) adds up to 24; here M = 12.

    Parameters: `bounds` (n, 2), the least and the largest value of each gene; `population` S; `parents` K,
    even, at most S/2; `rng` a numpy Generator; `integer` (n,), which genes are whole numbers.
    Raises ValueError for bounds that are empty, inverted or not finite, and for S and K that do not fit.

    >>> ga = GeneticAlgorithm([[-1.0, 1.0]], population=8, parents=2, rng=np.random.default_rng(0))
    >>> for generation in range(10):
    ...     strings = ga.ask()
    ...     ga.tell(strings, (strings[:, 0] - 0.5) ** 2)
    >>> abs(float(ga.best[0][0]) - 0.5) < 0.1
    True
    """

    def __init__(
        self,
        bounds: ArrayLike,
        population: int = 20,
        parents: int = 4,
        *,
        rng: np.random.Generator,
        integer: Sequence[bool] | None = None,
    ) -> None:
        self.bounds = np.array(bounds, dtype=np.float64)
        if self.bounds.ndim != 2 or self.bounds.shape[1] != 2 or len(self.bounds) == 0:
            raise ValueError(f"bounds of shape {self.bounds.shape}; allowed: (n, 2), n >= 1")
        low, high = self.bounds.T
        if not (np.isfinite(self.bounds).all() and (low <= high).all()):
            raise ValueError(f"bounds {self.bounds.tolist()}; allowed: finite, the lower first")
        if parents < 2 or parents % 2 or 2 * parents > population:
            raise ValueError(
                f"parents {parents} of a population of {population}; allowed: even, from 2 to its half"
            )
        self.integer = np.zeros(len(low), bool) if integer is None else np.array(integer, dtype=bool)
        if self.integer.shape != low.shape:
            raise ValueError(
                f"integer of shape {self.integer.shape}; allowed: {low.shape}, one for each gene"
            )
        if not (self.bounds[self.integer] % 1 == 0).all():
            raise ValueError(f"bounds {self.bounds.tolist()}; allowed: whole numbers where the gene is one")
        self.population, self.parents, self.rng = population, parents, rng
        self.generation = 0  # generations whose costs are all known
        self.strings = np.empty((0, len(low)))  # the last of them (S, n), best first
        self.costs = np.empty(0)  # theirs, (S,)
        self.history: list[float] = []  # best cost of each generation
        self._pending = self._random(population)
        self._told = np.full(population, np.nan)

    def ask(self) -> np.ndarray:
        """The strings (m, n) of this generation that still need a cost; m >= 1."""
        return self._pending[np.isnan(self._told)].copy()

    def tell(self, strings: ArrayLike, costs: ArrayLike) -> None:
        """The costs (m,) of strings (m, n) that `ask` gave, all of them or some, in any order.

        Once all are known the next generation is made.
        Raises ValueError for a string that was not asked for, and for a cost that is NaN.
        """
        rows, values = np.atleast_2d(np.asarray(strings, float)), np.atleast_1d(np.asarray(costs, float))
        if rows.shape != (len(values), len(self.bounds)):
            raise ValueError(
                f"{rows.shape} strings and {values.shape} costs; allowed: one cost for each string"
            )
        if np.isnan(values).any():
            raise ValueError("a cost is NaN; allowed: numbers, and infinity for a string that cannot be run")
        told = self._told.copy()
        for row, value in zip(rows, values, strict=True):
            places = np.flatnonzero((self._pending == row).all(axis=1) & np.isnan(told))
            if not len(places):
                raise ValueError(f"string {row.tolist()} was not asked for")
            told[places[0]] = value
        self._told = told
        if not np.isnan(told).any():
            self._advance()

    @property
    def best(self) -> tuple[np.ndarray, float]:
        """The best string (n,) of all generations, and its cost.  Raises ValueError before the first."""
        if self.generation == 0:
            raise ValueError("no generation has all its costs yet")
        return self.strings[0].copy(), float(self.costs[0])

    def _advance(self) -> None:
        """Rank the generation, keep the parents with their costs, and make the strings of the next."""
        kept = slice(0, self.parents)
        strings = np.concatenate([self.strings[kept], self._pending])
        costs = np.concatenate([self.costs[kept], self._told])
        order = np.argsort(costs, kind="stable")  # of equal costs the older string is first
        self.strings, self.costs = strings[order], costs[order]
        self.history.append(float(self.costs[0]))
        self.generation += 1
        fresh = self._random(self.population - 2 * self.parents)
        self._pending = np.concatenate([self._offspring(), fresh])
        self._told = np.full(len(self._pending), np.nan)

    def _offspring(self) -> np.ndarray:
        """Two strings from each pair of parents: lambda = Phi A^i + (1 - Phi) A^(i+1), Phi for every gene."""
        first, second = self.strings[0 : self.parents : 2], self.strings[1 : self.parents : 2]
        phi = self.rng.random((2, *first.shape))
        mated = phi * first + (1.0 - phi) * second  # (2, K/2, n)
        return self._valid(mated.swapaxes(0, 1).reshape(self.parents, -1))

    def _random(self, count: int) -> np.ndarray:
        """Strings within the bounds; each whole number is equally likely."""
        low, high = self.bounds.T
        half = 0.5 * self.integer
        return self._valid(low - half + (high - low + 2.0 * half) * self.rng.random((count, len(low))))

    def _valid(self, strings: np.ndarray) -> np.ndarray:
        whole = np.where(self.integer, np.round(strings), strings)
        return np.clip(whole, *self.bounds.T)

    def state(self) -> dict[str, Any]:
        """All that `restore` needs, in types that Python's json keeps exactly."""
        return {
            "generation": self.generation,
            "strings": self.strings.tolist(),
            "costs": self.costs.tolist(),
            "history": list(self.history),
            "pending": self._pending.tolist(),
            "told": self._told.tolist(),
            "rng": self.rng.bit_generator.state,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on where `state()` was taken, of an algorithm with the same parameters."""
        n = len(self.bounds)
        self.generation, self.history = state["generation"], list(state["history"])
        self.strings, self.costs = np.reshape(state["strings"], (-1, n)), np.array(state["costs"], float)
        self._pending, self._told = np.reshape(state["pending"], (-1, n)), np.array(state["told"], float)
        self.rng.bit_generator.state = state["rng"]
