"""What the measured speeds of the engines say, in sentences, each with the numbers it rests on."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.measurement import Cell, digits


class _Table:
    """The cells that have a speed, by engine, surface, size and ranks."""

    def __init__(self, cells: Sequence[Cell]) -> None:
        self.cells = {(c.way.key, c.surface, c.count, c.way.ranks): c for c in cells if c.measured}
        self.wheres = list(dict.fromkeys((c.surface, c.count) for c in self.cells.values()))

    def pairs(self, first: str, second: str) -> list[tuple[Cell, Cell]]:
        """Cells of two engines over the same surface, at the same size, both on one rank."""
        keys = [((first, *where, 1), (second, *where, 1)) for where in self.wheres]
        return [(self.cells[a], self.cells[b]) for a, b in keys if a in self.cells and b in self.cells]

    def ratios(self, first: str, second: str, name: str = "speed") -> str:
        """How many times as fast the first is as the second, at every surface and size; "" if never both."""
        return _listed([(a, a.middle(name) / b.middle(name)) for a, b in self.pairs(first, second)])


def _listed(ratios: Sequence[tuple[Cell, float]]) -> str:
    return ", ".join(f"{digits(ratio, 2)} ({cell.surface}, N = {cell.count})" for cell, ratio in ratios)


def findings(cells: Sequence[Cell]) -> list[str]:
    """One sentence or two for each thing to be known; those whose engines were not measured are left out."""
    table = _Table(cells)
    lines = [_fastest(table, where) for where in table.wheres]
    if ratios := table.ratios("reference", "lammps_fix", "pace"):
        lines.append(
            "The reference has no springs to resolve: with its long steps it simulates this many times as "
            f"much time in a second as LAMMPS with the fix: {ratios}."
        )
    if ratios := table.ratios("reference_soft_step", "lammps_fix"):
        lines.append(
            f"Step for step the reference is this many times as fast as LAMMPS with the fix: {ratios}."
        )
    if ratios := table.ratios("lammps_fix", "lammps_native"):
        lines.append(
            f"LAMMPS with the fix is this many times as fast as by itself: {ratios}. By itself it has drag "
            "as atom-style variables, whose formulas it interprets for every particle at every step: most of "
            "its time goes to that, not to contacts, and most of LIGGGHTS's over a plane too (`NOTES.md`)."
        )
    lines += _mesh(table)
    if ratios := table.ratios("lammps_fix", "lammps_observed"):
        lines.append(
            f"To follow the contacts of pairs takes LAMMPS with the fix this many times as long: {ratios}."
        )
    if ratios := table.ratios("liggghts", "liggghts_observed"):
        lines.append(
            "As cmpcheck drives it, looking from outside at every step at which something may touch, "
            f"LIGGGHTS takes this many times as long as by itself: {ratios}."
        )
    lines += _ranks(table)
    return lines


def _fastest(table: _Table, where: tuple[str, int]) -> str:
    """Who makes most steps over one surface at one size, and who fewest."""
    here = sorted(
        (cell for key, cell in table.cells.items() if key[1:3] == where and cell.way.ranks == 1),
        key=lambda cell: cell.middle("speed"),
    )
    slowest, fastest = here[0], here[-1]
    ratio = fastest.middle("speed") / slowest.middle("speed")
    return (
        f"Surface {where[0]}, N = {where[1]}, one rank: {fastest.way.label} makes {digits(ratio, 2)} times "
        f"as many particle-steps per second as {slowest.way.label}, the slowest."
    )


def _mesh(table: _Table) -> list[str]:
    """What a triangle of LIGGGHTS's mesh costs, from the same flat surface as a mesh and as a plane."""
    lines = []
    for mesh, plane in table.pairs("liggghts", "liggghts_plane"):
        extra = mesh.middle("step") - plane.middle("step")
        if extra > 0.0:
            lines.append(
                f"LIGGGHTS's mesh wall costs {digits(1e9 * extra / mesh.triangles, 2)} ns per triangle and "
                f"step, {100 * extra / mesh.middle('step'):.0f} % of its time, at N = {mesh.count} with "
                f"{mesh.triangles} triangles, of which all are visited at every step, near a particle or not "
                "(`NOTES.md`)."
            )
    return lines


def _ranks(table: _Table) -> list[str]:
    """What a second rank gives."""
    lines = []
    for key in dict.fromkeys(key for key, _, _, ranks in table.cells if ranks == 2):
        found = [
            (two, two.middle("speed") / table.cells[key, *where, 1].middle("speed"))
            for where in table.wheres
            if (two := table.cells.get((key, *where, 2))) and (key, *where, 1) in table.cells
        ]
        if not found:
            continue
        line = f"Two ranks are this many times as fast as one, {found[0][0].way.label}: {_listed(found)}."
        if key == "lammps_fix":
            smallest = min(found, key=lambda entry: entry[0].count)[0]
            one = table.cells[key, smallest.surface, smallest.count, 1]
            extra = 1e6 * (smallest.middle("step") - one.middle("step"))
            line += (
                " With more ranks the fix is a Python function around the compiled one, with a reduction "
                f"over the ranks: {extra:.0f} µs more a step at N = {smallest.count}."
            )
        lines.append(line)
    return lines
