"""What the document says, in sentences and tables of text, for the page, the report and Markdown."""

from __future__ import annotations

from typing import Any

from cmpcheck.display import number, percent
from cmpcheck.display import words as spaced
from cmpcheck.sensitivity.document import explained, holes

COARSEST = 3
SIDES = {"reference": "reference", "lammps": "LAMMPS", "both": "both"}
PERCENT = "%"


def headline(document: dict[str, Any]) -> str:
    """How many errors are noticed."""
    mutants, lost, reasons = document["mutants"], holes(document), explained(document)
    noticed = sum(m["detected"] for m in mutants)
    text = f"{noticed} of {len(mutants)} seeded errors are noticed"
    if not document["whole"]:
        cases = dict.fromkeys(label.split()[0] for label in document["run"])
        text += f" by {', '.join(cases)} alone"
    if reasons:
        text += f"; {len(reasons)} cannot be, as derived below"
    if lost:
        text += f"; {len(lost)} are holes: {', '.join(lost)}"
    return text + "."


def size_text(mutant: dict[str, Any], key: str = "size") -> str:
    """A size with its unit, "" for an error without one and where it is not known."""
    if not mutant["unit"]:
        return ""
    return "" if mutant[key] is None else f"{number(mutant[key], 2)} {mutant['unit']}"


def limit_text(mutant: dict[str, Any]) -> str:
    """The smallest noticed size: below a bound where the search did not find an end."""
    if not mutant["unit"]:
        return "always" if mutant["detected"] else "never"
    if mutant["smallest_detected"] is None:
        return "" if mutant["detected"] else "never"
    if mutant["largest_not_detected"] is None:
        return f"< {number(mutant['smallest_detected'], 1)} {mutant['unit']}"
    return f"{number(mutant['smallest_detected'], 2)} {mutant['unit']}"


def finest_check(mutant: dict[str, Any]) -> str:
    """The check that notices the smallest size, one of them if there are several."""
    return spaced(mutant["by_smallest"][0]) if mutant.get("by_smallest") else ""


def blind_spots(document: dict[str, Any]) -> list[str]:
    """Three sentences on what the suite cannot see."""
    vanishing = ", ".join(f"“{m['name']}”" for m in explained(document))
    coarse = [
        m for m in document["mutants"] if m["unit"].startswith(PERCENT) and m["smallest_detected"] is not None
    ]
    coarse = sorted(coarse, key=lambda m: -m["smallest_detected"])[:COARSEST]
    worst = "; ".join(f"{m['name']} below {limit_text(m)}" for m in coarse)
    second = (
        f"Where a quantity enters weakly, large errors pass: {worst}."
        if coarse
        else "How large an error may be and pass, the full profile finds: here each has one size only."
    )
    limit = "The cases judge single impacts in the limit of small steps and short contacts: "
    return [
        limit
        + (
            f"what vanishes with them is not seen, such as {vanishing}."
            if vanishing
            else "what vanishes with them only those components can notice that look at single steps."
        ),
        second,
        "It shows that the equations are solved, not that they are right: an error that the paper, the "
        "closed forms and all engines have in common passes, as does whatever the model leaves out (spin, "
        "lubrication, Brownian motion) and, in polishing as a whole, any difference within the margins of "
        "the ensembles.",
    ]


def alarm_sentence(document: dict[str, Any]) -> str:
    """The rate of false alarms beside the stated one; "" where it was not measured."""
    rate = document["false_alarm_rate"]
    if not rate:
        return ""
    found, called = rate["resolved"], rate["different"]
    draws = (
        "no two trials share a sample"
        if rate["independent"]
        else "trials share samples, so that they are not independent"
    )
    return (
        f"Reference against reference: of {rate['trials']} comparisons of {rate['pairs']} pairs of "
        f"{rate['case']}, {found['count']} find a difference from zero in any of their quantities: "
        f"{percent(found['rate'])} (95 %: {percent(found['low'])} to {percent(found['high'])}), "
        f"where {percent(rate['alpha'])} is stated; {called['count']} call it a disagreement, "
        f"beyond the margin ({percent(called['low'])} to "
        f"{percent(called['high'])}). Drawn from {rate['samples']} samples; {draws}."
    )


def columns(document: dict[str, Any]) -> list[str]:
    """The cases that notice anything, in the order in which they were run."""
    run = list(dict.fromkeys(label.split()[0] for label in document["run"]))
    seen = {check.partition(":")[0] for m in document["mutants"] for check in m["by"]}
    return [name for name in run if name in seen] + sorted(seen - set(run))


def cells(mutant: dict[str, Any], names: list[str]) -> list[tuple[str, str]]:
    """For each case the number of checks that notice an error, and their names."""
    by: dict[str, list[str]] = {}
    for check in mutant["by"]:
        case, _, quantity = check.partition(": ")
        by.setdefault(case, []).append(spaced(quantity))
    return [(str(len(by[name])), ", ".join(by[name])) if name in by else ("", "") for name in names]


