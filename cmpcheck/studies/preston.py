"""Preston's law: how the removal rate depends on the pad's speed, the number of abrasives and the load.

The law is the paper's Eq. (1), MRR = K_e P V; which exponents the model has is measured here.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cmpcheck.results import Chart, Column, Curve, Estimate, StudyResult, Table
from cmpcheck.studies.sampling import (
    Power,
    changed,
    estimate,
    held,
    power,
    powers,
    sample_rows,
    samples_of,
)
from reference import simulate
from reference.case import Case, load_case

CASE = "polish_pair"
SAMPLES = {"quick": 4, "full": 12}
SPEED, COUNT, HEIGHT = 1.0, 20, 1.2e-6  # V_pad in m/s, N and H in m where the others are varied
SPEEDS = (0.5, 1.0, 2.0, 4.0)
COUNTS = (10, 14, 20, 28, 40)
HEIGHTS = (1.25e-6, 1.2e-6, 1.1e-6, 1.0e-6)  # the lowest is asperity and radius
WAY = 30e-6  # V_pad T, m: enough for most samples
DOUBLINGS = 4  # of the duration, for the others
MATCHED = 0.85  # Pi until which the rate is taken
NUMERICS = {"time_step": 1e-9}  # the same at all V_pad: gamma would make it go as 1/V_pad
DECIDES = 0.25  # a wider interval shows no law
RATES = {"volume_rate": "volume rate", "depth_rate": "depth rate"}


def study(profile: str, runs: Path) -> StudyResult:
    """Exponents of the removal rate in V_pad, N and the pad's load, against those of Eq. (1)."""
    (case,) = load_case(CASE).variants()
    n = SAMPLES[profile]
    settings = list(
        dict.fromkeys(
            [(v, COUNT, HEIGHT) for v in SPEEDS]
            + [(SPEED, count, HEIGHT) for count in COUNTS]
            + [(SPEED, COUNT, h) for h in HEIGHTS]
        )
    )
    found = {s: sample_rows(_setting(case, *s), n, rate_at_equal_flatness) for s in settings}
    fits = exponents(found)
    rows: list[tuple[float | Estimate, ...]] = [
        (v, float(count), h, float(n), *(estimate(frame[q]) for q in ("load", *RATES, "way")))
        for (v, count, h), frame in found.items()
    ]
    return StudyResult(
        name="preston",
        title="Preston's law",
        varied="V_pad, N and, by the height H at which the pad is held, its load, one at a time from "
        f"{SPEED:g} m/s, {COUNT}, {HEIGHT * 1e6:g} µm. The surface wears (A as in the case), and each rate "
        f"is what was removed until Π = {MATCHED:g} by the time that it took, so that all rates belong to "
        "equally worn surfaces; on a frozen one abrasives stay wedged under the pad, and no state is "
        "stationary. The pad is led, not loaded: its load P is the sum of its impulses by time and area. "
        f"Steps of {1e9 * NUMERICS['time_step']:g} ns in all rows: at equal γ they would go as 1/V_pad.",
        samples=samples_of(case, n),
        tables=(
            Table(
                "Rates and loads, ± standard error",
                (Column("V_pad", "m/s"), Column("N"), Column("H", "m"), Column("seeds"),
                 Column("load P", "Pa"), Column("volume rate", "m3/s"), Column("depth rate", "m/s"),
                 Column("way V t", "m")),
                tuple(rows),
            ),
            Table(
                "Exponents, ± standard error, with their 95 % intervals",
                (Column("of"), Column("in"), Column("varied"), Column("exponent"), Column("from"),
                 Column("to"), Column("Preston's law")),
                tuple(
                    (of, within, varied, fit.exponent, *fit.interval, law)
                    for (of, within, varied), (fit, law) in fits.items()
                ),
            ),
        ),
        sentence=_sentence(fits),
        charts=_charts(found),
    )  # fmt: skip


def rate_at_equal_flatness(case: Case) -> pd.Series:
    """Removal until Pi has fallen to 0.85, per time: caps (m3/s) and node depths (m/s); mean pad load (Pa).

    The load is the sum of the pad's impulses by time and area.  A run that is too short is repeated with
    twice its duration.
    Raises ValueError where four doublings are not enough.
    """
    assert case.pad is not None
    for k in range(DOUBLINGS + 1):
        duration = 2**k * case.case.duration
        outputs = 2**k * (case.case.outputs - 1) + 1
        history = simulate(changed(case, case={"duration": duration, "outputs": outputs})).history
        below = np.flatnonzero(history.flatness.to_numpy() <= MATCHED)
        if below.size:
            break
    else:
        raise ValueError(f"Π = {MATCHED:g} is not reached in {duration:g} s, seed {case.case.seed}")
    before, after = history.iloc[int(below[0]) - 1], history.iloc[int(below[0])]
    part = (before.flatness - MATCHED) / (before.flatness - after.flatness)
    row = before + part * (after - before)
    return pd.Series(
        {
            "load": -row.pad_impulse_z / (row.time * case.surface.size**2),
            "volume_rate": row.removed_volume / row.time,
            "depth_rate": row.depth_sum / row.time,
            "way": case.pad.speed * row.time,
        }
    )


