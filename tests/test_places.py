"""Laws of the table of places: the number of springs follows from the restitution, whoever made it so."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmpcheck.places import contact_places, place_of, springs_at_once
from cmpcheck.results import Comparison, Estimate


def rebound(springs: int, damping: float) -> float:
    """Restitution of an impact on so many springs and dashpots side by side, by integrating the motion.

    x'' = -N (w^2 x + 2 z w x') with w = 1 until the force vanishes, in small steps of Verlet.
    """
    x, v, dt = 0.0, 1.0, 1e-4
    while True:
        force = -springs * (x + 2.0 * damping * v)
        half = v + 0.5 * dt * force
        x += dt * half
        force = -springs * (x + 2.0 * damping * half)
        v = half + 0.5 * dt * force
        if x + 2.0 * damping * v <= 0.0:
            return -v


def row(variant, quantity, reference, measured, status, engine="liggghts"):
    error, nan = abs(measured - reference), math.nan
    return Comparison(
        "asperity_bounce", variant, engine, quantity, "28", "1", reference, measured, error,
        0.001 if status != "error" else nan, "discretisation", "", status,
    )  # fmt: skip


@pytest.mark.parametrize("springs", [1, 2, 3, 4])
@pytest.mark.parametrize("damping", [0.05, 0.1, 0.2])
def test_springs_side_by_side_are_counted(springs, damping):
    asked, measured = rebound(1, damping), rebound(springs, damping)
    found = springs_at_once(asked, measured, 0.0)
    assert found is not None
    # Verlet and the step in which the force ends change e by some dt = 1e-4; d ln N/d ln e < 6 here
    assert found.value == pytest.approx(springs, rel=5e-3, abs=0)


@given(st.floats(0.1, 0.95), st.floats(0.05, 0.99))
def test_less_returned_is_more_springs(asked, share):
    found = springs_at_once(asked, share * asked, 0.0)
    assert found is not None
    assert found.value > 1.0


@pytest.mark.parametrize("asked, measured", [(1.0, 0.9), (0.0, 0.1), (0.5, 0.0), (0.5, 1.0)])
def test_nothing_is_counted_where_damping_does_not_tell(asked, measured):
    assert springs_at_once(asked, measured, 0.0) is None


def test_the_table_says_where_an_engine_departs_and_what_would_explain_it():
    rows = [
        row("plateau, soft", "restitution", 0.8, 0.8002, "agree"),
        row("plateau, soft", "normal_impulse", 1.8, 1.8002, "agree"),
        row("on_edge, soft", "restitution", 0.8, 0.7335, "disagree"),
        row("on_edge, soft", "normal_impulse", 1.8, 1.7335, "disagree"),
        row("valley, soft, impact 1", "normal_impulse", 1.0, 1.001, "agree"),
        row("valley, soft, impact 2", "normal_impulse", 1.0, 0.998, "agree"),
        row("on_edge", "restitution", 0.8, 0.8, "agree", engine="reference"),
    ]
    (table,) = contact_places(rows)
    places = {line[0]: line for line in table.rows}
    assert list(places) == ["plateau, soft", "on_edge, soft", "valley, soft"]
    *_, error, counted, verdict = places["on_edge, soft"]
    assert error == pytest.approx(100 * (1.7335 / 1.8 - 1))
    assert isinstance(counted, Estimate)
    assert round(counted.value) == 2
    assert verdict == "disagree"
    assert places["plateau, soft"][-1] == "agree"
    assert places["valley, soft"][4] == pytest.approx(-0.2)
    assert "liggghts returns 0.734 instead of 0.8 at on_edge, soft, as 2 equal springs" in table.caption
    assert "plateau" not in table.caption


def test_no_table_where_nothing_departs_or_there_is_one_place():
    agree = [row(name, "restitution", 0.8, 0.8, "agree") for name in ("plateau, soft", "edge, soft")]
    assert contact_places(agree) == []
    assert contact_places([row("e0.5", "restitution", 0.5, 0.4, "disagree")]) == []


def test_a_place_is_the_variant_without_particle_and_impact():
    found = place_of(row("valley, soft, impact 2", "normal_impulse", 1.0, 1.0, "agree"))
    assert found == "valley, soft"
