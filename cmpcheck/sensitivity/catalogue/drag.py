"""Errors in the drag and in the flow: Eqs 20-22."""

from __future__ import annotations

from cmpcheck.sensitivity.mutants import Mutant

DRAG, SCHEMES = "reference/drag.py", "reference/schemes.py"

MUTANTS = (
    Mutant(
        "Stokes's drag", "3 pi mu d is off by a factor",
        f"{DRAG}:drag_factor",
        "return 3.0 * math.pi * viscosity * diameter",
        "return (1.0 + SIZE) * 3.0 * math.pi * viscosity * diameter",
        0.01, "%",
    ),
    Mutant(
        "radius in Stokes's drag", "the radius stands for the diameter",
        f"{DRAG}:drag_factor",
        "return 3.0 * math.pi * viscosity * diameter", "return 3.0 * math.pi * viscosity * 0.5 * diameter",
    ),
    Mutant(
        "area of a sphere", "the area in Eq 20 is off by a factor",
        f"{DRAG}:drag_factor",
        "area = math.pi * diameter * diameter / 4.0",
        "area = (1.0 + SIZE) * math.pi * diameter * diameter / 4.0",
        0.01, "%",
    ),
    Mutant(
        "exponent 0.646", "the exponent of the second regime of Eq 21 is off",
        f"{DRAG}:_drag_coefficient",
        "24.0 / reynolds**0.646", "24.0 / reynolds ** (0.646 + SIZE)",
        0.001, "of the exponent", factor=1.0,
    ),
    Mutant(
        "C_D = 0.5", "the third regime of Eq 21 is off by a factor",
        f"{DRAG}:_drag_coefficient",
        "return 0.5\n", "return 0.5 * (1.0 + SIZE)\n",
        0.01, "%",
    ),
    Mutant(
        "exponent 0.4275", "the exponent of the fourth regime of Eq 21 is off",
        f"{DRAG}:_drag_coefficient",
        "reynolds**0.4275", "reynolds ** (0.4275 + SIZE)",
        0.001, "of the exponent", factor=1.0,
    ),
    Mutant(
        "C_D = 0.18", "the last regime of Eq 21 is off by a factor",
        f"{DRAG}:_drag_coefficient",
        "return 0.18\n", "return 0.18 * (1.0 + SIZE)\n",
        0.01, "%",
    ),
    Mutant(
        "boundary at Re = 400", "the third regime begins elsewhere",
        f"{DRAG}:_drag_coefficient",
        "if reynolds <= 400.0:", "if reynolds <= 400.0 * (1.0 + SIZE):",
        0.05, "%",
    ),
    Mutant(
        "shear rate", "the slope V/H of the flow is off by a factor",
        f"{DRAG}:fluid_velocity",
        "return model.wall_speed * z / gap, 0.0, 0.0",
        "return (1.0 + SIZE) * model.wall_speed * z / gap, 0.0, 0.0",
        0.01, "%",
    ),
    Mutant(
        "flow under the pad", "the flow under the pad keeps the gap of a flow without one",
        f"{DRAG}:fluid_velocity",
        "gap = pad_height if model.has_pad else model.gap", "gap = model.gap",
    ),
    Mutant(
        "drag off the centre", "the flow is taken above the centre of the particle",
        f"{SCHEMES}:drag_of",
        "ux, uy, uz = fluid_velocity(model, pad_height, z)",
        "ux, uy, uz = fluid_velocity(model, pad_height, z + SIZE * diameter)",
        0.05, "% of a diameter",
    ),
    Mutant(
        "uniform flow along y", "the flow has no component along y",
        f"{DRAG}:fluid_velocity",
        "return model.flow_x, model.flow_y, model.flow_z", "return model.flow_x, 0.0, model.flow_z",
    ),
)  # fmt: skip
