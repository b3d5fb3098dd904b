"""sensitivity.json from what a run has kept; no formatting for people.  Reading it is `document.py`."""

from __future__ import annotations

from typing import Any

from cmpcheck.sensitivity import false_alarms, orders, power
from cmpcheck.sensitivity.checks import COMPONENTS
from cmpcheck.sensitivity.document import SCHEMA
from cmpcheck.sensitivity.mutants import Mutant
from cmpcheck.sensitivity.run import SEEDED, SMALLEST, TESTS, Plan
from cmpcheck.sensitivity.store import Store


def build(plan: Plan, store: Store) -> dict[str, Any]:
    """The document of a finished run; equal findings give equal documents."""
    mutants = [_entry(plan.mutants[k], store, plan.profile) for k in plan.tasks()]
    checks: dict[str, list[str]] = {}
    for entry in mutants:
        for check in entry["by"]:
            checks.setdefault(check, []).append(entry["name"])
    labels = [" ".join(label).strip() for label in plan.labels]
    return {
        "schema": SCHEMA,
        "profile": plan.profile,
        "run": labels,
        "whole": COMPONENTS in labels,  # else some cases only, which cannot notice everything
        "mutants": mutants,
        "checks": [{"name": name, "notices": notices} for name, notices in sorted(checks.items())],
        "false_alarm_rate": store.get(false_alarms.KIND, plan.profile) or {},
        "power": power.kept(store),
        "orders": store.get(orders.KIND, orders.NAME) or {},
        "tests": _tests(mutants),
    }


def _entry(mutant: Mutant, store: Store, profile: str) -> dict[str, Any]:
    found = store.get(SEEDED, mutant.name)
    least = store.get(SMALLEST, mutant.name) if profile == "full" and mutant.continuous else None
    by = found["by"] or (least["by"] if least else [])  # a larger size, where its own was too small
    entry: dict[str, Any] = {
        "name": mutant.name,
        "breaks": mutant.breaks,
        "where": mutant.where,
        "side": mutant.side,
        "size": mutant.factor * mutant.size if mutant.continuous else None,
        "unit": mutant.unit,
        "detected": bool(by),
        "by": by,
        "smallest_detected": None,
        "largest_not_detected": None,
        "explained": "" if by else mutant.explained,
        "tests": store.get(TESTS, mutant.name) if profile == "full" else None,
    }
    if least:
        for key, name in (("size", "smallest_detected"), ("not_noticed", "largest_not_detected")):
            entry[name] = None if least[key] is None else mutant.factor * least[key]
        entry["by_smallest"] = least["by"]
    return entry


def _tests(mutants: list[dict[str, Any]]) -> dict[str, Any]:
    asked = [entry for entry in mutants if entry["tests"] is not None]
    if not asked:
        return {}
    survivors = [entry["name"] for entry in asked if not entry["tests"]]
    return {"asked": len(asked), "killed": len(asked) - len(survivors), "survivors": survivors}
