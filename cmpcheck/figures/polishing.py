"""Figs. 4 to 6: the initial surface, snapshots of polishing, and flatness over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import Collection, EllipseCollection
from matplotlib.quiver import Quiver
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation

from cmpcheck.figures.canvas import BLUE, INK, MICRO, PALE, Picture, blank, greys
from cmpcheck.surfaces import surface_mesh, surfaces_over_time
from reference.case import Case
from reference.heightfield import Heightfield, flatness
from reference.process import PAD_DESCENT
from reference.recording import Run

SNAPSHOTS = 6
ARROW = 2.0  # um for 1 m/s


def surface_picture(run: Run) -> Picture:
    """Fig. 4: the triangulated initial surface, and one of its asperities from near."""
    surface, part = run.surface_initial, run.case.surface
    assert surface is not None
    assert part.asperity_height is not None
    title = "Fig. 4: initial surface, random asperities of four raised nodes (Section 4)"
    figure = blank(7.2, 3.5, title)
    whole, near = figure.subplots(1, 2)
    top = part.asperity_height / MICRO
    mesh = _triangulation(*surface_mesh(surface))
    for axes, colour, width in ((whole, "#a0a0a0", 0.1), (near, INK, 0.5)):
        colours = _draw_heights(axes, surface, 0.0, top)
        axes.triplot(mesh, color=colour, linewidth=width)
        axes.set(xlabel="$x$ (µm)", ylabel="$y$ (µm)")
    i, j = _lonely(surface)
    h = surface.spacing / MICRO
    left, right, low, high = (i - 3) * h, (i + 4) * h, (j - 3) * h, (j + 4) * h
    near.set(xlim=(left, right), ylim=(low, high))
    x, y = np.meshgrid([i * h, (i + 1) * h], [j * h, (j + 1) * h])
    near.plot(x.ravel(), y.ravel(), "o", color=BLUE, markersize=5)
    whole.plot([left, right, right, left, left], [low, low, high, high, low], color=BLUE, linewidth=1.4)
    whole.set_title("whole surface")
    near.set_title("one asperity (frame on the left): four raised nodes")
    for axis in (whole.xaxis, whole.yaxis, near.xaxis, near.yaxis):
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10], integer=True))
    figure.colorbar(colours, ax=[whole, near], label="height $z$ (µm)", shrink=0.9)
    nodes, (n_x, n_y) = surface.z.size, surface.z.shape
    raised = int((surface.z > 0.5 * part.asperity_height).sum())
    squares = round((part.asperity_density or 0.0) * nodes)
    caption = (
        f"{n_x} × {n_y} nodes at a spacing of {h:g} µm, two triangles per square, periodic along x and y. "
        f"{squares} squares at random, which may overlap, are raised to h_a = {top:g} µm: asperity density "
        f"ρ_a = 2 N_a/N_e = {2 * squares / (2 * nodes):g}, and {raised} of {nodes} nodes stand high. "
        f"Seed {run.case.case.seed} of the case {run.case.name}."
    )
    return Picture("figure_4", title, caption, figure)


def snapshot_picture(run: Run) -> Picture:
    """Fig. 5: particles with their velocities over the height map, at equal intervals of time."""
    surfaces, scale = surfaces_over_time(run), _acceleration(run.case)
    assert surfaces is not None
    frames = np.linspace(0, len(run.times) - 1, SNAPSHOTS).round().astype(int)
    title = "Fig. 5: snapshots of polishing, with the velocities of the particles (Section 4)"
    figure = blank(7.2, 5.1, title)
    panels = figure.subplots(2, SNAPSHOTS // 2, sharex=True, sharey=True)
    top = surfaces[0].z.max() / MICRO
    low = -0.2 * top  # a few pits are deeper
    deepest = min(surface.z.min() for surface in surfaces) / MICRO
    for axes, k in zip(panels.flat, frames, strict=True):
        colours = _draw_heights(axes, surfaces[k], low, top)
        arrows = _draw_particles(axes, run, k)
        row = run.history.iloc[k]
        time = f"${'' if scale == 1 else 'A'}t$ = {scale * run.times[k]:.2g} s"
        axes.set_title(
            f"{time},  $H$ = {row.pad_height / MICRO:.2f} µm\n"
            f"$\\Pi$ = {row.flatness:.2f},  mean $v_x$ = {row.mean_velocity_x:.2f} m/s",
            fontsize=8,
        )
    for axes in panels[-1]:
        axes.set_xlabel("$x$ (µm)")
    for axes in panels[:, 0]:
        axes.set_ylabel("$y$ (µm)")
    panels[0, 0].quiverkey(
        arrows, 0.885, 0.9, 1.0, "1 m/s", labelpos="E", coordinates="figure", fontproperties={"size": 8}
    )
    extend = "min" if deepest < low else "neither"
    figure.colorbar(colours, ax=panels, label="height $z$ (µm)", shrink=0.8, extend=extend)
    caption = (
        f"N = {len(run.diameters)} particles (circles at their true size) in the sheared film between the "
        f"wafer and the pad, which moves along x and comes down to H; arrows are velocities in the plane. "
        f"The deepest pit is {max(-deepest, 0.0):.2f} µm below the base plane. {_about_time(run.case)} "
        f"Seed {run.case.case.seed} of the case {run.case.name}. Π from Eq. (44) with "
        f"q = {run.case.cost.exponent:g}."
    )
    return Picture("figure_5", title, caption, figure)


def flatness_picture(runs: Sequence[Run]) -> Picture:
    """Fig. 6: the cost function over time, mean and spread over the samples, and the pad's height."""
    case, scale = runs[0].case, _acceleration(runs[0].case)
    times = scale * runs[0].times
    squared, linear = np.moveaxis(np.array([_flatness_over_time(run, (2.0, 1.0)) for run in runs]), 2, 0)
    mean, spread = squared.mean(axis=0), squared.std(axis=0, ddof=1) if len(runs) > 1 else 0.0 * squared[0]
    title = "Fig. 6: cost function Π over time, Eq. (44)"
    figure = blank(5.6, 4.6, title)
    axes, pad = figure.subplots(2, 1, sharex=True, height_ratios=[3.2, 1.0])
    axes.fill_between(
        times, mean - spread, mean + spread, color=PALE, linewidth=0, label="± one standard deviation"
    )
    axes.plot(times, squared.T, color="#8c8c8c", linewidth=0.5)
    axes.plot([], [], color="#8c8c8c", linewidth=0.5, label="each sample, $q = 2$")
    axes.plot(times, mean, color=INK, linewidth=2.0, label=f"mean of {len(runs)} samples, $q = 2$")
    axes.plot(times, linear.mean(axis=0), color=BLUE, linestyle=(0, (4, 2)), label="mean, $q = 1$")
    axes.set(ylabel=r"cost function $\Pi$", ylim=(0.0, 1.05), xlim=(0.0, times[-1]))
    axes.legend(loc="upper right", frameon=True, edgecolor="none", framealpha=1.0)
    heights = np.array([run.history["pad_height"] for run in runs]) / MICRO
    pad.plot(times, heights.mean(axis=0), color=INK)
    pad.set(xlabel="time $t$ (s)" if scale == 1 else "time × acceleration, $A\\,t$ (s)")
    pad.set(ylabel="pad height\n$H$ (µm)", ylim=(0.0, None))
    for panel in (axes, pad):
        panel.spines[["top", "right"]].set_visible(False)
        panel.grid(color=PALE, linewidth=0.5)
        panel.set_axisbelow(True)
    caption = (
        f"The case {case.name}, {len(runs)} samples with seeds of their own: Π(T) = {mean[-1]:.2f}, with a "
        f"standard deviation of {spread[-1]:.2f} between samples (q = 2). {_about_time(case)} Below: the gap "
        f"between pad and base plane; the pad comes down at a constant speed until {PAD_DESCENT:g} T."
    )
    return Picture("figure_6", title, caption, figure)


