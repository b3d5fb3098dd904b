"""The observed order of every quantity that has something to converge, from at least three levels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cmpcheck.compare import FORMAL_ORDER, convergences, limits
from cmpcheck.components.methods import NASA_INDEX, NASA_LIMIT, NASA_ORDER, nasa_example
from cmpcheck.convergence import credible_orders
from cmpcheck.sensitivity.checks import COMPONENTS, Baseline, Label, case_of
from cmpcheck.sensitivity.store import Store

KIND, NAME = "orders", "observed"


def keep(store: Store, folder: Path, labels: Sequence[Label]) -> None:
    """Collect the orders from the runs without errors."""
    if store.get(KIND, NAME) is not None:
        return
    rows = []
    for label in labels:
        if label[0] == COMPONENTS:
            continue
        for engine, form in (
            ("reference", ""),
            ("lammps", "native"),
            ("lammps", "soft"),
            ("lammps", "impulse"),
        ):
            kept = Baseline(folder).study(label, engine, form)
            if kept is not None:
                rows += _of_study(case_of(label), kept[0])
    order, limit, index = nasa_example()
    nasa = {
        "order": order, "order_published": NASA_ORDER, "limit": limit, "limit_published": NASA_LIMIT,
        "index": index, "index_published": NASA_INDEX,
    }  # fmt: skip
    store.put(KIND, NAME, {"formal": FORMAL_ORDER, "groups": _grouped(rows), "nasa": nasa})


def _of_study(case: Any, study: Any) -> list[dict[str, Any]]:
    """One entry a quantity: its order, where there is one, and the index relative to its value."""
    low, high = credible_orders(FORMAL_ORDER)
    rows = []
    for record in convergences(case, study, limits(study)):
        size = max(abs(record.extrapolated), *(abs(v) for v in record.values))
        rows.append({
            "engine": record.engine, "parameter": record.parameter, "case": record.case,
            "levels": len(record.levels), "order": record.order,
            "credible": record.order is not None and low <= record.order <= high,
            "index": record.uncertainty / size if size > 0.0 else math.nan,
        })  # fmt: skip
    return rows


def _grouped(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """For each engine, case and refined parameter: how many orders are credible, their median and range."""
    groups: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["engine"], row["case"], row["parameter"]), []).append(row)
    found = []
    for (engine, case, parameter), own in sorted(
        groups.items(), key=lambda entry: (entry[0][1], entry[0][0] != "reference")
    ):
        orders = [row["order"] for row in own if row["credible"]]
        found.append({
            "case": case, "engine": engine, "parameter": parameter, "quantities": len(own),
            "levels": min(row["levels"] for row in own), "credible": len(orders),
            "median": float(np.median(orders)) if orders else None,
            "lowest": min(orders, default=None), "highest": max(orders, default=None),
            "largest_index": max((row["index"] for row in own if math.isfinite(row["index"])), default=None),
        })  # fmt: skip
    return found
