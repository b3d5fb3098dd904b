"""The cases of a comparison: which there are, and what of a user's is refused before anything is run.

What is then done with one is `variant_task.py`; benchmarks of the field count as cases of one variant.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cmpcheck.engines.child import Child, ChildError, ChildLost
from cmpcheck.engines.lammps_contract import check_deck
from cmpcheck.engines.protocol import Resolution, timeout_of
from cmpcheck.judges import judge_of
from cmpcheck.published import benchmark_names
from cmpcheck.published.run import RUNNERS
from cmpcheck.study import contact_settings, has_settings
from cmpcheck.trajectories import Trajectories
from reference.case import Case, CaseError, available_cases, load_case
from reference.process import build_setup


def comparable_cases(profile: str, engines: Sequence[str] = ()) -> list[str]:
    """The cases that ship and say, by an `[engine.NAME]` table, how another engine resolves them.

    With `engines`, those that say so for one of them.  Ensembles, whose verdict needs minutes of samples, are
    compared by default in the full profile only.  Benchmarks of the field, which engines alone run, follow.
    """
    others = set(engines) - {"reference"}
    cases = [load_case(name) for name in available_cases()]
    names = [
        case.name
        for case in cases
        if case.engine
        and (not others or any(has_settings(case, name) for name in others))
        and (profile == "full" or not is_ensemble(case))
    ]
    return names + (benchmark_names() if not engines or others & set(RUNNERS) else [])


def variants_by_case(names: Sequence[str]) -> dict[str, list[str]]:
    """Each case's own name and its variants, a benchmark being one.  Raises CaseError for what is no case."""
    found = {}
    for name in names:
        if name in benchmark_names():
            found[name] = [""]
        else:
            case = load_case(name)
            found[case.name] = [variant.variant for variant in case.variants()]
    return found


def is_ensemble(case: Case) -> bool:
    """Whether trajectories of a case part too early to be compared: many particles wear a surface."""
    alone = len(case.particle) == 1 and case.removal is None and case.fluid is None
    return (case.pad is not None and not alone) or (
        case.particles is not None and case.surface.kind != "none"
    )


def check_case(case: Case, engines: Sequence[str], files: Trajectories) -> None:
    """Refuse a case that cannot be set up, or compared with the engines or files.  Raises CaseError."""
    for variant in case.variants():
        setup = build_setup(variant)
        if is_ensemble(variant) and files.of(variant):
            raise CaseError(f"{case.name}: ensembles of samples are compared; one trajectory says nothing")
        if not is_ensemble(variant):
            judge_of(setup)
            files.check(setup)
        elif not variant.engine:
            raise CaseError(f"{case.name}: nothing to compare with: the case has no [engine.NAME] table")
        for name in engines:
            if has_settings(variant, name):
                _check_settings(variant, name)
                timeout_of(variant, name)


def _check_settings(variant: Case, engine: str) -> None:
    """Refuse a case whose `[engine.NAME]` table lacks what the comparison needs.  Raises CaseError."""
    if is_ensemble(variant):
        from cmpcheck.ensembles import check_settings

        check_settings(variant, engine)
    else:
        contact_settings(variant, engine)


def check_decks(cases: list[Case], decks: dict[str, Path], engines: tuple[str, ...]) -> None:
    """Refuse a user's deck that lacks what the engine needs; LAMMPS reads it in a process of its own.

    Raises CaseError naming all of it.
    """
    tasks = [(case, decks[case.name]) for case in cases if case.name in decks and "lammps" in engines]
    if not tasks:
        return
    child = Child()
    try:
        for case, path in tasks:
            limit = timeout_of(case.variants()[0], "lammps")
            try:
                child.call(_check_deck, (case, path), timeout=limit)
            except ChildLost as problem:
                raise CaseError(f"{path}: cannot be checked: {problem}") from None
            except ChildError as problem:
                raise CaseError(str(problem)) from None
    finally:
        child.stop()


def _check_deck(task: tuple[Case, Path]) -> None:
    case, path = task
    variant = case.variants()[0]
    duration, steps = contact_settings(variant, "lammps")
    check_deck(path, build_setup(variant), Resolution(duration / steps, duration))