def _flatness_over_time(run: Run, exponents: tuple[float, ...]) -> list[list[float]]:
    """Pi (times, exponents)."""
    surfaces, target = surfaces_over_time(run), run.case.cost.target_height
    assert surfaces is not None
    return [[flatness(now.z, surfaces[0].z, target, q) for q in exponents] for now in surfaces]


def _triangulation(points: np.ndarray, triangles: np.ndarray) -> Triangulation:
    return Triangulation(points[:, 0] / MICRO, points[:, 1] / MICRO, triangles)


def _draw_heights(axes: Axes, surface: Heightfield, low: float, high: float) -> Collection:
    """The height map, linear on each triangle, in um."""
    points, triangles = surface_mesh(surface)
    axes.set(xlim=(0, points[:, 0].max() / MICRO), ylim=(0, points[:, 1].max() / MICRO), aspect="equal")
    return axes.tripcolor(
        _triangulation(points, triangles), points[:, 2] / MICRO, shading="gouraud", cmap=greys(), vmin=low,
        vmax=high, rasterized=True,
    )  # fmt: skip


def _draw_particles(axes: Axes, run: Run, k: int) -> Quiver:
    """Circles at true size, and arrows of the velocity in the plane."""
    x, y = run.positions[k, :, 0] / MICRO, run.positions[k, :, 1] / MICRO
    d = run.diameters / MICRO
    axes.add_collection(
        EllipseCollection(
            d, d, np.zeros_like(d), units="xy", offsets=np.column_stack([x, y]),
            offset_transform=axes.transData, facecolors="none", edgecolors=BLUE, linewidths=0.7,
        )
    )  # fmt: skip
    return axes.quiver(
        x, y, run.velocities[k, :, 0], run.velocities[k, :, 1], angles="xy", scale_units="xy",
        scale=1.0 / ARROW, color=INK, width=0.006, zorder=3,
    )  # fmt: skip


def _lonely(surface: Heightfield) -> tuple[int, int]:
    """Lower left node of a raised square away from the edges, the one with the fewest raised nodes around."""
    high = surface.z > 0.5 * surface.z.max()
    found, fewest = (3, 3), high.size + 1
    for i in range(3, high.shape[0] - 4):
        for j in range(3, high.shape[1] - 4):
            around = int(high[i - 2 : i + 4, j - 2 : j + 4].sum())
            if high[i : i + 2, j : j + 2].all() and around < fewest:
                found, fewest = (i, j), around
    return found


def _acceleration(case: Case) -> float:
    return case.removal.acceleration if case.removal else 1.0


def _about_time(case: Case) -> str:
    """How the time axis is to be read."""
    scale = _acceleration(case)
    if scale == 1.0:
        return f"T = {case.case.duration:g} s."
    return (
        f"Removal is accelerated by A = {scale:g}: each impact lowers the surface A times as much, and "
        f"T = {scale * case.case.duration:g} s is simulated as {case.case.duration / 1e-3:g} ms."
    )
