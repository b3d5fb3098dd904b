"""What notices a seeded error: the comparisons of `cmpcheck compare`, made while the error is on.

A row that disagrees or fails, and does not without the error, notices it.  What the other engine does rightly
is taken from a run without the error (`Baseline`), so that most errors cost the reference's runs only.
"""

from __future__ import annotations

import contextlib
import pickle
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cmpcheck.compare import compare_study, limits
from cmpcheck.components import check_components
from cmpcheck.engines.lammps import LammpsEngine
from cmpcheck.engines.protocol import Engine, Resolution
from cmpcheck.engines.reference import ReferenceEngine
from cmpcheck.horizon import compare_ledgers, study_horizon
from cmpcheck.judges import judge_of
from cmpcheck.judges.swarm import SwarmJudge
from cmpcheck.parting import Parting
from cmpcheck.published.benchmark import benchmark_names
from cmpcheck.results import EngineInfo
from cmpcheck.sensitivity.mutants import Mutant
from cmpcheck.sensitivity.patching import deck_file, patched
from cmpcheck.sensitivity.switch import switched_on
from cmpcheck.study import Study, align_outputs, engine_study, reference_study
from cmpcheck.suite_cases import comparable_cases, is_ensemble
from reference.case import Case, load_case
from reference.process import build_setup
from reference.recording import Run
from reference.state import Setup

COMPONENTS = "components"  # the name under which `components.py` stands among the cases
BAD = ("disagree", "error")
# No single run depends on these files: ensembles and searches do, and the verdicts on them
NO_CASE = (
    "reference/ensemble.py", "reference/genetic.py", "cmpcheck/statistics/equivalence.py",
    "cmpcheck/statistics/resampling.py",
)  # fmt: skip
FAST = "reference/fast/"  # no case either: they run by the plain stepper

Label = tuple[str, str]  # case, variant
Switch = Callable[[], AbstractContextManager[Any]]


@dataclass(frozen=True)
class Noticed:
    """One row that is bad."""

    case: str
    variant: str
    engine: str
    quantity: str
    status: str
    ratio: float | None  # error/tolerance

    @property
    def key(self) -> tuple[str, str, str, str]:
        """What tells it from other rows."""
        return self.case, self.variant, self.engine, self.quantity

    @property
    def check(self) -> str:
        """The check that the row belongs to, whatever its variant."""
        return f"{self.case}: {self.quantity}" + ("" if self.engine == "reference" else f" ({self.engine})")


def comparable_variants(cases: Sequence[str] = ()) -> list[Label]:
    """What is run: every variant of the cases; without names, of all that `compare` judges one by one.

    Published benchmarks are left out: they test engines, and no equation of the paper enters them.
    """
    return [
        (name, variant.variant)
        for name in cases or [name for name in comparable_cases("quick") if name not in benchmark_names()]
        for variant in load_case(name).variants()
        if not is_ensemble(variant)
    ]


def case_of(label: Label) -> Case:
    """The case of a label."""
    return next(v for v in load_case(label[0]).variants() if v.variant == label[1])


class _Switched:
    """An engine that makes the error, or does not, while it runs."""

    def __init__(self, engine: Engine, switch: Switch) -> None:
        self.engine, self.switch, self.name = engine, switch, engine.name
        self.surface_forms = engine.surface_forms

    def info(self) -> EngineInfo:
        """As the engine itself."""
        return self.engine.info()

    def run(self, setup: Setup, resolution: Resolution) -> Run:
        """Run with the switch in its position."""
        with self.switch():
            return self.engine.run(setup, resolution)


@dataclass(frozen=True)
class Baseline:
    """Studies without any error, kept in files of one folder, an engine and form each."""

    folder: Path

    def _file(self, label: Label, engine: str, form: str = "") -> Path:
        name = (Path(label[0]).stem, label[1], engine, form)
        return self.folder / f"{'-'.join(filter(None, name))}.pickle"

    def make(self, label: Label, engine: str) -> None:
        """Run one variant in one engine, and keep what was found."""
        setup = align_outputs(build_setup(case_of(label)))
        judge = judge_of(setup)
        if engine == "reference":
            study = reference_study(ReferenceEngine(), judge, setup, "quick")
            horizon = study_horizon(ReferenceEngine(), study) if isinstance(judge, SwarmJudge) else None
            self._keep(self._file(label, engine), study, horizon)
            return
        other = LammpsEngine(in_process=True)
        for form in _forms(judge):
            study = engine_study(other, judge, setup, "quick", form)
            horizon = study_horizon(other, study) if isinstance(judge, SwarmJudge) else None
            self._keep(self._file(label, engine, form), study, horizon)

    def _keep(self, file: Path, study: Study, horizon: Parting | None) -> None:
        if horizon is None:  # only ledgers need the runs again
            for level in study.levels:
                level.run = None  # type: ignore[assignment]
        self.folder.mkdir(parents=True, exist_ok=True)
        part = file.with_suffix(".part")
        part.write_bytes(pickle.dumps((study, horizon)))
        part.replace(file)

    def study(self, label: Label, engine: str, form: str = "") -> tuple[Study, Parting | None] | None:
        """A study and its horizon; None where the engine is missing."""
        file = self._file(label, engine, form)
        return pickle.loads(file.read_bytes()) if file.exists() else None


def _forms(judge: Any) -> tuple[str, ...]:
    return ("soft", "impulse") if judge.has_surface_contact else ("native",)


