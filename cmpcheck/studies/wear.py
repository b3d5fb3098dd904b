"""Wear by Finnie's law, as LIGGGHTS has it, beside the paper's removal: single impacts by angle and speed.

One sphere, a flat wall, no friction: what one impact removes by the paper's Eqs. 30-36, through the
reference's kernel; by Finnie's law of 1960; by LIGGGHTS; and by the integral that LIGGGHTS's sum stands for.
Without LIGGGHTS the laws are compared all the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cmpcheck.convergence import Agreement, Extrapolation, agreement, exact, extrapolate
from cmpcheck.display import number
from cmpcheck.engines.liggghts_library import available, version
from cmpcheck.engines.liggghts_wear import PRINTED, FinnieDeck, Impact
from cmpcheck.fixes.calibration import damping_ratio
from cmpcheck.results import Chart, Column, Curve, Estimate, StudyResult, Table
from cmpcheck.studies.sampling import changed
from reference.case import Case, load_case
from reference.collisions import record_surface_impact
from reference.exact import (
    finnie_contact,
    finnie_contact_excess,
    finnie_contact_quadrature,
    finnie_impact,
)
from reference.ledger import DURATION, REMOVED_VOLUME, empty_ledger
from reference.process import build_setup

CASE = "wall_bounce"
COPPER = {"soft_copper": {"yield_stress": "0.3 GPa"}}  # what copper has; the case's is far softer
SPEED, SLOW, SPEED_ANGLE = 1.0, 0.1, 45.0  # m/s, m/s, degrees
ANGLES = {"quick": (5, 10, 15, 20, 30, 45, 60, 75, 90), "full": tuple(range(5, 95, 5))}
SPEEDS = {"quick": (0.05, 0.1, 1.0, 10.0), "full": (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)}
STEPS = {"quick": (100, 200, 400), "full": (100, 200, 400, 800)}  # per contact
SHOWN_ANGLES = (5.0, 30.0, 75.0)  # of which every level is in a table
FINE = np.linspace(0.25, 90.0, 360)  # degrees, of the curves
GRAZING = np.array([0.05, 0.1, 0.2])  # degrees, where the exponents in the angle are taken
COMPARED = (15.0, 75.0)  # degrees: within, one law is fitted to the other
LIGGGHTS_STEEP = 0.33333  # of f, where Finnie has 1/3
ORDER = 1.0
NAN = float("nan")
PAPER, FINNIE = "paper, Eqs 30-36", "Finnie 1960, k m v² f(α)"
CONSTANT = "the same with a constant duration"
INTEGRAL, QUADRATURE = "LIGGGHTS's integral", "LIGGGHTS's integral, by quadrature"


class Laws:
    """What one impact removes by each law that needs no engine, in m3; speeds in m/s, angles in degrees."""

    def __init__(self, case: Case) -> None:
        setup = build_setup(case)
        self.model, state = setup.model, setup.state
        self.diameter, self.modulus = float(state.diameter[0]), float(state.modulus[0])
        self.mass = float(state.mass[0])
        self.damping_ratio = damping_ratio(self.model.restitution)
        self.coefficient = 1.0 / (4.0 * self.model.yield_stress)  # Finnie's 1/(p psi K), with psi = K = 2

    def paper(self, speed: float, angle: float, **model: Any) -> float:
        """By the paper, with fields of the model replaced: the cap of Eqs. 34-36 under the load of Eq. 30."""
        return float(self._ledger_row(speed, angle, **model)[REMOVED_VOLUME])

    def hertz_duration(self, speed: float, angle: float) -> float:
        """Duration of the impact, s."""
        return float(self._ledger_row(speed, angle)[DURATION])

    def finnie(self, speed: float, angle: float) -> float:
        """By Finnie's law of 1960, from speed and angle at impact."""
        return finnie_impact(self.mass, speed, np.deg2rad(angle), self.coefficient)

    def integral(self, speed: float, angle: float) -> float:
        """By LIGGGHTS's law in the limit of small steps, in closed form."""
        return finnie_contact(self.mass, speed, np.deg2rad(angle), self.coefficient, LIGGGHTS_STEEP)

    def quadrature(self, speed: float, angle: float) -> float:
        """The same by quadrature over a contact with spring and dashpot."""
        return finnie_contact_quadrature(
            self.mass, speed, np.deg2rad(angle), self.coefficient, self.damping_ratio, LIGGGHTS_STEEP
        )

    def excess(self, speed: float, angle: float, steps: int) -> float:
        """What LIGGGHTS's sum over so many steps per contact exceeds it by, to first order, by quadrature."""
        a = np.deg2rad(angle)
        return finnie_contact_excess(
            self.mass, speed, a, self.coefficient, steps, self.damping_ratio, LIGGGHTS_STEEP
        )

    @property
    def of_all(self) -> tuple[Callable[[float, float], float], ...]:
        """The paper's, Finnie's, and LIGGGHTS's integral."""
        return self.paper, self.finnie, self.integral

    def impact(self, speed: float, angle: float, steps: int) -> Impact:
        """The same impact for LIGGGHTS."""
        density = self.mass / (np.pi / 6 * self.diameter**3)
        return Impact(
            speed, angle, self.coefficient, steps, self.model.restitution,
            diameter=self.diameter, density=density,
        )  # fmt: skip

    def _ledger_row(self, speed: float, angle: float, **model: Any) -> np.ndarray:
        row, a = empty_ledger(1)[0], np.deg2rad(angle)
        velocity = speed * np.array([np.cos(a), 0.0, -np.sin(a)])
        position, hit = np.array([0.0, 0.0, 0.5 * self.diameter]), (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        record_surface_impact(
            self.model._replace(**model), 0.0, 0.0, 0, hit, position, velocity, self.mass, self.diameter,
            self.modulus, row,
        )  # fmt: skip
        return row


class Worn(NamedTuple):
    """What LIGGGHTS wears off at each number of steps per contact, and what that tends to; volumes in m3."""

    values: tuple[float, ...]  # coarsest first
    limit: Extrapolation
    verdict: Agreement  # on the limit and the integral

    @property
    def finest(self) -> float:
        """The volume at most steps per contact."""
        return self.values[-1]


def study(profile: str, runs: Path) -> StudyResult:
    """Removed volume of single impacts by angle and by speed, by four laws."""
    (case,) = changed(load_case(CASE).variants()[0], material=COPPER).variants()
    laws = Laws(case)
    angles, speeds, steps = ANGLES[profile], SPEEDS[profile], STEPS[profile]
    threshold = float(np.rad2deg(np.arcsin(laws.model.threshold_velocity / SPEED)))
    zeros = {
        "head-on": (SPEED, 90.0),
        "grazing, just below the paper's threshold": (SPEED, threshold * (1 - 1e-9)),
        "grazing, just above it": (SPEED, threshold * (1 + 1e-9)),
    }
    impacts = [(SPEED, float(a)) for a in angles] + [(v, SPEED_ANGLE) for v in speeds] + [*zeros.values()]
    found, reason = available()
    worn = _run(laws, impacts, steps) if found else {}
    fits = exponents(laws, speeds, worn)
    absent = "" if found else f" LIGGGHTS was not tested: {reason}."
    return StudyResult(
        name="wear",
        title="Finnie's wear beside the paper's removal",
        varied="Impact angle, from the wall, and speed. A rigid sphere without friction strikes a flat wall; "
        f"k_finnie = 1/(4 σ_y) = {number(laws.coefficient, 3)} 1/Pa is Finnie's constant for a flow stress "
        "σ_y, a factor on all his volumes that a fit would change. LIGGGHTS adds up 2 k f(γ) |v| |F| Δt "
        "while the sphere approaches, with speed v, angle γ and force F of each step; the integral that this "
        "tends to is found by quadrature and in closed form. Its finest three levels of "
        f"{steps[0]} to {steps[-1]} steps per contact give order and limit; near 90° the angle turns within "
        "the last steps of the approach, and the order shows only at smaller ones.",
        samples=f"Single impacts of the sphere of {CASE} on copper (σ_y = 0.3 GPa), no random numbers.",
        tables=(
            _by_angle(laws, angles, worn), _levels(laws, angles, steps, worn),
            _by_speed(laws, speeds, worn), _exponents(fits), _zeros(laws, zeros, worn),
        ),
        sentence=_sentence(laws, angles, fits, threshold, worn) + absent,
        charts=_charts(laws, angles, speeds, worn),
    )  # fmt: skip


def _run(
    laws: Laws, impacts: Sequence[tuple[float, float]], steps: Sequence[int]
) -> dict[tuple[float, float], Worn]:
    """What LIGGGHTS finds, by speed and angle."""
    deck = FinnieDeck()
    try:
        values = {
            impact: tuple(float(deck.removed(laws.impact(*impact, n)).sum()) for n in steps)
            for impact in impacts
        }
    finally:
        deck.close()
    return {impact: judged(laws, impact, steps, volumes) for impact, volumes in values.items()}


def judged(laws: Laws, impact: tuple[float, float], steps: Sequence[int], volumes: Sequence[float]) -> Worn:
    """The limit of volumes at several numbers of steps, against the integral by quadrature.

    Head-on the integral is zero: there the scale is its maximum over the angle at that speed.
    """
    speed, angle = impact
    largest = max(laws.integral(speed, a) for a in FINE)
    target = laws.quadrature(*impact)
    limit = extrapolate(
        [1.0 / n for n in steps], volumes, ORDER, errors=[PRINTED * v for v in volumes],
        scale=largest if angle == 90.0 else None,
    )  # fmt: skip
    scale = largest if angle == 90.0 else target
    reference = exact(target, largest, "quadrature")
    return Worn(tuple(volumes), limit, agreement(reference, limit, scale))


def exponents(
    laws: Laws, speeds: Sequence[float], worn: dict[tuple[float, float], Worn]
) -> dict[tuple[str, str], tuple[Estimate, float, float]]:
    """Exponents with the errors of their fits, and the range fitted, by law and by what it is a power of."""
    removing = [v for v in speeds if laws.paper(v, SPEED_ANGLE) > 0.0]
    constant = laws.hertz_duration(SPEED, SPEED_ANGLE)
    by_speed = {
        PAPER: (removing, [laws.paper(v, SPEED_ANGLE) for v in removing]),
        CONSTANT: (
            removing,
            [laws.paper(v, SPEED_ANGLE, impact_duration=constant) for v in removing],
        ),
        FINNIE: (speeds, [laws.finnie(v, SPEED_ANGLE) for v in speeds]),
        INTEGRAL: (speeds, [laws.integral(v, SPEED_ANGLE) for v in speeds]),
    }
    if worn:
        by_speed["LIGGGHTS, finest steps"] = (speeds, [worn[v, SPEED_ANGLE].finest for v in speeds])
    fits = {(law, "v"): (_slope(*values), *_ends(values[0])) for law, values in by_speed.items()}
    for law, volume in ((FINNIE, laws.finnie), (INTEGRAL, laws.integral)):
        fits[law, "α, grazing"] = (_slope(GRAZING, [volume(SPEED, a) for a in GRAZING]), *_ends(GRAZING))
    return fits


def _slope(x: Sequence[float] | np.ndarray, y: Sequence[float]) -> Estimate:
    (slope, _), covariance = np.polyfit(np.log(x), np.log(y), 1, cov=True)
    return Estimate(round(float(slope), 9), round(float(np.sqrt(covariance[0, 0])), 9))  # beyond is rounding


def _ends(x: Sequence[float] | np.ndarray) -> tuple[float, float]:
    return float(min(x)), float(max(x))


def _by_angle(laws: Laws, angles: Sequence[float], worn: dict[tuple[float, float], Worn]) -> Table:
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


def _levels(
    laws: Laws, angles: Sequence[float], steps: Sequence[int], worn: dict[tuple[float, float], Worn]
) -> Table:
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


def _by_speed(laws: Laws, speeds: Sequence[float], worn: dict[tuple[float, float], Worn]) -> Table:
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


def _exponents(fits: dict[tuple[str, str], tuple[Estimate, float, float]]) -> Table:
    return Table(
        f"Exponents, ± standard error of the fit: of v at {SPEED_ANGLE:g}° where the law removes (m/s), "
        "of α at grazing incidence (degrees)",
        (Column("law"), Column("in"), Column("exponent"), Column("from"), Column("to")),
        tuple((law, of, *fit) for (law, of), fit in fits.items()),
    )


def _zeros(laws: Laws, zeros: dict[str, tuple[float, float]], worn: dict[tuple[float, float], Worn]) -> Table:
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


def _charts(
    laws: Laws, angles: Sequence[float], speeds: Sequence[float], worn: dict[tuple[float, float], Worn]
) -> tuple[Chart, Chart]:
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


def _sentence(
    laws: Laws, angles: Sequence[float], fits: dict[tuple[str, str], tuple[Estimate, float, float]],
    threshold: float, worn: dict[tuple[float, float], Worn],
) -> str:  # fmt: skip
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
