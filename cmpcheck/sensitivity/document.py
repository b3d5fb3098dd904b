"""sensitivity.json as it is read: what counts as a hole, what is explained, and whether all is well.

Building it from what a run has kept is `building.py`; words for people are `words.py`.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from cmpcheck.sensitivity.store import DOCUMENT

SCHEMA = "cmpcheck-sensitivity/1"
MOST_EXPLAINED = 3


def holes(document: dict[str, Any]) -> list[str]:
    """Errors that nothing notices and nobody explains; none where only some cases were asked."""
    if not document["whole"]:
        return []
    return [m["name"] for m in document["mutants"] if not m["detected"] and not m["explained"]]


def explained(document: dict[str, Any]) -> list[dict[str, Any]]:
    """Errors that nothing can notice, with the derivation why."""
    return [m for m in document["mutants"] if not m["detected"] and m["explained"] and document["whole"]]


def passes(document: dict[str, Any]) -> bool:
    """No hole, at most three explained, and false alarms no more often than stated."""
    rate = document["false_alarm_rate"]
    calm = not rate or rate["resolved"]["low"] <= rate["alpha"]
    return not holes(document) and len(explained(document)) <= MOST_EXPLAINED and calm


def text_of(document: dict[str, Any]) -> str:
    """The document as the text of its file."""
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def read(folder: Path) -> dict[str, Any] | None:
    """The document in a folder, None where there is none of this schema."""
    try:
        document = json.loads((folder / DOCUMENT).read_text("utf-8"))
    except (OSError, ValueError):
        return None
    return document if isinstance(document, dict) and document.get("schema") == SCHEMA else None
