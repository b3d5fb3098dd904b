"""Laws at the extremes: the right answer, or one clear error; what they are stands in the benchmark."""

from __future__ import annotations

import pytest

from benchmarks import reliability_extremes as extremes


@pytest.mark.parametrize("extreme", extremes.EXTREMES, ids=lambda extreme: extreme.__name__)
def test_an_extreme_is_right_or_refused_in_one_line(extreme):
    found = extreme()
    assert found.holds, found.line()


def test_a_wrong_answer_and_a_missing_error_are_seen():
    """The twin of the test above."""
    assert extremes.compared("", "", 1.0 + 1e-15, 1.0, 1.0, 8).holds
    assert not extremes.compared("", "", 1.0 + 1e-14, 1.0, 1.0, 8).holds
    assert not extremes.compared("", "", float("nan"), 1.0, 1.0, 8).holds
    assert not extremes.refused("", "", lambda: None, "no room").holds
