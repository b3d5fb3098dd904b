"""Errors in the triangulated surface: where it is touched, along which normal, and which nodes fall."""

from __future__ import annotations

from cmpcheck.sensitivity.mutants import Mutant

FIELD, TRIANGLE = "reference/heightfield.py", "reference/triangle.py"
ON_ASPERITIES = ("asperity_bounce node_depth", "asperity_bounce edge", "asperity_bounce flank")

MUTANTS = (
    Mutant(
        "surface shifted", "the surface is taken at another place along x",
        f"{FIELD}:_locate",
        "u, w = x / spacing, y / spacing", "u, w = x / spacing + SIZE, y / spacing",
        0.05, "% of a node spacing",
    ),
    Mutant(
        "other diagonal", "squares are cut along the other diagonal",
        f"{FIELD}:_triangle_nodes",
        "    if a >= b:\n        return (i, j, 1.0 - a), (i1, j, a - b), (i1, j1, b)\n"
        "    return (i, j, 1.0 - b), (i1, j1, a), (i, j1, b - a)",
        "    if a + b <= 1.0:\n        return (i, j, 1.0 - a - b), (i1, j, a), (i, j1, b)\n"
        "    return (i1, j1, a + b - 1.0), (i1, j, 1.0 - b), (i, j1, 1.0 - a)",
    ),
    Mutant(
        "normal flipped", "the normal of every second triangle points into the solid",
        f"{FIELD}:surface_contact",
        "    n_x, n_y, n_z = (px - qx) / distance",
        "    distance = distance * (1.0 - 2.0 * (triangle % 2))\n    n_x, n_y, n_z = (px - qx) / distance",
    ),
    Mutant(
        "normal turned", "the normal leans along x",
        f"{FIELD}:surface_contact",
        "return True, radius - distance, n_x, n_y, n_z, qx, qy, qz, triangle",
        "return True, radius - distance, n_x + SIZE * n_z, n_y, n_z - SIZE * n_x, qx, qy, qz, triangle",
        0.001, "mrad", factor=1e3,
    ),
    Mutant(
        "squares to the left", "the surface is not searched to the left of a particle's centre",
        f"{FIELD}:closest_point",
        "for i in range(math.floor((px - radius) / spacing), math.floor((px + radius) / spacing) + 1):",
        "for i in range(math.floor(px / spacing), math.floor((px + radius) / spacing) + 1):",
    ),
    Mutant(
        "weights of a face", "the closest point of a face has the weights of two corners swapped",
        f"{TRIANGLE}:closest_point_on_triangle",
        "v, w = weight_b / total, weight_c / total", "v, w = weight_c / total, weight_b / total",
    ),
    Mutant(
        "overlap", "the surface is felt before it is touched",
        f"{FIELD}:surface_contact",
        "return True, radius - distance, n_x, n_y, n_z, qx, qy, qz, triangle",
        "return True, radius - distance + SIZE * radius, n_x, n_y, n_z, qx, qy, qz, triangle",
        0.01, "% of a radius",
    ),
    Mutant(
        "wrong node", "a depth is taken off the node below and left of the nearest",
        f"{FIELD}:lower_node",
        "math.floor(x / spacing + 0.5), math.floor(y / spacing + 0.5)",
        "math.floor(x / spacing), math.floor(y / spacing)",
    ),
    Mutant(
        "equal shares", "a volume is shared equally by the three nodes of a triangle",
        f"{FIELD}:remove_volume",
        "z[i_node, j_node] -= weight * fall", "z[i_node, j_node] -= fall / 3.0",
    ),
    Mutant(
        "removed volume", "the volume taken off the surface is off by a factor",
        f"{FIELD}:remove_volume",
        "fall = volume / (spacing * spacing)", "fall = (1.0 + SIZE) * volume / (spacing * spacing)",
        0.01, "%",
    ),
    Mutant(
        "Pi with q + 1", "the exponent of Eq 44 is off",
        f"{FIELD}:flatness",
        "return float(((now / scale) ** exponent).sum()",
        "return float(((now / scale) ** (exponent + SIZE)).sum()",
        1.0, "of the exponent", factor=1.0,
    ),
    Mutant(
        "wrong node, in LAMMPS", "a depth is taken off the wrong node on LAMMPS's side only",
        f"{FIELD}:lower_node",
        "math.floor(x / spacing + 0.5), math.floor(y / spacing + 0.5)",
        "math.floor(x / spacing), math.floor(y / spacing)",
        side="lammps", cases=ON_ASPERITIES,
    ),
    Mutant(
        "wrong node, in both", "a depth is taken off the wrong node in both engines, which share it",
        f"{FIELD}:lower_node",
        "math.floor(x / spacing + 0.5), math.floor(y / spacing + 0.5)",
        "math.floor(x / spacing), math.floor(y / spacing)",
        side="both", cases=ON_ASPERITIES,
    ),
    Mutant(
        "normal turned, in LAMMPS", "the normal leans along x on LAMMPS's side only",
        f"{FIELD}:surface_contact",
        "return True, radius - distance, n_x, n_y, n_z, qx, qy, qz, triangle",
        "return True, radius - distance, n_x + SIZE * n_z, n_y, n_z - SIZE * n_x, qx, qy, qz, triangle",
        0.001, "mrad", factor=1e3, side="lammps", cases=ON_ASPERITIES,
    ),
    Mutant(
        "normal turned, in both", "the normal leans along x in both engines, which share it",
        f"{FIELD}:surface_contact",
        "return True, radius - distance, n_x, n_y, n_z, qx, qy, qz, triangle",
        "return True, radius - distance, n_x + SIZE * n_z, n_y, n_z - SIZE * n_x, qx, qy, qz, triangle",
        0.001, "mrad", factor=1e3, side="both", cases=ON_ASPERITIES,
    ),
)  # fmt: skip