def order_rows(document: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Observed orders by case and engine."""
    header = [
        "case",
        "engine",
        "refined in",
        "levels",
        "quantities",
        "credible order",
        "median",
        "range",
        "largest index",
    ]
    rows = []
    for group in document["orders"].get("groups", []):
        middle = number(group["median"], 3) if group["credible"] else ""
        span = f"{number(group['lowest'], 3)} to {number(group['highest'], 3)}" if group["credible"] else ""
        rows.append([
            group["case"], group["engine"], group["parameter"], str(group["levels"]),
            str(group["quantities"]), str(group["credible"]), middle, span, percent(group["largest_index"]),
        ])  # fmt: skip
    return header, rows


def nasa_rows(document: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    """The published example of grid convergence beside what this suite makes of it."""
    nasa = document["orders"].get("nasa")
    if not nasa:
        return [], []
    names = [
        ("order", "observed order"),
        ("limit", "extrapolated value"),
        ("index", "grid convergence index"),
    ]
    return ["", "here", "published"], [
        [text, number(nasa[key], 7), number(nasa[f"{key}_published"], 7)] for key, text in names
    ]


def compared_text(curve: dict[str, Any]) -> str:
    """The quantity of a power curve and its time."""
    when = "the end" if curve["time"] == 1.0 else f"{number(curve['time'], 2)} T"
    return f"{spaced(curve['quantity'])} at {when}"


def pair_sentence(document: dict[str, Any]) -> str:
    """The sample sizes that follow from the power, and what they cost."""
    power = document["power"]
    if not power or not power["seconds"]:
        return ""
    seconds = power["seconds"]
    each = " and ".join(f"{number(value, 2)} CPU s in {name}" for name, value in seconds.items())
    widest = max(power["curves"], key=lambda curve: curve["needed"])
    runs = ", ".join(
        f"{profile} runs {n} pairs, {number(n * sum(seconds.values()) / 60, 2)} CPU min"
        for profile, n in power["pairs"].items()
    )
    return (
        f"A pair of samples costs {each}. The widest spread, of {compared_text(widest)}, needs "
        f"{widest['needed']} pairs to be called equivalent with a probability of 90 % where nothing differs: "
        f"{runs}."
    )


def pair_rows(document: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Pairs that each comparison needs, their power as simulated, and what they cost."""
    power = document["power"]
    if not power:
        return [], []
    seconds, numbers = sum((power["seconds"] or {}).values()), list(power["pairs"].values())
    header = [
        "quantity",
        "spread of a difference",
        "margin",
        "pairs for 90 %",
        "CPU s for them",
        *(f"equal engines called equivalent with {n} pairs" for n in numbers),
        *(f"two margins called different with {n} pairs" for n in numbers),
    ]
    found: dict[str, list[dict[str, Any]]] = {}
    for curve in power["curves"]:
        found.setdefault(compared_text(curve), []).append(curve)
    rows = []
    for text, curves in found.items():
        at = {curve["pairs"]: {point["effect"]: point for point in curve["points"]} for curve in curves}
        first = curves[0]
        rows.append([
            text, number(first["spread"], 2), number(first["margin"], 2), str(first["needed"]),
            number(first["needed"] * seconds, 2),
            *(percent(at[n][0.0]["equivalent"]) if n in at else "" for n in numbers),
            *(percent(at[n][2.0]["different"]) if n in at else "" for n in numbers),
        ])  # fmt: skip
    return header, rows


def test_sentence(document: dict[str, Any]) -> str:
    """The score of the tests."""
    tests = document["tests"]
    if not tests:
        return ""
    seeded = sum(
        m["where"].startswith("reference/") and m["side"] == "reference" for m in document["mutants"]
    )
    text = f"Of {tests['asked']} errors of the reference, the tests of the model fail for {tests['killed']}"
    if tests["asked"] < seeded:
        text += f" ({seeded - tests['asked']} more have not been tried)"
    if tests["survivors"]:
        text += f"; these survive them: {', '.join(tests['survivors'])}"
    return text + "."


def test_in_words(tests: list[str] | None) -> str:
    """The first of the tests that fail, as a sentence that can be read; "" where none has been asked.

    >>> test_in_words(["tests/test_drag.py::test_slow_drag_is_that_of_stokes"])
    'drag: slow drag is that of stokes'
    """
    if tests is None:
        return ""
    if not tests:
        return "none"
    file, _, name = tests[0].partition("::")
    name = name.split("[", 1)[0].removeprefix("test_").replace("_", " ")
    return f"{file.rsplit('/', 1)[-1].removesuffix('.py').removeprefix('test_')}: {name}"
