"""Cost per particle of listing neighbors and of a whole step, at constant density: is it linear in N?

`python -m benchmarks.neighbors` prints tables of ratios to N = 1000 and writes them to `scaling.md` here.
Two shapes: a cube, periodic in all directions, and a layer one particle deep, as between pad and wafer.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from reference.ledger import empty_ledger
from reference.neighbors import neighbor_pairs
from reference.schemes import Numerics
from reference.state import DEPOSIT_NONE, FLOW_UNIFORM, Model, Particles
from reference.timestep import DONE, advance, new_progress

D, DENSITY, VISCOSITY, SPACING = 9e-7, 3950.0, 1e-3, 1.35e-6  # 15 % of the cube's volume is solid
SIZES, BASE = (100, 1_000, 10_000, 100_000), 1_000
SHAPES = {"cube": 3, "layer": 2}
STEPS, STEP = 10, 1e-9
OUTPUT = Path(__file__).with_name("scaling.md")


def lattice(n: int, dimensions: int) -> tuple[np.ndarray, np.ndarray]:
    """About n particles on a shaken square or cubic lattice, and the periods."""
    side = round(n ** (1 / dimensions))
    axes = [np.arange(side)] * dimensions + [np.zeros(1)] * (3 - dimensions)
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    shake = np.random.default_rng(0).uniform(0.0, 0.3, places.shape)
    periods = np.where(np.arange(3) < dimensions, side * SPACING, 0.0)
    return (places + shake) * SPACING, periods


def seconds(task: Callable[[], object]) -> float:
    """Shortest time of a task, repeated for half a second at least, after a first call that compiles."""
    task()
    times: list[float] = []
    while len(times) < 5 or sum(times) < 0.5:
        start = time.process_time()
        task()
        times.append(time.process_time() - start)
    return min(times)


def steps_of(position: np.ndarray, periods: np.ndarray, pairs: int) -> Callable[[], None]:
    """STEPS whole steps with drag and pair contacts, and one listing of neighbors."""
    n = len(position)
    fields: dict = dict.fromkeys(Model._fields, 0.0)
    fields |= dict(zip(("length_x", "length_y", "length_z"), map(float, periods), strict=True))
    fields |= {"restitution": 0.5, "static_friction": 0.3, "dynamic_friction": 0.3}
    fields |= {"flow": FLOW_UNIFORM, "fluid_density": 1000.0, "viscosity": VISCOSITY, "deposit": DEPOSIT_NONE}
    fields |= {"has_surface": False, "mass_pickup": False, "has_pad": False, "has_pairs": True}
    model, numerics = Model(**fields), Numerics(STEP, False, 1e-6, 8, False, False, 0.0)
    velocity = np.random.default_rng(1).uniform(-1.0, 1.0, (n, 3))
    mass, diameter = np.full(n, DENSITY * math.pi / 6 * D**3), np.full(n, D)
    modulus, rows = np.full(n, 3.89e11), empty_ledger(STEPS * n + pairs + 2 * n)

    def task() -> None:
        scalars, particles = (
            new_progress(),
            Particles(position.copy(), velocity.copy(), mass, diameter, modulus),
        )
        status = advance(model, numerics, scalars, STEPS * STEP, STEPS, particles, np.zeros((0, 0)), rows)
        assert status == DONE

    return task


def measure(shape: str) -> list[tuple[int, float, float, float]]:
    """For each size: N, pairs per particle, and nanoseconds per particle of a listing and of a step."""
    results = []
    for size in SIZES:
        position, periods = lattice(size, SHAPES[shape])
        pairs = len(neighbor_pairs(position, 1.5 * D, periods))
        n = len(position)
        listing = seconds(lambda p=position, q=periods: neighbor_pairs(p, 1.5 * D, q))  # type: ignore[misc]
        stepping = seconds(steps_of(position, periods, pairs)) / STEPS
        results.append((n, pairs / n, 1e9 * listing / n, 1e9 * stepping / n))
    return results


def table(shape: str) -> str:
    """The measurements of one shape as a Markdown table of ratios."""
    results = measure(shape)
    _, _, listing, stepping = results[SIZES.index(BASE)]
    lines = [
        f"## {shape.capitalize()}",
        "",
        "| N | pairs per particle | list neighbors, per particle | whole step, per particle |",
        "|---:|---:|---:|---:|",
        *(f"| {n} | {k:.2f} | {a / listing:.2f} | {b / stepping:.2f} |" for n, k, a, b in results),
    ]
    return "\n".join(lines)


def main() -> None:
    text = [
        "# Cost per particle over the number of particles",
        "",
        f"Ratios to N = {BASE}, at constant density: 1 in every row is a cost linear in N. Written by",
        "`python -m benchmarks.neighbors`. A step contains drag, pair contacts and its share of one listing",
        f"of neighbors every {STEPS} steps.",
        "",
        "\n\n".join(table(shape) for shape in SHAPES),
        "",
    ]
    OUTPUT.write_text("\n".join(text), "utf-8")
    print(OUTPUT.read_text("utf-8"))


if __name__ == "__main__":
    main()
