"""Extremes of physics: the right answer, where a closed form tells it, or one clear error.

`python -m benchmarks.reliability_extremes [--full]` prints the findings; --full adds a million particles.
The closed forms stand here as arithmetic; nothing but the cases is taken from the model.
"""

from __future__ import annotations

import math
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from benchmarks.reliability_finding import Finding
from reference.case import Case, CaseError, load_case
from reference.process import build_setup
from reference.recording import Run
from reference.simulation import simulate, simulate_setup

EPS = float(np.finfo(float).eps)
ALUMINA = {"density": 3950.0, "youngs_modulus": 370e9, "poisson_ratio": 0.22}
COPPER = {"density": 8960.0, "youngs_modulus": 120e9, "poisson_ratio": 0.34, "yield_stress": 0.3e9}
UM, NS = 1e-6, 1e-9


def findings(full: bool = False) -> list[Finding]:
    """One for each extreme."""
    return [extreme() for extreme in EXTREMES] + ([a_million()] if full else [])


def case_of(**sections: Any) -> Case:
    """A case of these sections, and materials, contacts and steps where they do not say them."""
    usual: dict[str, Any] = {
        "case": {"name": "extreme", "title": "", "description": "", "duration": 100 * NS, "outputs": 11},
        "material": {"alumina": ALUMINA, "copper": COPPER},
        "surface": {"kind": "none", "size": 8 * UM},
        "contact": {"restitution": 0.5},
        "numerics": {"time_step": 0.1 * NS},
    }
    with tempfile.TemporaryDirectory() as folder:  # as a user has it, with the errors that a user gets
        path = Path(folder) / "case.toml"
        path.write_text(
            tomli_w.dumps({key: part for key, part in (usual | sections).items() if part}), "utf-8"
        )
        return load_case(path)


def at(
    position: tuple[float, float, float], velocity: tuple[float, float, float], diameter: float = UM
) -> dict:
    """One particle, positions in um and velocities in m/s."""
    return {
        "position": [UM * x for x in position],
        "velocity": list(velocity),
        "diameter": diameter,
        "material": "alumina",
    }


FLAT = {"kind": "flat", "size": 8 * UM, "nodes": 8, "material": "copper"}


def compared(name: str, done: str, measured: Any, expected: Any, scale: float, roundings: float) -> Finding:
    """Whether numbers are those of a closed form, but for `roundings` units in the last place of `scale`."""
    error = float(np.abs(np.asarray(measured) - np.asarray(expected)).max())
    bound = roundings * EPS * scale
    return Finding(
        name,
        done,
        f"as its closed form, to {error / scale:.1e} of {scale:.3g}",
        error <= bound,
        {"error": f"{error:.2e}", "bound": f"{bound:.2e}"},
    )


def refused(name: str, done: str, make: Callable[[], object], words: str) -> Finding:
    """Whether it gives one line that contains these words, within 20 s."""
    begin = time.perf_counter()
    try:
        make()
        said = "no error"
    except CaseError as problem:
        said = str(problem)
    seconds = time.perf_counter() - begin
    line = said.removeprefix(tempfile.gettempdir()).partition("case.toml")[2].lstrip(":") or said
    holds = words in said and "\n" not in said and seconds < 20.0
    return Finding(
        name, done, f"refused: {line}" if words in said else said, holds, {"time": f"{seconds:.1f} s"}
    )


def none() -> Finding:
    return refused(
        "no particle",
        "a case without any, and one with a count of 0",
        lambda: case_of(particles={"count": 0, "mean_diameter": UM, "material": "alumina"}),
        "greater than or equal to 1",
    )


def one() -> Finding:
    """X = x_0 + v t; 1000 steps round a position of 8 um once each."""
    run = simulate(case_of(particle=[at((4, 4, 4), (10.0, -3.0, 1.0))]))
    expected = np.array([4 * UM, 4 * UM, 4 * UM]) + 100 * NS * np.array([10.0, -3.0, 1.0])
    return compared(
        "one particle", "flies alone for 1000 steps", run.positions[-1, 0], expected, 8 * UM, 1000
    )


def _bounced(e: float) -> Run:
    return simulate(
        case_of(particle=[at((4, 4, 0.55), (0, 0, -1.0))], surface=FLAT, contact={"restitution": e})
    )


def restitution_one() -> Finding:
    run = _bounced(1.0)
    return compared("e = 1 at a wall", "the speed after, of 1 m/s", run.velocities[-1, 0, 2], 1.0, 1.0, 8)


def restitution_zero() -> Finding:
    """V' = 0, and it stays where it stopped, less than a step deep."""
    run = _bounced(0.0)
    z = run.positions[-1, 0, 2]
    deep = 0.5 * UM - z
    found = compared("e = 0 at a wall", "the speed after, of 1 m/s", run.velocities[-1, 0, 2], 0.0, 1.0, 8)
    return found._replace(holds=found.holds and 0.0 <= deep <= 0.1 * NS * 1.0 * (1 + 1e-6))


