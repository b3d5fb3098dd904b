"""A made-up `SuiteResult` with everything the report must cope with; no test lives here.

Three cases, three engines (one absent), all statuses, a known departure, orders that are observed by
construction, curves, impacts, exact values, non-finite numbers and hostile names.
"""

from __future__ import annotations

import math

import numpy as np

from cmpcheck.results import CaseResult, Comparison, Convergence, EngineInfo, SuiteResult, Trace

HOSTILE = "<script>alert(1)</script>"
ROUNDING = "8 roundings of a product: 8 eps |J|"
DISCRETISATION = "grid convergence index over t_c, t_c/2, t_c/4, safety factor 1.25, plus the reference's own"


def comparison(**changes: object) -> Comparison:
    """One row that agrees, with any field replaced."""
    row: dict = {
        "case": "pair_head_on", "variant": "", "engine": "lammps", "quantity": "normal_impulse",
        "equations": "9, 12", "unit": "N s", "reference": 1.5e-15, "measured": 1.5003e-15, "error": 3e-19,
        "tolerance": 1e-18, "kind": "discretisation", "reason": DISCRETISATION, "status": "agree",
    }  # fmt: skip
    return Comparison(**(row | changes))


def suite(rows: list[Comparison] | None = None, absent: bool = False) -> SuiteResult:
    """The smallest run: one case with the given rows, the reference and LAMMPS, LIGGGHTS only if absent."""
    engines = [EngineInfo("reference", "0.1.0", True), EngineInfo("lammps", "22 Jul 2025 update 4", True)]
    if absent:
        engines.append(EngineInfo("liggghts", "", False, "not found; install with: apt install liggghts"))
    rows = [comparison()] if rows is None else rows
    case = CaseResult("pair_head_on", "Two spheres head on", "They bounce (Eq. 9).", "9, 12", rows)
    return SuiteResult("quick", engines, [case], {}, 1.0)


def converging(
    engine: str, variant: str, quantity: str, unit: str, target: float, order: float
) -> Convergence:
    """Values that approach the target at the given order, or sit on it where the order is 0."""
    parameter = "time step" if engine == "reference" else "contact duration"
    levels = tuple((4e-9 if engine == "reference" else 4e-8) / 2**k for k in range(4))
    size = 0.03 if order else 2e-16
    values = tuple(target * (1 + size * (level / levels[0]) ** order) for level in levels)
    spreads = tuple(abs(value - target) * 0.3 for value in values)
    limit = target * (1 + 1e-5 * bool(order))
    return Convergence("", variant, engine, quantity, unit, parameter, levels, values, spreads, limit,
                       abs(target) * 1e-4, order or None, target)  # fmt: skip


def _pair_head_on() -> CaseResult:
    case = CaseResult(
        "pair_head_on",
        "Two unequal spheres meet head on",
        "Two spheres of unequal radius and density approach along their line of centres; Eq. 9 gives the "
        "impulse and Eqs. 3 and 4 the velocities after it.",
        "3-9, 12",
    )
    t = np.linspace(0, 4e-6, 401)
    for restitution in (0.2, 0.5, 0.8, 1.0):
        variant = f"e={restitution:g}"
        impulse = 1.3e-15 * (1 + restitution)
        for engine, shift in (("reference", 0.0), ("lammps", 2e-9)):
            after = -0.5 * restitution
            v = np.where(t < 2e-6 + shift, 0.5, after)
            case.traces.append(Trace("pair_head_on", variant, engine, "velocity x of particle 0", "m/s",
                                     tuple(t), tuple(v)))  # fmt: skip
            case.traces.append(Trace("pair_head_on", variant, engine, "normal impulse", "N s",
                                     (2e-6 + shift,), (impulse * (1 + shift * 1e5),), "points"))  # fmt: skip
        rows = (
            ("normal_impulse", "9, 12", "N s", impulse),
            ("restitution", "8", "1", restitution),
            ("velocity_x", "3, 4", "m/s", -0.5 * restitution),
            ("momentum", "12", "kg m/s", 0.0),
            ("energy_lost", "9", "J", 2e-16 * (1 - restitution**2)),
        )
        for k, (quantity, equations, unit, value) in enumerate(rows):
            size = abs(value) or 1e-15
            case.comparisons.append(
                comparison(variant=variant, engine="reference", quantity=quantity, equations=equations,
                           unit=unit, reference=value, measured=value * (1 + 1e-16 * k),
                           error=abs(value) * 1e-16 * k, tolerance=8 * 2.2e-16 * size, kind="rounding",
                           reason=ROUNDING))  # fmt: skip
            error = size * 3e-4 * (k + 1) / 5
            case.comparisons.append(
                comparison(variant=variant, quantity=quantity, equations=equations, unit=unit,
                           reference=value, measured=value + error, error=error, tolerance=size * 6e-4,
                           order=0.98 + 0.02 * k))  # fmt: skip
        case.convergences += [
            converging("reference", variant, "normal_impulse", "N s", impulse, 0.0),
            converging("lammps", variant, "normal_impulse", "N s", impulse, 0.9 + restitution / 5),
            converging("lammps", variant, "restitution", "1", restitution, 1.0),
        ]
    return case


