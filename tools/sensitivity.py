"""Bring README.md up to date with reports/sensitivity, after `make sensitivity` has written it.

The lines between the marks in README.md are written from sensitivity.json.  Nothing is computed here.
"""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOUND = ROOT / "reports" / "sensitivity"
MARKS = re.compile(r"(<!-- sensitivity: begin -->\n).*?(<!-- sensitivity: end -->)", re.DOTALL)
# Errors whose limits a reader asks for first, and how they are called here
SHOWN = {
    "pair restitution": "restitution of two particles",
    "wall restitution": "restitution on the surface",
    "dynamic friction": "friction while slipping",
    "stick impulse": "friction while sticking",
    "static friction": "where sticking ends",
    "Stokes's drag": "drag, Stokes's",
    "drag in Eq 9": "drag during an impact",
    "Hertz's duration": "duration of an impact",
    "yield stress": "yield stress",
    "cap volume": "volume of a cap",
    "removed volume": "volume taken off the surface",
    "normal turned": "normal of the surface",
    "surface shifted": "place of the surface",
    "pad restitution": "restitution of the pad",
    "fix: drag": "drag in LAMMPS",
    "deck: friction": "friction in a LAMMPS deck",
}


def percent(fraction: float) -> str:
    """A fraction as it is read."""
    return f"{100 * fraction:.2g} %"


def limit(entry: dict) -> str:
    """The smallest size that is noticed."""
    if entry["smallest_detected"] is None:
        return f"noticed at {entry['size']:.2g} {entry['unit']}" if entry["detected"] else "not noticed"
    below = "< " if entry["largest_not_detected"] is None else ""
    return f"{below}{entry['smallest_detected']:.2g} {entry['unit']}"


def text(document: dict) -> str:
    """Counts, the limits of a few errors, false alarms, and the score of the tests."""
    entries = {entry["name"]: entry for entry in document["mutants"]}
    noticed = sum(entry["detected"] for entry in entries.values())
    reasons = sum(bool(entry["explained"]) for entry in entries.values())
    lines = [
        f"Of {len(entries)} seeded errors {noticed} are noticed"
        + (f"; why {reasons} cannot be is derived there" if reasons else "")
        + ". Limits of some:",
        "",
        "| error in | noticed from |",
        "|---|---|",
        *(f"| {called} | {limit(entries[name])} |" for name, called in SHOWN.items() if name in entries),
        "",
    ]
    rate, tests, power = document["false_alarm_rate"], document["tests"], document["power"]
    if rate:
        resolved, different = rate["resolved"], rate["different"]
        span = f"{percent(resolved['low'])} to {percent(resolved['high'])}"
        lines.append(
            f"Of {rate['trials']} ensembles of equal engines {resolved['count']} differ from zero in "
            f"some quantity ({span}; {percent(rate['alpha'])} is stated), {different['count']} are called a "
            "disagreement."
        )
    if tests:
        where = [(entry["where"], entry["side"]) for entry in entries.values()]
        seeded = sum(file.startswith("reference/") and side == "reference" for file, side in where)
        rest = seeded - tests["asked"]
        asked = f"{tests['killed']} of the {tests['asked']} errors seeded into it"
        lines.append(
            f"The tests of the model fail for {asked}"
            + (f"; {rest} more are not tried yet." if rest else ".")
        )
    if power and power["seconds"]:
        each = " and ".join(f"{value:.2g} CPU s in {name}" for name, value in power["seconds"].items())
        needed = max(curve["needed"] for curve in power["curves"])
        lines.append(
            f"Showing that two engines polish alike with a power of 90 % takes {needed} pairs of samples; "
            f"a pair costs {each}."
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Rewrite the lines, and drop what need not be kept."""
    document = json.loads((FOUND / "sensitivity.json").read_text("utf-8"))
    readme = ROOT / "README.md"
    new = MARKS.sub(lambda match: match.group(1) + text(document) + match.group(2), readme.read_text("utf-8"))
    readme.write_text(new, "utf-8")
    shutil.rmtree(FOUND / "data", ignore_errors=True)  # single findings can be made again


if __name__ == "__main__":
    main()