def _pair(e: float, mu: float = 0.0, along: float = 0.0, big: float = UM) -> Run:
    """Two spheres, the first of diameter `big`, that meet along x at 1 m/s, the second `along` y."""
    size, gap = 4.0 * (big / UM), 0.02
    touch = 0.5 * (big / UM) + 0.5
    half = 0.5 * size
    return simulate(
        case_of(
            particle=[
                at((half - touch, half, half), (0.0, 0, 0), big),
                at((half + gap, half, half), (-1.0, along, 0.0)),
            ],
            surface={"kind": "none", "size": size * UM},
            contact={"restitution": e, "static_friction": mu, "dynamic_friction": mu},
            case={"name": "extreme", "title": "", "description": "", "duration": 60 * NS, "outputs": 3},
        )
    )


def pairs_of_both() -> Finding:
    """Equal masses: e = 1 exchanges the velocities, e = 0 halves them."""
    elastic, plastic = (_pair(e).velocities[-1, :, 0] for e in (1.0, 0.0))
    return compared(
        "e = 0 and 1 of a pair",
        "two equal spheres head on at 1 m/s",
        [*elastic, *plastic],
        [-1.0, 0.0, -0.5, -0.5],
        1.0,
        16,
    )


def no_friction() -> Finding:
    """Across the line of centres nothing acts; that line is along x but for the slip during the approach."""
    run = _pair(0.5, 0.0, along=0.5)
    touch = run.contacts.iloc[0]
    slip = np.array([-1.0, 0.5, 0.0])
    n = np.array([touch.nx, touch.ny, touch.nz])
    after = slip - 0.5 * 1.5 * (slip @ n) * n  # m* = m/2
    return compared(
        "mu = 0", "an oblique impact: what is across the normal stays", run.velocities[-1, 1], after, 1.0, 16
    )


def fifty() -> Finding:
    """m_1/m_2 = 50^3: v_1' = -(1+e) m_2/(m_1+m_2), v_2' = -1 + (1+e) m_1/(m_1+m_2)."""
    run, ratio = _pair(0.5, big=50 * UM), 50.0**3
    expected = [-1.5 / (1.0 + ratio), -1.0 + 1.5 * ratio / (1.0 + ratio)]
    return compared(
        "diameters 1 to 50",
        "a small sphere strikes a large one at 1 m/s",
        run.velocities[-1, :, 0],
        expected,
        1.0,
        32,
    )


def _packed(count: int) -> Run:
    box = {"kind": "none", "size": 10 * UM, "height": 10 * UM}
    still = {"velocity_min": [-1.0] * 3, "velocity_max": [1.0] * 3}
    return simulate(
        case_of(particles={"count": count, "mean_diameter": UM, "material": "alumina"} | still, surface=box)
    )


def jammed() -> Finding:
    """A third of the volume: packed without an overlap, and what is conserved stays."""
    count = round(0.34 * 1000.0 / (math.pi / 6.0))
    run = _packed(count)
    offset = run.positions[0][:, np.newaxis] - run.positions[0][np.newaxis]
    apart = np.linalg.norm(offset - 10 * UM * np.round(offset / (10 * UM)), axis=2)
    nearest = float(apart[np.triu_indices(count, 1)].min())
    closed = all(abs(b["residual"]) <= b["bound"] for b in run.provenance["balances"].values())
    return Finding(
        "packing near its limit",
        f"{count} spheres fill 34 % of a box",
        f"the nearest two are {nearest / UM:.6f} diameters apart; {len(run.contacts)} contacts in 100 ns, "
        "every balance closes",
        nearest >= UM * (1 - 4 * EPS) and closed and len(run.contacts) > 0,
    )


def overfull() -> Finding:
    return refused(
        "packing beyond its limit",
        "45 % of a box, by random sequential packing",
        lambda: _packed(round(0.45 * 1000.0 / (math.pi / 6.0))),
        "fewer or smaller particles",
    )


def _polish(**sections: Any) -> Case:
    usual: dict[str, Any] = {
        "particles": {"count": 5, "mean_diameter": UM, "material": "alumina"},
        "surface": {
            "kind": "asperities",
            "size": 8 * UM,
            "nodes": 16,
            "asperity_height": 0.5 * UM,
            "asperity_density": 0.05,
            "material": "copper",
        },
        "fluid": {"density": 1000.0, "viscosity": 1e-3, "flow": "couette"},
        "pad": {"speed": 1.0, "initial_height": 2.6 * UM},
        "removal": {"deposit": "node_depth", "threshold_velocity": 0.05},
        "case": {"name": "extreme", "title": "", "description": "", "duration": 2e-5, "outputs": 5},
        "numerics": {},
    }
    return case_of(**(usual | sections))


def no_room() -> Finding:
    return refused(
        "a pad that leaves no room",
        "a pad at 0.9 um over particles of 1 um",
        lambda: build_setup(_polish(pad={"speed": 1.0, "initial_height": 0.9 * UM})),
        "no room for the particles",
    )


def tall_asperities() -> Finding:
    surface = {
        "kind": "asperities",
        "size": 8 * UM,
        "nodes": 16,
        "asperity_height": 3 * UM,
        "asperity_density": 0.05,
        "material": "copper",
    }
    return refused(
        "asperities taller than the gap",
        "3 um of them under a pad at 2.6 um",
        lambda: build_setup(_polish(surface=surface)),
        "surface.asperity_height",
    )


