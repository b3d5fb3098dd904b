"""The verdict on a run of the suite: counts, exit code, the matrix case x engine, the worst rows.

Statuses of single rows are decided in `compare.py`; nothing here computes an error or a tolerance, and
nothing here writes a file.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from cmpcheck.results import STATUSES, CaseResult, Comparison, SuiteResult

REFERENCE = "reference"
KNOWN = "known"  # a row that disagrees as a known departure says it must
SEVERITY = ("error", "disagree", KNOWN, "not_tested", "agree")
WORDS = {
    "agree": "agree",
    "disagree": "disagree",
    KNOWN: "disagree, known",
    "not_tested": "not tested",
    "error": "error",
}
SYMBOLS = {"agree": "✓", "disagree": "✗", KNOWN: "≠", "not_tested": "–", "error": "!"}


@dataclass(frozen=True)
class Cell:
    """One case as one engine did it."""

    case: str
    engine: str
    counts: dict[str, int]  # of every status in SEVERITY that occurs
    worst: float | None  # the largest error/tolerance; None where nothing was judged, or departures are known
    absent: bool = False  # the engine is not on this machine

    @property
    def status(self) -> str:
        """The status to be shown first; "" where the engine has no row for the case."""
        made = [status for status in SEVERITY if status in self.counts]
        if made[:1] == ["not_tested"] and "agree" in made:
            return "agree"  # the untested rows are counted beside it
        return made[0] if made else "not_tested" if self.absent else ""

    @property
    def others(self) -> list[tuple[str, int]]:
        """How many rows have another status than the one shown first, gravest first."""
        return [(status, n) for status, n in self.counts.items() if status != self.status]


def standing(row: Comparison) -> str:
    """The row's status, or `KNOWN` when a listed departure explains its disagreement.

    Raises ValueError on a status that is not one of `results.STATUSES`.
    """
    if row.status not in STATUSES:
        raise ValueError(f"status of {row.case}, {row.quantity} is {row.status!r}; allowed: {STATUSES}")
    return KNOWN if row.status == "disagree" and row.known_departure else row.status


def part_of(row: Comparison) -> str:
    """The part of the report that a row belongs to: "1" the reference, "2" other engines, "3" ensembles."""
    if row.kind == "statistical":
        return "3"
    return "1" if row.engine == REFERENCE else "2"


def ratio(row: Comparison) -> float | None:
    """error/tolerance of a row that was judged; infinite for an error against a zero tolerance."""
    if row.status not in ("agree", "disagree") or math.isnan(row.error) or math.isnan(row.tolerance):
        return None
    if row.error == 0:
        return 0.0
    if row.tolerance == 0:
        return math.inf
    return row.error / row.tolerance


def count(rows: Iterable[Comparison]) -> dict[str, int]:
    """How many rows stand how, gravest first; a standing that does not occur is left out."""
    tally = dict.fromkeys(SEVERITY, 0)
    for row in rows:
        tally[standing(row)] += 1
    return {status: n for status, n in tally.items() if n}


def verdict(result: SuiteResult) -> str:
    """The one word for the whole run: agree, disagree or incomplete.

    A row that disagrees or failed makes it "disagree", unless a known departure explains it.  An absent
    engine, a row without verdict, and a case without any row each make it "incomplete".  A study has no
    verdict, but one that failed makes it "disagree".
    """
    counts = count(result.comparisons)
    if "disagree" in counts or "error" in counts or any(study.error for study in result.studies):
        return "disagree"
    gaps = (
        "not_tested" in counts
        or not result.cases
        or any(not case.comparisons for case in result.cases)
        or any(not engine.available for engine in result.engines)
    )
    return "incomplete" if gaps else "agree"


def exit_code(result: SuiteResult, strict: bool = False) -> int:
    """0 when nothing disagrees or failed, else 1; `strict` asks for the verdict "agree".

    A run that compared nothing is no success: 1.  Code 2 (bad input, a requested engine is missing) is
    for the command line, which knows what was requested.
    """
    word = verdict(result)
    empty = not result.comparisons and not result.studies
    return int(word == "disagree" or empty or (strict and word != "agree"))


def engine_names(result: SuiteResult) -> list[str]:
    """Every engine, the reference first, then as the suite lists them, then any that only a row names."""
    names = [engine.name for engine in result.engines] + [row.engine for row in result.comparisons]
    return sorted(dict.fromkeys(names), key=lambda name: name != REFERENCE)


def matrix(result: SuiteResult) -> list[list[Cell]]:
    """One list of cells per case, one cell per engine, in the order of `engine_names`."""
    absent = {engine.name for engine in result.engines if not engine.available}

    def cell(case: CaseResult, engine: str) -> Cell:
        rows = [row for row in case.comparisons if row.engine == engine]
        ratios = [r for row in rows if (r := ratio(row)) is not None]
        if any(standing(row) == KNOWN for row in rows):
            ratios = []  # how large a departure is, its row says
        return Cell(case.name, engine, count(rows), max(ratios, default=None), engine in absent)

    return [[cell(case, engine) for engine in engine_names(result)] for case in result.cases]


def worst_first(rows: Iterable[Comparison]) -> list[Comparison]:
    """The rows by gravity of their status, then by error/tolerance; equal rows keep their order."""

    def gravity(row: Comparison) -> tuple[int, float]:
        value = ratio(row)
        return SEVERITY.index(standing(row)), -(math.inf if value is None else value)

    return sorted(rows, key=gravity)


def closeness(result: SuiteResult) -> dict[str, dict[str, float]]:
    """The largest error relative to the reference value, by quantity and engine.

    Rows without verdict and known departures count for nothing, nor do those whose reference is zero
    within the tolerance: a relative error says nothing about them.
    """
    table: dict[str, dict[str, float]] = {}
    for row in result.comparisons:
        if ratio(row) is None or standing(row) == KNOWN or not row.tolerance < abs(row.reference):
            continue
        relative = row.error / abs(row.reference)
        engines = table.setdefault(row.quantity, {})
        engines[row.engine] = max(relative, engines.get(row.engine, 0.0))
    return table


def headline(result: SuiteResult) -> str:
    """The verdict in one sentence, with its numbers."""
    counts, total = count(result.comparisons), len(result.comparisons)
    made = total - counts.get("not_tested", 0)
    bad, failed = counts.get("disagree", 0), counts.get("error", 0)
    known, agreeing = counts.get(KNOWN, 0), counts.get("agree", 0)
    if bad or failed:
        parts = []
        if bad:
            parts.append(f"{bad} of {made} comparisons {'lies' if bad == 1 else 'lie'} outside the tolerance")
        if failed:
            parts.append(f"{failed} could not be computed")
        sentence = " and ".join(parts) + f"; {agreeing} agree"
    elif made == 0:
        sentence = "No comparison was made"
    elif agreeing == made:
        sentence = f"All {made} comparisons made agree" if made > 1 else "The one comparison made agrees"
    else:
        sentence = f"{agreeing} of {made} comparisons made agree"
    if known:
        sentence += f"; {known} disagree{'s' * (known == 1)} by a known departure of its listed size"
    return sentence + "."


def title(result: SuiteResult) -> str:
    """The verdict as a heading."""
    if not result.comparisons:
        return "Studies" if result.studies else f"{SYMBOLS['not_tested']} Nothing was compared"
    word = verdict(result)
    if word == "disagree":
        return f"{SYMBOLS['disagree']} Something disagrees"
    known = " but for known departures" if KNOWN in count(result.comparisons) else ""
    if word == "incomplete":
        return f"{SYMBOLS['not_tested']} Nothing disagrees{known}, and the test is incomplete"
    return f"{SYMBOLS['agree']} Everything compared agrees{known}"


def gaps(result: SuiteResult) -> list[str]:
    """What was not tested, a sentence each."""
    sentences = [
        f"{engine.name} is absent and was not tested." for engine in result.engines if not engine.available
    ]
    absent = {engine.name for engine in result.engines if not engine.available}
    undecided = sum(row.status == "not_tested" and row.engine not in absent for row in result.comparisons)
    if undecided:
        sentences.append(
            f"{undecided} comparison{'s have' if undecided > 1 else ' has'} no verdict; the table says why."
        )
    empty = [case.name for case in result.cases if not case.comparisons]
    if empty:
        sentences.append(f"No comparison was made for {', '.join(empty)}.")
    if not result.cases:
        sentences.append("No case was run.")
    broken = [study.name for study in result.studies if study.error]
    if broken:
        sentences.append(
            f"{'These studies' if len(broken) > 1 else 'This study'} failed: {', '.join(broken)}."
        )
    return sentences
