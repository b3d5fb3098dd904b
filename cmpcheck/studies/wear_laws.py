"""What one impact on a flat wall wears off: the paper's law, Finnie's, LIGGGHTS's, and their comparison.

The laws need no engine; the volumes that LIGGGHTS finds are handed in, and judged against the integral that
its sum stands for.  Which impacts are made is `wear.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from cmpcheck.convergence import Agreement, Extrapolation, agreement, exact, extrapolate
from cmpcheck.engines.liggghts_wear import PRINTED, Impact
from cmpcheck.fixes.calibration import damping_ratio
from cmpcheck.results import Estimate
from reference.case import Case
from reference.collisions import record_surface_impact
from reference.exact import (
    finnie_contact,
    finnie_contact_excess,
    finnie_contact_quadrature,
    finnie_impact,
)
from reference.ledger import DURATION, REMOVED_VOLUME, empty_ledger
from reference.process import build_setup

SPEED, SPEED_ANGLE = 1.0, 45.0  # m/s of the impacts by angle, degrees of those by speed
FINE = np.linspace(0.25, 90.0, 360)  # degrees, of the curves
GRAZING = np.array([0.05, 0.1, 0.2])  # degrees, where the exponents in the angle are taken
LIGGGHTS_STEEP = 0.33333  # of f, where Finnie has 1/3
ORDER = 1.0
PAPER, FINNIE = "paper, Eqs 30-36", "Finnie 1960, k m v² f(α)"
CONSTANT = "the same with a constant duration"
INTEGRAL = "LIGGGHTS's integral"


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
