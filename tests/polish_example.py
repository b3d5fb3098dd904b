"""The paper's example made small: what the tests of exports and figures run, in a fraction of a second."""

from __future__ import annotations

from typing import Any

from cmpcheck.figures import EXAMPLE
from reference.case import Case, load_case

SMALL: dict[str, dict[str, Any]] = {
    "case": {"duration": 20e-6, "outputs": 6, "seed": 3},
    "particles": {"count": 12},
    "surface": {"size": 8e-6, "nodes": 16, "asperity_density": 0.05},
    "pad": {"initial_height": 1.6e-6},
    "removal": {"acceleration": 100.0},
}


def small_polish(**sections: dict[str, Any]) -> Case:
    """Some 2000 steps of 12 particles on 8 um x 8 um; keys of single sections replaced."""
    raw = load_case(EXAMPLE).model_dump(by_alias=True, exclude_none=True)
    for changes in (SMALL, sections):
        for name, keys in changes.items():
            raw[name] = raw[name] | keys
    return Case.model_validate({name: part for name, part in raw.items() if part})