def bad_rows(
    mutant: Mutant | None, number: int, size: float, labels: Sequence[Label], baseline: Baseline, tree: Path,
    profile: str = "quick",
) -> list[Noticed]:  # fmt: skip
    """Every row that disagrees or fails while the error is on; without one, those that do so anyway.

    `profile` is that of the components; cases are always run in their quick form.
    """

    def on() -> AbstractContextManager[Any]:
        return switched_on(number, size) if mutant is not None else nullcontext()

    rows: list[Any] = []
    theirs = mutant is not None and mutant.side in ("lammps", "both")
    for label in labels:
        asked = mutant is not None and (label[0] in mutant.cases or " ".join(label).strip() in mutant.cases)
        if mutant is not None and ((mutant.side == "lammps" and not asked) or _in_no_case(mutant)):
            continue
        with _deck(mutant, size, tree) as decks:
            rows += _rows_of(mutant, label, on, theirs and asked, baseline, decks)
    if (COMPONENTS, "") in labels:
        with on():
            rows += check_components(
                "" if mutant is None else mutant.file, _component_engines(mutant), in_process=True,
                profile=profile,
            )  # fmt: skip
            # in process, for the error is on in this one only
    return [
        Noticed(
            r.case, r.variant, r.engine, r.quantity, r.status, r.error / r.tolerance if r.tolerance else None
        )
        for r in rows
        if r.status in BAD
    ]


def _in_no_case(mutant: Mutant) -> bool:
    return mutant.file in NO_CASE or mutant.file.startswith(FAST)


def _component_engines(mutant: Mutant | None) -> tuple[str, ...]:
    """Whose components are checked: of who makes the error, and LAMMPS's where the error asks for them."""
    if mutant is None:
        return "reference", "lammps"
    ours = ("reference",) if mutant.side != "lammps" else ()
    return ours + (("lammps",) if COMPONENTS in mutant.cases else ())


@contextlib.contextmanager
def _deck(mutant: Mutant | None, size: float, tree: Path) -> Iterator[dict[str, Path]]:
    """The decks to be used, with the error of a mutant of one."""
    if mutant is None or mutant.file.endswith(".py"):
        yield {}
        return
    source = deck_file(tree, mutant)
    with tempfile.TemporaryDirectory(prefix="cmpcheck-") as folder:
        path = Path(folder) / source.name
        path.write_text(patched(source.read_text("utf-8"), mutant, repr(size)), "utf-8")
        yield {source.name.removeprefix("in."): path}


def _rows_of(
    mutant: Mutant | None, label: Label, on: Switch, run_lammps: bool, baseline: Baseline, decks: dict
) -> list[Any]:
    """The comparisons of one variant, as `variant_task.run_task` makes them."""
    if label[0] == COMPONENTS:
        return []
    wrong = mutant is not None and mutant.side in ("reference", "both")
    with on() if wrong else nullcontext():
        try:
            case = case_of(label)
            setup = align_outputs(build_setup(case))
            judge = judge_of(setup)
            if wrong or mutant is None:
                ours = reference_study(ReferenceEngine(), judge, setup, "quick")
                swarm = isinstance(judge, SwarmJudge)
                horizon = study_horizon(ReferenceEngine(), ours) if swarm else None
            else:
                kept = baseline.study(label, "reference")
                assert kept is not None
                ours, horizon = kept
            rows: list[Any] = list(compare_study(case, ours, None)) if wrong or mutant is None else []
        except (RuntimeError, ValueError, ArithmeticError, AssertionError, LookupError) as problem:
            return [_Failure(label, "reference", problem)]
        for form in _forms(judge):
            name = f"lammps {form}"
            try:
                other = _other(label, on, run_lammps, baseline, decks, judge, setup, form)
                if other is None:
                    continue
                study, their_horizon = other
                if horizon is not None and their_horizon is not None:
                    rows.append(compare_ledgers(case, (ours, horizon), (study, their_horizon))[0])
                rows += compare_study(case, study, limits(ours))
            except Exception as problem:  # whatever an engine does, the other comparisons go on
                rows.append(_Failure(label, "lammps", problem, name))
    return rows


def _other(
    label: Label, on: Switch, run_lammps: bool, baseline: Baseline, decks: dict, judge: Any, setup: Setup,
    form: str,
) -> tuple[Study, Parting | None] | None:  # fmt: skip
    """LAMMPS's study: with the error where it makes it, else the one that was kept."""
    if not run_lammps:
        return baseline.study(label, "lammps", form)
    engine = _Switched(LammpsEngine(decks, in_process=True), on)
    study = engine_study(engine, judge, setup, "quick", form)
    return study, study_horizon(engine, study) if isinstance(judge, SwarmJudge) else None


class _Failure:
    """A run that gave no comparison, as a row."""

    quantity, status, error, tolerance = "run", "error", 0.0, 0.0

    def __init__(self, label: Label, engine: str, problem: Exception, form: str = "") -> None:
        self.case, self.engine = label[0], engine
        self.variant = ", ".join(filter(None, (label[1], form)))
        text = str(problem)
        if "the balance of" in text:
            self.quantity = "balance of " + text.split("the balance of ")[1].split(" is off")[0]


def only_new(found: Sequence[Noticed], before: Sequence[Noticed]) -> list[Noticed]:
    """The rows that are bad because of the error."""
    known = {row.key for row in before}
    return [row for row in found if row.key not in known]
