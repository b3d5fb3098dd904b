"""A scene in LAMMPS, in the child process: the deck's definitions, the spheres, the steps."""

from __future__ import annotations

import numpy as np

from cmpcheck.engines.lammps import ask_child
from cmpcheck.engines.lammps_library import EngineError, per_atom
from cmpcheck.engines.lammps_run import opened
from cmpcheck.engines.lammps_setup import Deck, execute
from cmpcheck.published.scene import TIMEOUT, After, Scene, separation


def run_lammps(deck: Deck, scene: Scene) -> After:
    """Simulate a scene.  Raises EngineError, with LAMMPS's own words, when that fails."""
    after: After = ask_child(simulate, deck, scene, timeout=TIMEOUT)
    return after


def simulate(deck: Deck, scene: Scene) -> After:
    """Run a scene in this process."""
    with opened(deck, scene.variables) as lmp:
        execute(lmp, deck.definitions(), deck.path)
        return _simulate(lmp, scene)


def _simulate(lmp, scene: Scene) -> After:  # type: ignore[no-untyped-def]
    n = len(scene.position)
    lmp.create_atoms(
        n, list(range(1, n + 1)), [1] * n, scene.position.ravel().tolist(), scene.velocity.ravel().tolist()
    )
    if lmp.get_natoms() != n:
        raise EngineError(f"LAMMPS has created {int(lmp.get_natoms())} of {n} particles")

    def order() -> np.ndarray:
        return np.array(lmp.numpy.extract_atom("id", nelem=n), dtype=np.int64).reshape(-1) - 1

    def sorted_by_tag(name: str) -> np.ndarray:
        out = np.empty((n, 3))
        out[order()] = per_atom(lmp, name, n, 3)
        return out

    index = order()
    per_atom(lmp, "radius", n, 1)[:] = scene.radius
    per_atom(lmp, "rmass", n, 1)[:] = scene.mass
    per_atom(lmp, "omega", n, 3)[:] = scene.spin[index]
    deepest, force = np.full(n, np.nan), np.full(n, np.nan)
    lmp.command("thermo 0")
    lmp.command("run 0 post no")
    if scene.watched:
        deepest[:], force[:] = 0.0, 0.0
        for _ in range(scene.steps):
            lmp.command("run 1 pre no post no")
            np.maximum(deepest, -separation(scene, sorted_by_tag("x")), out=deepest)
            np.maximum(force, np.linalg.norm(sorted_by_tag("f"), axis=1), out=force)
    else:
        lmp.command(f"run {scene.steps} pre no post no")
    return After(sorted_by_tag("x"), sorted_by_tag("v"), sorted_by_tag("omega"), deepest, force)