def _wall_bounce() -> CaseResult:
    case = CaseResult(
        "wall_bounce",
        "A sphere strikes a soft flat wall and picks material up",
        "A sphere falls normally on a flat wall that yields; Eqs. 29-31 give rebound and load, Eqs. 34-36 "
        "the removed cap.",
        "29-36",
        notes=[
            "Removal in LAMMPS calls the reference's kernels; it is judged against quadrature of the cap."
        ],
    )
    t = np.linspace(0, 1e-5, 1001)
    for engine, scale in (("reference", 1.0), ("lammps", 1.0004)):
        height = 4e-7 + np.abs(2e-6 - 0.5 * t * scale) * np.where(t < 4e-6, 1, 0.5)
        case.traces.append(
            Trace("wall_bounce", "", engine, "height of particle 0", "m", tuple(t), tuple(height))
        )
        case.traces.append(Trace("wall_bounce", "", engine, "normal impulse", "N s", (4e-6, 6e-6, 8e-6),
                                 (2e-15 * scale, 5e-16 * scale, 1e-16), "points"))  # fmt: skip
        case.traces.append(Trace("wall_bounce", "", engine, "removed volume", "m3", tuple(t),
                                 tuple(np.where(t < 4e-6, 0, 3e-20 * scale))))  # fmt: skip
    row = {"case": "wall_bounce", "equations": "34-36"}
    case.comparisons = [
        comparison(**row, engine="reference", quantity="removed_volume", unit="m3", reference=3.1e-20,
                   measured=3.1e-20, error=0.0, tolerance=1e-34, kind="rounding", reason=ROUNDING),
        comparison(**row, engine="reference", quantity="velocity_z", unit="m/s", reference=0.25,
                   measured=0.2501, error=1e-4, tolerance=3e-4, kind="discretisation", order=1.01),
        comparison(**row, quantity="removed_volume", unit="m3", reference=3.1e-20, measured=3.4e-20,
                   error=3e-21, tolerance=2e-22, status="disagree"),
        comparison(**row, quantity="friction_impulse", reference=1e-16, measured=0.0, error=1e-16,
                   tolerance=1e-19, status="disagree",
                   known_departure="legacy-wall-friction: hooke/history walls lose their friction"),
        comparison(**row, quantity="removed_mass", unit="kg", reference=2.8e-16, measured=math.nan,
                   error=math.nan, tolerance=math.nan, status="error", kind="precision",
                   reason="the run stopped: particle 3 is not finite at 4.2 us"),
        comparison(**row, quantity="indentation_depth", unit="m", reference=2.4e-9, measured=2.41e-9,
                   error=1e-11, tolerance=math.inf, status="not_tested",
                   reason="too uncertain: 4 % of the depth; halving t_c once more would narrow it"),
        comparison(**row, quantity="mass_balance", unit="1", reference=0.0, measured=2e-17, error=2e-17,
                   tolerance=0.0, status="disagree"),
    ]  # fmt: skip
    case.convergences = [
        converging("reference", "", "velocity_z", "m/s", 0.25, 1.0),
        converging("lammps", "", "removed_volume", "m3", 3.1e-20, 1.1),
        converging("lammps", "", "mass_balance", "1", 0.0, 0.0),
    ]
    return case


def _hostile() -> CaseResult:
    case = CaseResult(
        f"deck {HOSTILE} | a\nb",
        f'Title {HOSTILE} "quoted" & $\\frac{{1}} | pipe',
        f"A sentence with {HOSTILE}, [a link](javascript:alert(1)) and *stars*.",
        "</td>",
        notes=[f"note {HOSTILE}"],
    )
    t = tuple(np.linspace(0, 1e-3, 5000))
    grown = tuple(1e-15 * np.exp(np.linspace(0, 20, 5000)))
    case.traces = [Trace(case.name, "", "lammps", "distance to the reference", "m", t, grown)]
    case.traces += [
        Trace(case.name, f"_{HOSTILE}$x$", engine, f"label {HOSTILE}$", "m", t[:3], (1.0, math.nan, 2.0))
        for engine in ("reference", f"lammps{HOSTILE}")
    ]
    case.comparisons = [
        comparison(case=case.name, variant=HOSTILE + "\x00\x1b[31m", quantity="trajectory_distance", unit="m",
                   reason=f"{HOSTILE} ]]> | \u202e", equations=HOSTILE, reference=0.0, measured=1e-9,
                   error=1e-9, tolerance=2e-9),
        comparison(case=case.name, engine=f"lammps{HOSTILE}", quantity=HOSTILE, unit=HOSTILE,
                   status="not_tested", reason=f"inconclusive, n = 12 {HOSTILE}", kind="statistical"),
    ]  # fmt: skip
    return case


def example() -> SuiteResult:
    """The whole example."""
    return SuiteResult(
        "quick",
        [
            EngineInfo("reference", "0.1.0", True),
            EngineInfo("lammps", "22 Jul 2025 update 4", True),
            EngineInfo("liggghts", "", False, "not found; install with: apt install liggghts"),
        ],
        [_pair_head_on(), _wall_bounce(), _hostile()],
        {
            "python": "3.11.2",
            "packages": {"numpy": "2.4.6", "lammps": "2025.7.22.4"},
            "seed": 0,
            "odd": math.nan,
        },
        141.3,
    )
