"""A scene in LIGGGHTS, in the child process: an error of LIGGGHTS ends it (`engines/child.py`)."""

from __future__ import annotations

import numpy as np

from cmpcheck.engines.lammps_library import EngineError
from cmpcheck.engines.lammps_setup import Deck, input_flags
from cmpcheck.engines.liggghts import ask_child
from cmpcheck.engines.liggghts_library import Liggghts, opened
from cmpcheck.published.scene import TIMEOUT, After, Scene, separation


def run_liggghts(deck: Deck, scene: Scene) -> After:
    """Simulate a scene.  Raises EngineError, with LIGGGHTS's own words, when that fails."""
    try:
        after: After = ask_child(simulate, deck, scene, timeout=TIMEOUT)
    except EngineError as error:
        raise EngineError(f"{deck.path}: {error}") from None
    return after


def simulate(deck: Deck, scene: Scene) -> After:
    """Run a scene in this process, whose working directory gets files."""
    with opened(deck.definitions(), input_flags({"driver": "1", **scene.variables})) as liggghts:
        return _simulate(liggghts, scene)


def _simulate(liggghts: Liggghts, scene: Scene) -> After:
    n = len(scene.position)
    for x, y, z in scene.position.tolist():
        liggghts.command(f"create_atoms 1 single {x!r} {y!r} {z!r} units box")
    if len(liggghts.tags()) != n:
        raise ValueError(f"LIGGGHTS has created {len(liggghts.tags())} of {n} particles")
    index = liggghts.tags() - 1
    liggghts.scalars(b"radius")[:] = scene.radius
    liggghts.scalars(b"rmass")[:] = scene.mass
    liggghts.scalars(b"density")[:] = scene.variables["density"]
    liggghts.vectors(b"x")[:] = scene.position[index]
    liggghts.vectors(b"v")[:] = scene.velocity[index]
    liggghts.vectors(b"omega")[:] = scene.spin[index]

    def sorted_by_tag(name: bytes) -> np.ndarray:
        tags = liggghts.tags()
        if len(tags) != n:
            raise ValueError(f"LIGGGHTS has lost {n - len(tags)} of {n} particles")
        out = np.empty((n, 3))
        out[tags - 1] = liggghts.vectors(name)
        return out

    deepest, force = np.full(n, np.nan), np.full(n, np.nan)
    liggghts.command("run 0 post no")
    if scene.watched:
        deepest[:], force[:] = 0.0, 0.0
        for _ in range(scene.steps):
            liggghts.command("run 1 pre no post no")
            np.maximum(deepest, -separation(scene, sorted_by_tag(b"x")), out=deepest)
            np.maximum(force, np.linalg.norm(sorted_by_tag(b"f"), axis=1), out=force)
    else:
        liggghts.command(f"run {scene.steps} pre no post no")
    return After(sorted_by_tag(b"x"), sorted_by_tag(b"v"), sorted_by_tag(b"omega"), deepest, force)
