"""Figs. 2 and 3: where the surface yields under a point load, and the cap that is taken off."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.patches import Circle, Polygon

from cmpcheck.figures.canvas import BLUE, INK, MICRO, PALE, Picture, blank
from reference.case import Case
from reference.contact import effective_modulus, impact_duration, mean_load
from reference.removal import boussinesq_stress, cap, indentation_depth, von_mises, yield_radius

SHOWN = 0.6  # x_p/R of the drawings: the load at which the cap is large enough to be seen
DIMENSION = {"arrowstyle": "<->", "color": INK, "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0}


def yield_distance(angle: Any, poisson_ratio: float) -> Any:
    """Distance from a point load, in units of x_p, within which the surface yields; arrays broadcast.

    Paper: Eqs. (32)-(34).  The stress falls as the square of the distance, so that one evaluation gives it.
    Parameters: angle from the axis, in rad; pi/2 is the surface.
    """
    x_p = yield_radius(1.0, poisson_ratio, 1.0)
    stress = boussinesq_stress(1.0, x_p * np.sin(angle), x_p * np.cos(angle), poisson_ratio)
    return np.sqrt(von_mises(*stress))


def yield_picture(case: Case) -> Picture:
    """Fig. 2: the region that yields, from the von Mises stress of a point load, and the cap within it."""
    nu, _ = _surface(case)
    title = "Fig. 2: region that yields under a point load, Eqs. (32)–(34)"
    figure = blank(5.2, 4.4, title)
    axes = figure.add_subplot()
    angle = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 721)
    reach = yield_distance(np.abs(angle), nu)
    r, z = reach * np.sin(angle), reach * np.cos(angle)
    axes.fill(r, z, color=PALE, linewidth=0)
    axes.plot(r, z, color=INK, linewidth=1.6)
    at_45 = np.flatnonzero(angle >= -0.25 * math.pi)[0]
    for level in (0.5, 2.0, 4.0):
        shrunk = 1.0 / math.sqrt(level)
        axes.plot(shrunk * r, shrunk * z, color=INK, linewidth=0.6, linestyle=":")
        ground = {"facecolor": PALE if level > 1.0 else "white", "edgecolor": "none", "pad": 0.5}
        x, y = shrunk * r[at_45], shrunk * z[at_45]
        axes.text(x, y, f"{level:g} $\\sigma_y$", fontsize=8, ha="center", va="center", bbox=ground)
    radius, depth = 1.0 / SHOWN, float(indentation_depth(1.0, 1.0 / SHOWN))
    x = np.linspace(-1.0, 1.0, 200)
    axes.plot(x, _cap_depth(x, radius, depth), color=BLUE, linestyle=(0, (4, 2)), linewidth=1.6)
    axes.axhline(0.0, color=INK, linewidth=1.0)
    arrow = {"arrowstyle": "-|>", "color": INK, "shrinkB": 0}
    axes.annotate("$P$", (0, 0), (0, -0.55), ha="center", arrowprops=arrow)
    axes.annotate("", (0, -0.12), (1, -0.12), arrowprops=DIMENSION)
    axes.text(0.5, -0.2, "$x_p$", ha="center", va="bottom")
    z_p = float(yield_distance(0.0, nu))
    axes.annotate("", (0, 0), (0, z_p), arrowprops=DIMENSION)
    ground = {"facecolor": PALE, "edgecolor": "none", "pad": 1.0}
    axes.text(0.1, 0.6 * z_p, f"$z_p$ = {z_p:.2f} $x_p$", va="center", bbox=ground)
    leader = {"arrowstyle": "-", "linewidth": 0.7, "shrinkA": 1, "shrinkB": 0}
    rim = (-r[at_45], z[at_45])
    axes.annotate(r"$\bar\sigma = \sigma_y$", rim, (1.55, 1.62), va="center", arrowprops=leader)
    target = (-0.55, _cap_depth(0.55, radius, depth))
    blue = leader | {"color": BLUE}
    axes.annotate("cap removed (Fig. 3)", target, (-1.55, -0.35), color=BLUE, ha="center", arrowprops=blue)
    axes.set(xlabel="distance from the axis, $r/x_p$", ylabel="depth, $z/x_p$", aspect="equal")
    axes.set(xlim=(-2.4, 2.4), ylim=(3.0, -0.75), yticks=np.arange(0.0, 3.1, 0.5))
    caption = (
        f"Von Mises stress of a point load P on a half-space (Poisson's ratio {nu:g}). Solid: where it "
        f"equals the yield stress σ_y; inside (grey) the material yields. Dotted: 0.5, 2 and 4 σ_y. Lengths "
        f"in units of x_p, Eq. (34), the radius at the surface; below the load the region reaches z_p = "
        f"{z_p:.2f} x_p, whatever P is. Dashed: the cap that is removed, drawn for x_p = {SHOWN:g} R. "
        f"{_example(case)}"
    )
    return Picture("figure_2", title, caption, figure)


def cap_picture(case: Case) -> Picture:
    """Fig. 3: the cap of a sphere of the particle's radius, Eqs. (35) and (36)."""
    x_p, depth = SHOWN, float(indentation_depth(SHOWN, 1.0))
    title = "Fig. 3: spherical cap that one impact removes, Eqs. (35), (36)"
    figure = blank(5.2, 3.2, title)
    axes = figure.add_subplot()
    axes.add_patch(
        Circle((0, 1 - depth), 1.0, fill=False, edgecolor=INK, linestyle=(0, (4, 2)), linewidth=1.0)
    )
    axes.fill_between([-1.9, 1.9], 0, -0.75, color=PALE, linewidth=0)
    x = np.linspace(-x_p, x_p, 200)
    outline = np.column_stack([x, -_cap_depth(x, 1.0, depth)])
    axes.add_patch(Polygon(outline, facecolor="white", edgecolor=BLUE, hatch="////", linewidth=1.6))
    for side in (-1, 1):
        axes.plot([side * x_p, side * 1.9], [0, 0], color=INK, linewidth=1.0)
    axes.plot([0, 0], [1 - depth, -depth], color=INK, linewidth=0.6, linestyle="-.")
    axes.annotate("", (0, 1 - depth), (x_p, 0), arrowprops=DIMENSION)
    axes.text(0.36, 0.46, "$R$", va="bottom")
    axes.text(-0.05, 0.5, r"$R - \delta h$", ha="right", va="center")
    axes.annotate("", (-x_p, 0.09), (0, 0.09), arrowprops=DIMENSION)
    axes.text(-0.3, 0.13, "$x_p$", ha="center")
    axes.annotate("", (1.05, -depth), (1.05, 0.0), arrowprops=DIMENSION)
    axes.text(1.09, -0.5 * depth, r"$\delta h$", va="center")
    axes.plot([0, 1.12], [-depth, -depth], color=INK, linewidth=0.5)
    axes.text(-1.85, 0.06, "surface before the impact", fontsize=8)
    axes.text(-1.85, -0.68, "wafer", fontsize=8)
    axes.text(0, 1.08, "particle", fontsize=8, ha="center")
    axes.text(0, -0.5, r"$\delta h = R - \sqrt{R^2 - x_p^2}$   (35)", ha="center", va="center")
    axes.text(
        0, -0.68, r"$V = \frac{\pi}{6}\,\delta h\,(3x_p^2 + \delta h^2)$   (36)", ha="center", va="center"
    )
    axes.set(xlim=(-1.9, 1.9), ylim=(-0.78, 1.28), aspect="equal")
    axes.set_axis_off()
    caption = (
        f"The cap (hatched) belongs to a sphere of the particle's radius R (dashed) and meets the surface in "
        f"a circle of radius x_p, Eq. (34); it is removed with its mass ρ_s V. Drawn for x_p = {SHOWN:g} R. "
        f"{_example(case)}"
    )
    return Picture("figure_3", title, caption, figure)


