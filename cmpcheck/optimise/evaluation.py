"""The cost of strings: samples run on workers, kept as they finish, until each ensemble is large enough.

What is done with a sample depends on the samples before it, never on who finished first, so the result is
the same for any number of workers.  Which strings are asked for is `search.py` and `methods.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from itertools import count, takewhile

import numpy as np

from cmpcheck.optimise.problem import Problem, Sample, String, evaluate_sample
from cmpcheck.optimise.store import Evaluated, Store
from cmpcheck.optimise.workers import Workers, WorkersError
from reference.ensemble import ensemble_mean

Strings = Sequence[Sequence[float]] | np.ndarray  # (m, n)
Evaluate = Callable[[Problem, String, int], Sample]


class Ensemble:
    """The samples of one string so far, and how many of them are wanted."""

    def __init__(
        self,
        problem: Problem,
        string: String,
        number: int,
        known: dict[int, Sample],
        size: int | None = None,
        first: int = 0,
    ) -> None:
        self.string, self.number, self.samples = string, number, known
        self._rule, self._size, self._first = problem.rule, size, first  # a size stands in place of the rule

    @property
    def costs(self) -> list[float]:
        """The costs of the samples in order, up to the first that is missing or failed."""
        ordered = (self.samples[k] for k in takewhile(self.samples.__contains__, count(self._first)))
        return [sample.cost for sample in takewhile(lambda sample: not sample.error, ordered)]

    @property
    def reason(self) -> str:
        """Why the string cannot be run; "" while that is not known."""
        failed = self.samples.get(self._first + len(self.costs))
        return failed.error if failed else ""

    @property
    def taken(self) -> int | None:
        """How many samples the ensemble ends with; None while it has not ended."""
        costs = self.costs
        if self._size is not None:
            return self._size if len(costs) >= self._size else None
        sizes = range(self._rule.minimum, len(costs) + 1)
        return next((n for n in sizes if self._rule.enough(costs[:n])), None)

    @property
    def done(self) -> bool:
        """Whether the result is known."""
        return bool(self.reason) or self.taken is not None

    def missing(self) -> list[int]:
        """The samples to run next, in order."""
        if self.done:
            return []
        end = self._first + (self._size or max(self._rule.minimum, len(self.costs) + 1))
        failed = (k for k, sample in self.samples.items() if sample.error and k >= self._first)
        return [k for k in range(self._first, min(failed, default=end)) if k < end and k not in self.samples]

    def result(self) -> Evaluated:
        """What it came to, once nothing is missing."""
        costs = self.costs
        if self.reason:
            return Evaluated(self.string, math.inf, math.nan, len(costs), False, self.reason)
        costs = costs[: self.taken]
        mean = ensemble_mean(costs)
        settled = mean.settled(self._rule.tolerance)
        return Evaluated(self.string, mean.mean, mean.standard_error, len(costs), settled)


class Evaluator:
    """Evaluates strings of a problem with workers, and keeps all that is computed in a store.

    `on_sample` is called after each new sample; `evaluate` is `evaluate_sample`, or what stands for it in a
    test: importable, of (problem, string, k).
    """

    def __init__(
        self,
        problem: Problem,
        store: Store,
        workers: Workers,
        on_sample: Callable[[Sample], None] = lambda sample: None,
        evaluate: Evaluate = evaluate_sample,
    ) -> None:
        self.problem, self.store = problem, store
        self._workers, self._on_sample, self._evaluate = workers, on_sample, evaluate
        self._suspects: list[tuple[Ensemble, int]] = []  # in flight when a worker died
        self._deaths: dict[tuple[int, int], int] = {}
        self._alive = False  # whether any sample has come back

    def costs(
        self,
        strings: Strings,
        run: str,
        first: int,
        generation: int,
        origins: Sequence[str],
    ) -> list[Evaluated]:
        """Each string with its mean cost by the problem's rule.

        The store keeps that `run` asked for them, at its places from `first` on.
        """
        ensembles = [self._ensemble(string) for string in strings]
        self.store.add_asked(run, first, generation, origins, [e.number for e in ensembles])
        self._complete(ensembles)
        found = [ensemble.result() for ensemble in ensembles]
        for ensemble, result in zip(ensembles, found, strict=True):
            self.store.add_result(ensemble.number, result)
        return found

    def samples(self, strings: Strings, size: int, first: int = 0) -> list[list[Sample]]:
        """The samples first, first + 1, ... of each string, `size` of them, or fewer where one fails."""
        ensembles = [self._ensemble(string, size, first) for string in strings]
        self._complete(ensembles)
        return [
            [ensemble.samples[first + k] for k in range(min(size, len(ensemble.costs)))]
            for ensemble in ensembles
        ]

    def means(self, found: Evaluated) -> Sample:
        """Means of all columns over the samples of an ensemble."""
        known = self.store.samples(self.store.number_of(found.string))
        columns = np.array([known[k][:-1] for k in range(found.samples)], dtype=float)
        cost, flatness, rate, mass, seconds = map(float, columns.mean(axis=0))
        return Sample(cost, flatness, rate, mass, seconds)

    def _ensemble(self, string: Sequence[float], size: int | None = None, first: int = 0) -> Ensemble:
        plain: String = tuple(map(float, string))
        number = self.store.number_of(plain)
        return Ensemble(self.problem, plain, number, self.store.samples(number), size, first)

    def _complete(self, ensembles: Sequence[Ensemble]) -> None:
        """Run samples until no ensemble misses any; two for each worker are in flight."""
        flying: dict[Future, tuple[Ensemble, int]] = {}
        room = 2 * self._workers.size() if ensembles else 0
        unique = list({ensemble.number: ensemble for ensemble in ensembles}.values())
        for ensemble in ensembles:  # two equal strings share their samples
            ensemble.samples = next(e.samples for e in unique if e.number == ensemble.number)
        try:
            while unique := [ensemble for ensemble in unique if not ensemble.done]:
                for ensemble, k in self._next(unique, list(flying.values()), room):
                    if not self._submit(flying, ensemble, k):
                        break
                self._collect(flying)
        except CancelledError:
            raise WorkersError("the scheduler is gone") from None
        finally:
            for future in flying:
                future.cancel()

    def _submit(self, flying: dict[Future, tuple[Ensemble, int]], ensemble: Ensemble, k: int) -> bool:
        """Give a sample to a worker, unless the executor turns out to be broken."""
        try:
            future = self._workers.submit(self._evaluate, self.problem, ensemble.string, k)
        except BrokenExecutor:
            if (ensemble.number, k) in self._deaths:
                self._suspects.append((ensemble, k))
            if not flying:
                self._workers.restart()
            return False
        flying[future] = (ensemble, k)
        return True

    def _next(
        self, ensembles: Sequence[Ensemble], flying: list[tuple[Ensemble, int]], room: int
    ) -> list[tuple[Ensemble, int]]:
        """What to submit now: suspects each alone, then missing samples, string by string."""
        if self._suspects:
            return [] if flying else [self._suspects.pop(0)]  # in turn, so that innocent ones come back
        busy = {(ensemble.number, k) for ensemble, k in flying}
        if any((number, k) in self._deaths for number, k in busy):
            return []  # a suspect flies alone
        free = room - len(flying)
        if free <= 0:
            return []
        wanted = ((e, k) for e in ensembles for k in e.missing() if (e.number, k) not in busy)
        return [item for item, _ in zip(wanted, range(free), strict=False)]

    def _collect(self, flying: dict[Future, tuple[Ensemble, int]]) -> None:
        """Keep the samples that are finished; where a worker died, note what it may have died of."""
        done, _ = wait(flying, return_when=FIRST_COMPLETED) if flying else (set(), set())
        if any(self._workers.lost(_problem(future)) for future in done):
            done, _ = wait(flying)  # a broken pool ends them all
        lost, kept = [], []
        for future in done:
            ensemble, k = flying.pop(future)
            if self._workers.lost(_problem(future)):
                lost.append((ensemble, k))
            else:
                kept.append((ensemble, k, _result(future)))
                self._alive = True
        self._keep(kept)
        if lost:
            self._workers.restart()
            self._suspect(lost)

    def _suspect(self, lost: list[tuple[Ensemble, int]]) -> None:
        """Samples whose worker died are run again, each alone; one that kills it again and again fails."""
        for ensemble, k in lost:
            key = (ensemble.number, k)
            self._deaths[key] = self._deaths.get(key, 0) + (len(lost) == 1)
            if self._deaths[key] >= self._workers.attempts and not self._alive:
                raise WorkersError("the workers die before they have run anything")
            if self._deaths[key] >= self._workers.attempts:
                nan, reason = math.nan, f"sample {k} took its worker with it {self._workers.attempts} times"
                self._keep([(ensemble, k, Sample(nan, nan, nan, nan, nan, reason))])
            else:
                self._suspects.append((ensemble, k))

    def _keep(self, finished: list[tuple[Ensemble, int, Sample]]) -> None:
        self.store.add_samples([(ensemble.number, k, sample) for ensemble, k, sample in finished])
        for ensemble, k, sample in finished:
            self._deaths.pop((ensemble.number, k), None)
            ensemble.samples[k] = sample
            self._on_sample(sample)


def _problem(future: Future) -> BaseException | None:
    """What a finished future failed with."""
    return CancelledError() if future.cancelled() else future.exception()


def _result(future: Future) -> Sample:
    try:
        return future.result()
    except ImportError as problem:
        raise WorkersError(
            f"a worker cannot run samples: {problem}; install cmpcheck where it runs"
        ) from None
