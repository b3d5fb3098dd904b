"""How the study of wear is shown: its tables, charts and the sentence that sums it up.

What is shown is found by `wear_laws.py` and put together by `wear.py`; without what LIGGGHTS wears off, the
laws are shown alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cmpcheck.display import number
from cmpcheck.engines.liggghts_library import version
from cmpcheck.results import Chart, Column, Curve, Estimate, Table
from cmpcheck.studies.wear_laws import CONSTANT, FINE, FINNIE, INTEGRAL, PAPER, SPEED, SPEED_ANGLE, Laws, Worn

SLOW = 0.1  # m/s, of a second curve by angle
SHOWN_ANGLES = (5.0, 30.0, 75.0)  # of which every level is in a table
COMPARED = (15.0, 75.0)  # degrees: within, one law is fitted to the other
NAN = float("nan")
QUADRATURE = "LIGGGHTS's integral, by quadrature"


def angle_table(laws: Laws, angles: Sequence[float], worn: dict[tuple[float, float], Worn]) -> Table:
    """Volumes by angle, and what LIGGGHTS tends to beside the integral."""
    rows: list[tuple[str | float | Estimate, ...]] = []
    for angle in map(float, angles):
        one = worn.get((SPEED, angle))
        told = (
            (one.finest, one.limit.value, one.verdict.error, one.verdict.tolerance,
             NAN if one.limit.order is None else one.limit.order, one.verdict.status)
            if one else (NAN, NAN, NAN, NAN, NAN, "not_tested")
        )  # fmt: skip
        laws_here = (volume(SPEED, angle) for volume in (laws.paper, laws.finnie, laws.quadrature))
        rows.append((angle, *laws_here, *told))
    return Table(
        f"Volume removed by one impact at {SPEED:g} m/s, and LIGGGHTS against the integral; at 90° Finnie's "
        "is what the rounding of cos 90° leaves",
        (
            Column("α", "°"), Column(PAPER, "m3"), Column(FINNIE, "m3"), Column(QUADRATURE, "m3"),
            Column("LIGGGHTS, finest", "m3"), Column("LIGGGHTS, Δt → 0", "m3"), Column("error", "m3"),
            Column("tolerance", "m3"), Column("observed order"), Column("status"),
        ),
        tuple(rows),
    )  # fmt: skip


def levels_table(
    laws: Laws, angles: Sequence[float], steps: Sequence[int], worn: dict[tuple[float, float], Worn]
) -> Table:
    """What LIGGGHTS wears off at each number of steps per contact, for a few angles."""
    rows = []
    for angle in (a for a in SHOWN_ANGLES if a in angles):
        values = worn[SPEED, angle].values if worn else (NAN,) * len(steps)
        target = laws.quadrature(SPEED, angle)
        for n, volume in zip(steps, values, strict=True):
            first = laws.excess(SPEED, angle, n) / target
            rows.append((angle, float(n), volume, target, 100 * (volume / target - 1), 100 * first))
    return Table(
        f"LIGGGHTS at several time steps, {SPEED:g} m/s, and the first-order error of its sum by quadrature",
        (
            Column("α", "°"), Column("steps per contact"), Column("LIGGGHTS", "m3"),
            Column("its integral", "m3"), Column("excess", "%"), Column("first-order excess", "%"),
        ),
        tuple(rows),
    )  # fmt: skip


def speed_table(laws: Laws, speeds: Sequence[float], worn: dict[tuple[float, float], Worn]) -> Table:
    """Volumes by speed."""
    rows: tuple[tuple[str | float | Estimate, ...], ...] = tuple(
        (
            v, *(volume(v, SPEED_ANGLE) for volume in (laws.paper, laws.finnie, laws.quadrature)),
            worn[v, SPEED_ANGLE].finest if worn else NAN,
            worn[v, SPEED_ANGLE].verdict.status if worn else "not_tested",
        )
        for v in speeds
    )  # fmt: skip
    return Table(
        f"Volume removed by one impact at {SPEED_ANGLE:g}°",
        (
            Column("speed", "m/s"), Column(PAPER, "m3"), Column(FINNIE, "m3"),
            Column(QUADRATURE, "m3"), Column("LIGGGHTS, finest", "m3"), Column("status"),
        ),
        rows,
    )  # fmt: skip


def exponents_table(fits: dict[tuple[str, str], tuple[Estimate, float, float]]) -> Table:
    """The exponents by law and by what it is a power of, with the errors of their fits."""
    return Table(
        f"Exponents, ± standard error of the fit: of v at {SPEED_ANGLE:g}° where the law removes (m/s), "
        "of α at grazing incidence (degrees)",
        (Column("law"), Column("in"), Column("exponent"), Column("from"), Column("to")),
        tuple((law, of, *fit) for (law, of), fit in fits.items()),
    )


def zeros_table(
    laws: Laws, zeros: dict[str, tuple[float, float]], worn: dict[tuple[float, float], Worn]
) -> Table:
    """Volumes where a law removes nothing, by name of the impact (speed, angle)."""
    tops = [max(law(SPEED, a) for a in FINE) for law in laws.of_all]
    rows: list[tuple[str | float | Estimate, ...]] = []
    for name, (speed, angle) in zeros.items():
        shares = [law(speed, angle) / top for law, top in zip(laws.of_all, tops, strict=True)]
        measured = worn[speed, angle].finest / tops[-1] if worn else NAN
        rows.append((name, angle, laws.model.poisson_ratio, *shares, measured))
    incompressible = laws.paper(SPEED, 90.0, poisson_ratio=0.5) / tops[0]
    rows.insert(1, ("head-on, incompressible wall", 90.0, 0.5, incompressible, *rows[0][4:]))
    return Table(
        f"Where each law is zero: volumes at {SPEED:g} m/s as shares of the law's largest over the angle; "
        "head-on Finnie's is what the rounding of cos 90° leaves",
        (
            Column("impact"), Column("α", "°"), Column("ν of the wall"), Column(PAPER), Column(FINNIE),
            Column(INTEGRAL), Column("LIGGGHTS, finest"),
        ),
        tuple(rows),
    )  # fmt: skip


def charts(
    laws: Laws, angles: Sequence[float], speeds: Sequence[float], worn: dict[tuple[float, float], Worn]
) -> tuple[Chart, Chart]:
    """Volume against angle, and against speed."""
    top = max(laws.finnie(SPEED, a) for a in FINE)
    fine, name = tuple(map(float, FINE)), f"LIGGGHTS {version()}, Δt → 0"

    def paper(speed: float) -> Curve:
        head_on = laws.paper(speed, 90.0)
        return Curve(f"paper, {speed:g} m/s", fine, tuple(laws.paper(speed, a) / head_on for a in fine))

    shares = [
        Curve("Finnie 1960, f(α)", fine, tuple(laws.finnie(SPEED, a) / top for a in fine)),
        Curve("LIGGGHTS's integral", fine, tuple(laws.integral(SPEED, a) / top for a in fine)),
        paper(SPEED),
        paper(SLOW),
    ]
    slowest = laws.model.threshold_velocity / np.sin(np.deg2rad(SPEED_ANGLE)) * (1 + 1e-9)
    reached = (slowest, *(v for v in speeds if v > slowest))
    by_speed = [
        Curve("Finnie 1960", tuple(speeds), tuple(laws.finnie(v, SPEED_ANGLE) for v in speeds)),
        Curve("LIGGGHTS's integral", tuple(speeds), tuple(laws.integral(v, SPEED_ANGLE) for v in speeds)),
        Curve("paper", reached, tuple(laws.paper(v, SPEED_ANGLE) for v in reached)),
    ]
    if worn:
        points = tuple(worn[SPEED, float(a)].limit.value / top for a in angles)
        shares.append(Curve(name, tuple(map(float, angles)), points, style="points"))
        points = tuple(worn[v, SPEED_ANGLE].limit.value for v in speeds)
        by_speed.append(Curve(name, tuple(speeds), points, style="points"))
    return (
        Chart(
            "Volume removed by one impact against its angle: Finnie's and LIGGGHTS's, with one k, as shares "
            "of the maximum of k m v² f(α), the paper's as shares of what it removes head-on at that speed "
            "(one curve, from the threshold on)",
            Column("impact angle α from the wall", "°"), Column("share of the maximum"), tuple(shares),
        ),
        Chart(
            f"Volume removed by one impact at {SPEED_ANGLE:g}° against its speed; the paper's begins at the "
            "threshold",
            Column("speed", "m/s"), Column("removed volume", "m3"), tuple(by_speed), logarithmic=True,
        ),
    )  # fmt: skip


def sentence(
    laws: Laws, angles: Sequence[float], fits: dict[tuple[str, str], tuple[Estimate, float, float]],
    threshold: float, worn: dict[tuple[float, float], Worn],
) -> str:  # fmt: skip
    """What the study says: how LIGGGHTS converges, how the laws differ, what follows for choosing one."""
    of_paper, of_finnie, of_integral = (np.array([law(SPEED, a) for a in FINE]) for law in laws.of_all)
    peaks = [f"{FINE[volumes.argmax()]:.0f}°" for volumes in (of_finnie, of_integral)]
    low, high = COMPARED
    fitted = (low <= FINE) & (high >= FINE)
    ratio = of_integral[fitted] / of_paper[fitted]
    steep = laws.integral(SPEED, 60.0) / laws.finnie(SPEED, 60.0)
    left = laws.integral(SPEED, threshold) / of_integral.max()
    v = {law: f"v^{fit.value:.2f}" for (law, of), (fit, _, _) in fits.items() if of == "v"}
    grazing = {law: f"α^{fit.value:.2f}" for (law, of), (fit, _, _) in fits.items() if of != "v"}
    decade = 10.0 ** abs(fits[PAPER, "v"][0].value - fits[INTEGRAL, "v"][0].value)
    return (
        f"{_convergence(angles, worn)}That integral is not Finnie's law of the impact: since the angle falls "
        f"to zero while the wall stops the normal motion, it goes as {grazing[INTEGRAL]} at grazing "
        f"incidence instead of {grazing[FINNIE]}, is largest at {peaks[1]} instead of {peaks[0]}, and at 60° "
        f"is {steep:.1f} times as large. Both go as {v[FINNIE]}, the paper's removal as {v[PAPER]} "
        f"({v[CONSTANT]} with impacts of constant duration). Finnie's law removes nothing head-on, where the "
        "paper's removes the most; the paper's removes nothing at ν = 1/2 or below v sin α = "
        f"{laws.model.threshold_velocity:g} m/s, that is {threshold:.1f}° at {SPEED:g} m/s, where LIGGGHTS's "
        f"still is {100 * left:.1g} % of its maximum. For choosing a wear model this means: Finnie's law is "
        "for abrasives that slide and cut, the paper's for abrasives that strike and indent, and neither "
        "stands in for the other: a k_finnie fitted to the paper's removal at one angle is off by a factor "
        f"of up to {number(ratio.max() / ratio.min(), 2)} at another between {low:g}° and {high:g}°, and by "
        f"{number(decade, 2)} more for each decade of speed."
    )


def _convergence(angles: Sequence[float], worn: dict[tuple[float, float], Worn]) -> str:
    """How LIGGGHTS stands to the integral, from all impacts by angle."""
    if not worn:
        return "LIGGGHTS's sum is meant to tend to an integral over its contact. "
    found = {float(a): worn[SPEED, float(a)] for a in angles}
    orders = {a: one.limit.order for a, one in found.items() if one.limit.order is not None}
    usual = [order for a, order in orders.items() if a <= COMPARED[1]]
    first = f"orders {min(usual):.2f} to {max(usual):.2f} up to {COMPARED[1]:g}°" if usual else "no order"
    first += "".join(f", {order:.2f} at {a:g}°" for a, order in orders.items() if a > COMPARED[1])
    off = [f"{a:g}°" for a, one in found.items() if one.verdict.status != "agree"]
    if off:
        return f"LIGGGHTS's wear does not agree with its own contact integral at {', '.join(off)} ({first}). "
    limits = [one.verdict.error / one.limit.value for a, one in found.items() if a < 90.0]
    return (
        f"LIGGGHTS's wear tends to the integral over its contact at first order (observed: {first}; limits "
        f"within {100 * max(limits):.1g} % of quadrature). "
    )