def _cap_depth(r: Any, radius: float, depth: float) -> Any:
    """How deep a cap of that sphere is at a distance r from its axis."""
    return np.sqrt(radius**2 - np.square(r)) - (radius - depth)


def _surface(case: Case) -> tuple[float, float]:
    """Poisson's ratio and yield stress of the surface."""
    material = case.material[case.surface.material or ""]
    assert material.yield_stress is not None
    return material.poisson_ratio, material.yield_stress


def _example(case: Case) -> str:
    """What one impact of the case does, in numbers."""
    assert case.particles is not None
    assert case.pad is not None
    diameter, speed = case.particles.mean_diameter, case.pad.speed
    grain, wafer = case.material[case.particles.material], case.material[case.surface.material or ""]
    moduli = [m.youngs_modulus / (1.0 - m.poisson_ratio**2) for m in (grain, wafer)]
    mass, radius = grain.density * math.pi * diameter**3 / 6.0, 0.5 * diameter
    duration = impact_duration(mass, radius, effective_modulus(*moduli), speed)
    load = mean_load(mass, -speed, case.contact.restitution, 0.0, duration)
    x_p, depth, volume = cap(load, radius, *_surface(case))
    return (
        f"In the example, {case.particles.material} of {diameter / MICRO:g} µm that strikes "
        f"{case.surface.material} at {speed:g} m/s gives P = {load / MICRO:.2f} µN, "
        f"x_p = {x_p / 1e-9:.1f} nm = {x_p / radius:.3f} R, δh = {depth / 1e-9:.2f} nm, "
        f"V = {volume / 1e-27:.0f} nm³."
    )