def exponents(
    found: Mapping[tuple[float, int, float], pd.DataFrame],
) -> dict[tuple[str, str, str], tuple[Power, float]]:
    """Fits with Preston's exponents beside them (NaN where the law has none), by (of, in, varied).

    The loads that the rates are fitted against are means over the samples, so that their scatter, which is
    that of the rates too, does not bias the exponents.
    """
    nan = float("nan")
    by_speed, by_count, by_height = (
        [(s, frame) for s, frame in found.items() if all(s[j] == base for j, base in others)]
        for others in (
            [(1, COUNT), (2, HEIGHT)], [(0, SPEED), (2, HEIGHT)], [(0, SPEED), (1, COUNT)]
        )
    )  # fmt: skip
    fits: dict[tuple[str, str, str], tuple[Power, float]] = {}

    def values(level: list[tuple[Any, pd.DataFrame]], quantity: str) -> np.ndarray:
        return np.array([frame[quantity] for _, frame in level])

    for quantity, name in {"load": "load", **RATES}.items():
        fits[name, "V_pad", "V_pad"] = (
            power([s[0] for s, _ in by_speed], values(by_speed, quantity)), nan,
        )  # fmt: skip
        fits[name, "N", "N"] = power([s[1] for s, _ in by_count], values(by_count, quantity)), nan
    both = by_speed + [entry for entry in by_height if entry[0][2] != HEIGHT]
    for quantity, name in RATES.items():
        load = values(by_height, "load").mean(axis=1)
        fits[name, "P", "H"] = power(load, values(by_height, quantity)), 1.0
        loads, speeds = values(both, "load").mean(axis=1), [s[0] for s, _ in both]
        of_load, of_speed = powers([loads, speeds], values(both, quantity))
        fits[name, "P at equal V_pad", "V_pad and H"] = of_load, 1.0
        fits[name, "V_pad at equal P", "V_pad and H"] = of_speed, 1.0
        fits[name, "P V_pad", "V_pad and H"] = power(loads * np.array(speeds), values(both, quantity)), 1.0
    return fits


def _setting(case: Case, speed: float, count: int, height: float) -> Case:
    sections: dict[str, dict[str, Any]] = {
        "case": {"duration": WAY / speed, "outputs": 151},
        "particles": {"count": count},
        "pad": {"speed": speed},
        "numerics": NUMERICS,
    }
    return held(case, height, **sections)


def _sentence(fits: Mapping[tuple[str, str, str], tuple[Power, float]]) -> str:
    texts = []
    for name in RATES.values():
        load = fits[name, "P at equal V_pad", "V_pad and H"][0]
        speed = fits[name, "V_pad at equal P", "V_pad and H"][0]
        count = fits[name, "N", "N"][0]
        texts.append(
            f"the {name} goes as P^({load.text()}) V_pad^({speed.text()}) and as N^({count.text()}), so "
            f"that Preston's law, P^1 V^1, {_standing((load, speed))} for it"
        )
    load = fits["load", "V_pad", "V_pad"][0]
    return (
        f"At equal flatness {'; '.join(texts)} (95 % intervals). Under a pad that is held the load itself "
        f"goes as V_pad^({load.text()})."
    )


def _standing(fits: tuple[Power, ...]) -> str:
    """What the intervals of exponents that ought to be 1 say."""
    if not all(fit.holds(1.0) for fit in fits):
        return "does not hold"
    wide = any(fit.half_width > DECIDES for fit in fits)
    return "is neither shown nor excluded" if wide else f"holds within {DECIDES:g}"


def _charts(found: Mapping[tuple[float, int, float], pd.DataFrame]) -> tuple[Chart, ...]:
    groups = {
        "V_pad varied": [(v, COUNT, HEIGHT) for v in SPEEDS],
        "H varied": [(SPEED, COUNT, h) for h in HEIGHTS],
        "N varied": [(SPEED, count, HEIGHT) for count in COUNTS],
    }
    charts = []
    for quantity, name in RATES.items():
        curves = []
        for label, settings in groups.items():
            means = [estimate(found[s][quantity]) for s in settings]
            x = tuple(float(found[s]["load"].mean()) * s[0] for s in settings)
            curves.append(
                Curve(
                    label, x, tuple(m.value for m in means),
                    tuple(m.value - m.standard_error for m in means),
                    tuple(m.value + m.standard_error for m in means), "points",
                )
            )  # fmt: skip
        middle = float(found[SPEED, COUNT, HEIGHT]["load"].mean()) * SPEED
        height = float(found[SPEED, COUNT, HEIGHT][quantity].mean())
        ends = [f(value for c in curves for value in c.x) for f in (min, max)]
        line = Curve("∝ P V_pad", tuple(ends), tuple(height * end / middle for end in ends))
        unit = {"volume_rate": "m3/s", "depth_rate": "m/s"}[quantity]
        charts.append(
            Chart(
                f"{name.capitalize()} at equal flatness against load times speed, ± standard error",
                Column("P V_pad", "W/m2"), Column(name, unit), (*curves, line), logarithmic=True,
            )
        )  # fmt: skip
    return tuple(charts)
