"""What the fix remembers of the surface around a particle against a search of the whole surface."""

import numpy as np
import pytest

from cmpcheck.fixes.near import contact_nearby, empty_near, is_near, remember
from reference.compiled import kernel
from reference.heightfield import surface_contact

SPACING, RADIUS = 0.5e-6, 0.45e-6
NODES, PLACES, MOVES = 9, 60, 20


@kernel
def looked_up(near, k, x, y, height, radius):
    """`contact_nearby`, which is part of a loop elsewhere."""
    return contact_nearby(near, k, x, y, height, radius)


@kernel
def known(near, k, falls, x, y, height):
    """`is_near`, likewise."""
    return is_near(near, k, falls, x, y, height)


@pytest.mark.nojit
@pytest.mark.parametrize("roughness", [0.0, 0.1e-6, 0.4e-6])
def test_remembered_squares_hold_the_contact_of_every_place_on_the_way(roughness):
    rng = np.random.default_rng(3)
    z = rng.uniform(0.0, roughness, (NODES, NODES))
    near, way, tried = empty_near(1), 0.02 * RADIUS, 0
    for _ in range(PLACES):
        place = np.array([*rng.uniform(-SPACING, NODES * SPACING, 2), rng.uniform(0.8, 1.2) * RADIUS])
        found, overlap, *_ = surface_contact(z, SPACING, *place, 1.25 * RADIUS)
        if not found:
            continue
        remember(near, 0, 7, z, SPACING, *place, 1.25 * RADIUS - overlap, way)
        for _ in range(MOVES if near.place[0, 3] > 0.0 else 0):
            step = rng.normal(size=3)
            there = place + 0.999 * way * step / np.linalg.norm(step)
            assert known(near, 0, 7, *there)
            assert looked_up(near, 0, *there, RADIUS) == surface_contact(z, SPACING, *there, RADIUS)[:-1]
            tried += 1
    assert tried > PLACES * MOVES / 4


def test_nothing_is_known_after_a_longer_way_or_a_fall_of_the_surface():
    z, near = np.zeros((NODES, NODES)), empty_near(2)
    place, way = (1e-6, 1e-6, RADIUS), 1e-9
    assert not known(near, 0, 0, *place)
    remember(near, 0, 7, z, SPACING, *place, RADIUS, way)
    assert known(near, 0, 7, *place)
    assert not known(near, 0, 8, *place)
    assert not known(near, 0, 7, place[0] + 1.01 * way, *place[1:])
    assert not known(near, 1, 7, *place)
    remember(near, 0, 7, z, SPACING, *place, 1.9 * way, way)  # might get to the other side
    assert not known(near, 0, 7, *place)
