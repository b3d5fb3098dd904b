"""One run of `cmpcheck sensitivity`: its stages, in order, each finding kept as soon as it is made.

Baseline, seeded errors, smallest sizes, false alarms, power, mutation of the tests; then the documents.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from cmpcheck.engines import make_engine
from cmpcheck.sensitivity import false_alarms, orders, power, pytest_score
from cmpcheck.sensitivity.checks import (
    COMPONENTS,
    Label,
    Noticed,
    case_of,
    comparable_variants,
    only_new,
)
from cmpcheck.sensitivity.children import Child, prepare, run_parallel
from cmpcheck.sensitivity.detect import ask_twice, evaluate, first_noticing, record, smallest
from cmpcheck.sensitivity.mutants import Mutant
from cmpcheck.sensitivity.store import Store, source_digest
from cmpcheck.sensitivity.worker import BASELINE

Progress = Callable[[str, int, int], None]  # stage, done, in all
# In the quick profile one variant stands for several that differ in a number only
QUICK_LEAVES_OUT = frozenset({
    ("asperity_bounce", "plateau"), ("asperity_bounce", "corner"), ("pair_head_on", "e0.2"),
    ("pair_head_on", "e0.8"), ("pair_head_on", "e1"), ("wall_oblique", "60deg"),
})  # fmt: skip
SLOW = ("bounce_train", "swarm")  # cases that take several times as long as any other
SEEDED, SMALLEST, TESTS, BEFORE = "seeded", "smallest", "tests", "before"


@dataclass(frozen=True)
class Plan:
    """What one run does."""

    mutants: list[Mutant]
    labels: list[Label]  # variants, and the components
    profile: str
    jobs: int

    def settings(self) -> dict[str, Any]:
        """What must be the same for a run to go on."""
        return {
            "profile": self.profile,
            "labels": [list(label) for label in self.labels],
            "mutants": [mutant.name for mutant in self.mutants],
            "sources": source_digest(),
        }

    def tasks(self) -> list[int]:
        """Numbers of the errors that the chosen cases can notice."""
        cases = {label[0] for label in self.labels}
        return [
            k
            for k, mutant in enumerate(self.mutants)
            if mutant.side != "lammps" or any(name.split()[0] in cases for name in mutant.cases)
        ]


def plan_of(mutants: list[Mutant], cases: Sequence[str], profile: str, jobs: int) -> Plan:
    """All variants and the components, or the named cases alone; and the errors of the profile.

    Raises CaseError for a case that there is not, or that is compared by ensembles only.
    """
    labels = comparable_variants(cases)
    if not cases:
        labels.append((COMPONENTS, ""))
        labels = labels if profile == "full" else quick_order(labels)
    if profile != "full":
        mutants = [mutant for mutant in mutants if mutant.profile == "quick"]
    return Plan(mutants, labels, profile, jobs)


def quick_order(labels: Sequence[Label]) -> list[Label]:
    """What the quick profile runs, what finds most in a second first: an error is asked about until one does.

    One variant of each case, the components, the other variants, and then the cases that are slow.

    >>> quick_order([("swarm", ""), ("wall", "30deg"), ("wall", "45deg"), ("components", "")])
    [('wall', '30deg'), ('components', ''), ('wall', '45deg'), ('swarm', '')]
    """
    own = [label for label in labels if label not in QUICK_LEAVES_OUT]
    cases = [label[0] for label in own]

    def rank(k: int) -> int:
        name = cases[k]
        return 3 if name in SLOW else 1 if name == COMPONENTS else 2 if name in cases[:k] else 0

    return [own[k] for k in sorted(range(len(own)), key=rank)]


def run_plan(plan: Plan, store: Store, progress: Progress) -> None:
    """Make every finding that is not there yet."""
    with tempfile.TemporaryDirectory(prefix="cmpcheck-sensitivity-", ignore_cleanup_errors=True) as name:
        work = Path(name).resolve()
        with _children(work, plan.jobs) as children:
            if _left(plan, store):
                prepare(work, plan.mutants)
                _baseline(plan, work, children, progress)
                before = _before(plan, store, children[0])
                orders.keep(store, work / BASELINE, plan.labels)
                _seeded(plan, store, children, before, progress)
                if plan.profile == "full":
                    _smallest(plan, store, children, before, progress)
        if (COMPONENTS, "") not in plan.labels:
            return  # some cases only: nothing about the statistics of polishing, nor about the tests
        false_alarms.keep(store, plan.profile, plan.jobs, progress)
        if plan.profile == "full":
            power.keep(store, plan.jobs, progress)
            pytest_score.keep(store, plan.mutants, plan.jobs, work, progress)


def _left(plan: Plan, store: Store) -> bool:
    """Whether any finding about a seeded error is missing."""
    full = plan.profile == "full"
    return any(
        store.get(SEEDED, mutant.name) is None
        or (full and mutant.continuous and store.get(SMALLEST, mutant.name) is None)
        for mutant in (plan.mutants[k] for k in plan.tasks())
    )


@contextmanager
def _children(work: Path, jobs: int) -> Iterator[list[Child]]:
    """Processes that end with this one: where it is killed, they find no more requests."""
    children = [Child(work) for _ in range(jobs)]
    try:
        yield children
    finally:
        for child in children:
            child.close()


def _baseline(plan: Plan, work: Path, children: Sequence[Child], progress: Progress) -> None:
    """Every variant in every engine without an error; one task compiles for each."""
    labels = [list(label) for label in plan.labels if label[0] != COMPONENTS]
    tasks = [("reference", labels)] if labels else []
    if make_engine("lammps").info().available:
        with_table = [
            label for label in plan.labels if label[0] != COMPONENTS and "lammps" in case_of(label).engine
        ]
        tasks += [("lammps", [list(label)]) for label in with_table]

    def work_on(child: Child, task: tuple[str, list]) -> None:
        reply = ask_twice(child, {"do": "baseline", "engine": task[0], "labels": task[1]})
        if reply["problem"]:
            raise RuntimeError(f"{task[0]} without an error: {reply['problem']}")

    done = 0

    def one(task: Any, _: Any) -> None:
        nonlocal done
        done += 1
        progress("without errors", done, len(tasks))

    run_parallel(tasks, work_on, children, one)


def _before(plan: Plan, store: Store, child: Child) -> list[Noticed]:
    """The rows that are bad without any error."""
    kept = store.get(BEFORE, "rows")
    if kept is None:
        kept = [  # label by label: the patience for one request is not that for compiling all
            asdict(row) for label in plan.labels for row in evaluate(child, plan.mutants, None, 0.0, [label])
        ]
        store.put(BEFORE, "rows", kept)
    return [Noticed(**row) for row in kept]


def _seeded(
    plan: Plan, store: Store, children: Sequence[Child], before: list[Noticed], progress: Progress
) -> None:
    """Every error at its own size; in the quick profile until something notices it."""
    tasks = plan.tasks()
    left = [k for k in tasks if store.get(SEEDED, plan.mutants[k].name) is None]

    def work_on(child: Child, number: int) -> dict[str, Any]:
        mutant = plan.mutants[number]
        if plan.profile == "full":
            found = only_new(evaluate(child, plan.mutants, number, mutant.size, plan.labels), before)
        else:
            found = first_noticing(child, plan.mutants, number, before, plan.labels)
        return record(mutant, found) | {"noticed": [asdict(row) for row in found]}

    def one(number: int, found: dict[str, Any]) -> None:
        store.put(SEEDED, plan.mutants[number].name, found)
        progress(
            "seeded errors",
            sum(store.get(SEEDED, plan.mutants[k].name) is not None for k in tasks),
            len(tasks),
        )

    progress("seeded errors", len(tasks) - len(left), len(tasks))
    run_parallel(left, work_on, children, one)


def _smallest(
    plan: Plan, store: Store, children: Sequence[Child], before: list[Noticed], progress: Progress
) -> None:
    """The smallest noticed size of every error that has one."""
    tasks = [k for k in plan.tasks() if plan.mutants[k].continuous]
    left = [k for k in tasks if store.get(SMALLEST, plan.mutants[k].name) is None]

    def work_on(child: Child, number: int) -> dict[str, Any]:
        found = [Noticed(**row) for row in store.get(SEEDED, plan.mutants[number].name)["noticed"]]
        return smallest(child, plan.mutants, number, found, before, plan.labels)

    def one(number: int, found: dict[str, Any]) -> None:
        store.put(SMALLEST, plan.mutants[number].name, found)
        done = sum(store.get(SMALLEST, plan.mutants[k].name) is not None for k in tasks)
        progress("smallest sizes", done, len(tasks))

    progress("smallest sizes", len(tasks) - len(left), len(tasks))
    run_parallel(left, work_on, children, one)
