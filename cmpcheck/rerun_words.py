"""What changed between two reports, told: as JSON, in lines for a terminal, as a page of Markdown."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from cmpcheck.display import quantity_text
from cmpcheck.markdown import pipe_table, plain
from cmpcheck.rerun import ROUND_OFF, Changes, RowChange, Side

SCHEMA = "cmpcheck-changes/1"
WORDS = {
    "identical": "identical",
    "round-off": "changed within round-off",
    "value": "value changed",
    "verdict": "verdict changed",
    "gone": "gone",
    "new": "new",
}
SAME = "Made with the same versions, commit, cases and kind of machine."


def changes_json(changes: Changes) -> str:
    """All of it as JSON of schema "cmpcheck-changes/1"."""
    document = {
        "schema": SCHEMA,
        "verdict": {"before": changes.verdicts[0], "after": changes.verdicts[1]},
        "counts": changes.counts,
        "rows": [
            asdict(row)
            | {name: side and side._asdict() for name, side in (("before", row.before), ("after", row.after))}
            for row in changes.rows
        ],
        "origins": [asdict(origin) for origin in changes.origins],
        "studies": list(changes.studies),
    }
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def sentences(changes: Changes) -> list[str]:
    """What changed, in lines for a terminal."""
    counts, lines = changes.counts, []
    said = ", ".join(f"{n} {WORDS[change]}" for change, n in counts.items() if n)
    lines.append(f"{len(changes.rows)} rows: {said}")
    for row in changes.rows:
        if row.change in ("value", "verdict", "gone", "new"):
            sides = [_side_text(side, row.unit) for side in (row.before, row.after) if side is not None]
            where = f"{_place(row)}, {row.engine}, {row.quantity}"
            lines.append(f"  {WORDS[row.change]}: {where}: {' -> '.join(sides)}")
    lines += [f"  says something else: the study {name}" for name in changes.studies]
    lines += [f"  {o.key}: {o.before or 'none'} -> {o.after or 'none'}" for o in changes.origins]
    if not changes.origins:
        lines.append(f"  {SAME}")
    return lines


def _place(row: RowChange) -> str:
    return " ".join(filter(None, (row.case, row.variant)))


def _side(side: Side | None) -> dict[str, Any] | None:
    return None if side is None else side._asdict()


def _side_text(side: Side | None, unit: str) -> str:
    if side is None:
        return ""
    value = "" if side.measured is None else f"{quantity_text(side.measured, unit, digits=9)}, "
    return f"{value}{side.status}"


def changes_markdown(changes: Changes) -> str:
    """The same as a page: counts, the rows that changed, and what the reports were made with."""
    lines = ["# What changed", "", f"Verdict before: {changes.verdicts[0]}; now: {changes.verdicts[1]}.", ""]
    lines += pipe_table(["rows", "number"], [[WORDS[name], str(n)] for name, n in changes.counts.items()])
    lines += ["", f"Round-off is {ROUND_OFF:.2g} of a value, or the tolerance of a row that bounds rounding."]
    changed = [row for row in changes.rows if row.change != "identical"]
    if changed:
        lines += ["", "## Rows", ""]
        lines += pipe_table(
            ["case", "engine", "quantity", "what", "before", "now"],
            [
                [_place(row), row.engine, row.quantity, WORDS[row.change], _side_text(row.before, row.unit),
                 _side_text(row.after, row.unit)]
                for row in changed
            ],
        )  # fmt: skip
    if changes.studies:
        lines += ["", f"Studies that say something else: {', '.join(map(plain, changes.studies))}."]
    lines += ["", "## Made with", ""]
    if changes.origins:
        rows = [[origin.key, origin.before or "none", origin.after or "none"] for origin in changes.origins]
        lines += pipe_table(["entry", "before", "now"], rows)
    else:
        lines.append(SAME)
    return "\n".join(lines) + "\n"