def worn_through() -> Finding:
    """No height is the lowest, as a wafer is thick: what was removed is missing, and the run says so."""
    removal = {"deposit": "node_depth", "threshold_velocity": 0.05, "acceleration": 2e4}
    run = simulate(_polish(removal=removal))
    assert run.surface is not None
    lowest, closed = float(run.surface.z.min()), run.provenance["balances"]["volume"]
    noted = any("base plane" in note for note in run.provenance["notes"])
    return Finding(
        "a surface worn below its base plane",
        "removal multiplied by 2e4",
        f"the lowest node ends at {lowest / UM:.3g} um; the volume balance closes, and a note says it",
        lowest < -0.5 * UM
        and abs(closed["residual"]) <= closed["bound"]
        and noted
        and bool(np.isfinite(run.velocities).all()),
    )


def _struck(density: float) -> tuple[Run, float]:
    soft = COPPER | {"yield_stress": 1e3, "density": density}
    run = simulate(
        case_of(
            particle=[at((4.3, 4.2, 0.55), (0, 0, -1.0))],
            surface=FLAT,
            removal={"deposit": "volume", "threshold_velocity": 0.01},
            material={"alumina": ALUMINA, "copper": soft},
        )
    )
    return run, density / (
        2.0 * ALUMINA["density"]
    )  # mass of half a sphere of the surface over the particle's


def hemisphere() -> Finding:
    """x_p is limited to R: depth R, volume 2 pi R^3/3."""
    run, _ = _struck(8960.0)
    touch, R = run.contacts.iloc[0], 0.5 * UM
    return compared(
        "x_p beyond R",
        "a surface that yields at 1 kPa: x_p, depth and volume of half a sphere",
        [touch.yield_radius / R, touch.depth / R, touch.removed_volume / (2.0 * math.pi * R**3 / 3.0)],
        1.0,
        1.0,
        32,
    )


def heavier() -> Finding:
    """(m + dm) v' = -e m v."""
    run, gained = _struck(10.0 * ALUMINA["density"])
    return compared(
        "dm beyond m",
        "an impact that picks up five times the mass of the particle",
        run.velocities[-1, 0, 2],
        0.5 / (1.0 + gained),
        1.0,
        32,
    )


def at_rest() -> Finding:
    """Nothing pushes: not a bit changes, in vacuum and in a fluid at rest, on the surface too."""
    fluid = {"density": 1000.0, "viscosity": 1e-3, "flow": "uniform", "velocity": [0.0, 0.0, 0.0]}
    particles = [at((4, 4, 0.5), (0, 0, 0)), at((2, 2, 3), (0, 0, 0))]
    runs = [simulate(case_of(particle=particles, surface=FLAT, **more)) for more in ({}, {"fluid": fluid})]
    same = all((run.positions == run.positions[0]).all() and (run.velocities == 0.0).all() for run in runs)
    return Finding(
        "zero velocity",
        "two particles at rest, one on the surface, in vacuum and in a fluid at rest",
        "not a bit changes in 1000 steps" if same else "they move",
        same,
    )


def no_pad_speed() -> Finding:
    return refused(
        "V_pad = 0",
        "a pad that stands still",
        lambda: _polish(pad={"speed": 0.0, "initial_height": 2.6 * UM}),
        "a speed > 0",
    )


def a_million() -> Finding:
    """A few steps of a million particles in a box; every balance closes."""
    begin = time.perf_counter()
    box = {"kind": "none", "size": 200 * UM, "height": 200 * UM}
    moving = {"velocity_min": [-1.0] * 3, "velocity_max": [1.0] * 3}
    case = case_of(
        particles={"count": 1_000_000, "mean_diameter": UM, "material": "alumina"} | moving,
        surface=box,
        case={"name": "extreme", "title": "", "description": "", "duration": 20 * NS, "outputs": 2},
        numerics={"time_step": 5 * NS},
    )
    setup = build_setup(case)
    packed = time.perf_counter() - begin
    run = simulate_setup(setup)
    closed = all(abs(b["residual"]) <= b["bound"] for b in run.provenance["balances"].values())
    return Finding(
        "a million particles",
        f"{run.provenance['steps']} steps in a periodic box, 6.5 % filled",
        f"{len(run.contacts):,} contacts, every balance closes",
        closed and len(run.contacts) > 0,
        {
            "set up in": f"{packed:.0f} s",
            "all": f"{time.perf_counter() - begin:.0f} s",
            "peak memory": f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.1f} GB",
        },
    )


EXTREMES = (
    none,
    one,
    restitution_one,
    restitution_zero,
    pairs_of_both,
    no_friction,
    fifty,
    jammed,
    overfull,
    no_room,
    tall_asperities,
    worn_through,
    hemisphere,
    heavier,
    at_rest,
    no_pad_speed,
)


def main() -> None:
    for finding in findings(full="--full" in sys.argv[1:]):
        print(finding.line(), flush=True)


if __name__ == "__main__":
    main()
