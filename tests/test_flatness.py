"""Laws of the rough start and of its cost, in heightfield.py: asperities (Section 4) and flatness (Eq 44)."""

from __future__ import annotations

import numpy as np
import pytest
from rounding import close

from reference.heightfield import asperity_surface, flatness

pytestmark = pytest.mark.nojit


@pytest.mark.parametrize("density", [0.0, 0.025, 0.3])
def test_asperities_are_raised_squares_of_the_asked_number(density):
    n, height = 40, 0.5e-6
    field = asperity_surface(n, 20e-6, height, density, np.random.default_rng(7))
    assert field.z.shape == (n, n)
    close(field.spacing, 0.5e-6)
    assert set(np.unique(field.z)) <= {0.0, height}
    raised = np.count_nonzero(field.z)
    count = round(density * n**2)
    assert raised <= 4 * count
    assert raised >= (4 * count * (1 - 2 * density) if count else 0)  # some squares overlap
    up = field.z > 0
    square = up & np.roll(up, -1, 0) & np.roll(up, -1, 1) & np.roll(up, (-1, -1), (0, 1))
    covered = square | np.roll(square, 1, 0) | np.roll(square, 1, 1) | np.roll(square, (1, 1), (0, 1))
    np.testing.assert_array_equal(up, covered)  # no raised node without its square
    same = asperity_surface(n, 20e-6, height, density, np.random.default_rng(7))
    np.testing.assert_array_equal(same.z, field.z)


@pytest.mark.parametrize("q", [1, 2, 0.5])
def test_flatness_is_one_at_the_start_and_zero_at_the_end(q):
    start = np.random.default_rng(4).uniform(0.0, 0.6, (6, 4))
    assert flatness(start, start, 0.0, q) == 1.0
    assert flatness(np.full_like(start, 0.2), start, 0.2, q) == 0.0
    close(flatness(start / 2, start, 0.0, q), 0.5**q)
    close(flatness(1e-9 * start / 2, 1e-9 * start, 0.0, q), 0.5**q)
    close(flatness(start + 7.0, start + 7.0 - start / 2, 7.0, q), 2.0**q, rtol=1e-9)  # 7 cancels


def test_flatness_in_numbers():
    # |1|, |-2| and |3| now, |2|, |4| and |0| at the start, from the target 1
    now, start = [2.0, -1.0, 4.0], [3.0, 5.0, 1.0]
    close(flatness(now, start, 1.0, 1), 6 / 6)
    close(flatness(now, start, 1.0, 2), 14 / 20)


def test_flatness_of_a_surface_that_starts_flat_is_refused():
    with pytest.raises(ValueError, match="undefined"):
        flatness(np.ones((3, 3)), np.full((3, 3), 0.5), 0.5, 2)
