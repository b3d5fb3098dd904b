"""Where two runs of the same start part: in the order of partners, or impact by impact in time.

What follows from it for a swarm is `horizon.py`; polishing runs part early, and are compared by
`ensembles.py`.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from cmpcheck.engines.protocol import Engine, Resolution
from cmpcheck.results import KindMatch, LedgerMatch, PartingImpact
from reference.heightfield import Heightfield
from reference.process import flow_speed, relaxation_time
from reference.recording import Run
from reference.state import DEPOSIT_NODE_DEPTH, Setup

NEIGHBOUR = 1.1  # of R_i + R_j: centres nearer than that are neighbours
DRAG_SHARE = 0.1  # of tau: within it drag changes a slip by less than that share


@dataclass(frozen=True)
class Parting:
    """The first contact that one of two runs has and the other has not."""

    time: float  # s; infinity if the runs never part
    i: int = -1
    j: int = -1


def first_parting(one: Run, other: Run) -> Parting:
    """When the partners that any particle meets, in its own order, begin to differ.

    Contacts far apart may swap their order in time; what each particle meets may not.
    """
    sequences = [_partners(run.contacts) for run in (one, other)]
    parting = Parting(math.inf)
    for particle in sorted(sequences[0].keys() | sequences[1].keys()):
        a, b = (sequence.get(particle, []) for sequence in sequences)
        for k in range(max(len(a), len(b))):
            if k < min(len(a), len(b)) and a[k][1] == b[k][1]:
                continue
            time, partner = min(sequence[k] for sequence in (a, b) if k < len(sequence))
            if time < parting.time:
                parting = Parting(time, particle, partner)
            break
    return parting


def _partners(contacts: pd.DataFrame) -> dict[int, list[tuple[float, int]]]:
    met: dict[int, list[tuple[float, int]]] = defaultdict(list)
    for time, i, j in sorted(contacts[["time", "i", "j"]].itertuples(index=False)):
        met[i].append((time, j))
        met[j].append((time, i))
    return met


def match_impacts(one: pd.DataFrame, other: pd.DataFrame, window: float) -> np.ndarray:
    """Rows of two contact ledgers that are the same impact, (K, 2) of row numbers, in the order of time.

    The same kind and particles, and each the nearest of the other in time, within `window` (s).
    """
    a, b = (_keyed(contacts) for contacts in (one, other))
    forward, backward = _nearest(a, b, window), _nearest(b, a, window)
    mutual = forward.merge(backward, left_on=["row", "partner"], right_on=["partner", "row"])
    return mutual[["row_x", "partner_x"]].to_numpy(np.int64).reshape(-1, 2)


def _keyed(contacts: pd.DataFrame) -> pd.DataFrame:
    """Time, what identifies an impact (a pair in either order), and the row number."""
    low, high = (f(contacts["i"], contacts["j"]) for f in (np.minimum, np.maximum))
    table = pd.DataFrame(
        {
            "time": contacts["time"].to_numpy(float),
            "kind": contacts["kind"].to_numpy(str),
            "low": low.to_numpy(np.int64),
            "high": high.to_numpy(np.int64),
            "row": np.arange(len(contacts)),
        }
    )
    return table.sort_values("time", kind="stable")


def _nearest(a: pd.DataFrame, b: pd.DataFrame, window: float) -> pd.DataFrame:
    """For every row of a the nearest of b: columns row and partner."""
    found = pd.merge_asof(
        a, b.rename(columns={"row": "partner"}), on="time", by=["kind", "low", "high"],
        direction="nearest", tolerance=window,
    ).dropna(subset="partner")  # fmt: skip
    return found[["row", "partner"]].astype(np.int64)


def lateness(reference: Resolution, other: Resolution) -> float:
    """How much later than it should an impact may act, s: one step of each engine and one soft contact."""
    return reference.time_step + other.time_step + other.contact_duration


def explained_speed(setup: Setup, late: float) -> float:
    """By how much an impact that is `late` (s) may change its approach speed, m/s.

    Meanwhile drag changes the velocity by at most U late/tau, and a motion of U late turns the normal of a
    sphere of radius R by U late/R: U late (1/tau + U/R), with tau and R of the smallest particle.
    """
    speed = flow_speed(setup)
    return speed * late * (1.0 / relaxation_time(setup) + speed / (0.5 * float(setup.state.diameter.min())))


def compare_impacts(
    ours: Run, theirs: Run, setup: Setup, engine: Engine, resolutions: tuple[Resolution, Resolution]
) -> LedgerMatch:
    """Match the impacts of one sample in the reference and another engine, and find where each kind parts.

    A kind parts at the first impact that one engine lacks, that differs in approach speed by more than late
    contacts explain, or that lowers another node of the surface.  An impact that one engine lacks counts as
    undecided when it is so near the speed from which impacts are recorded that the other may have had it
    below.

    Parameters: setup, from which both started; engine, the reference, which runs again up to each parting to
    show what is around; the resolutions of both.
    """
    late = lateness(*resolutions)
    explained, window = explained_speed(setup, late), late + DRAG_SHARE * relaxation_time(setup)
    touching = flow_speed(setup) * late

    def compare(kind: str) -> KindMatch:
        ledgers = [
            run.contacts[run.contacts["kind"] == kind].reset_index(drop=True) for run in (ours, theirs)
        ]
        matched = match_impacts(ledgers[0], ledgers[1], window)
        first, undecided = _first_to_part(ledgers, matched, setup, window, explained)
        before, found = len(matched), None
        if first is not None:
            time = np.minimum(*(t["time"].to_numpy()[matched[:, k]] for k, t in enumerate(ledgers)))
            before = int((time < first[0]).sum())
            impacts = [t.loc[r] if r >= 0 else None for t, r in zip(ledgers, first[1:], strict=True)]
            found = _describe(impacts, (ours, theirs), setup, engine, resolutions, touching)
        return KindMatch(kind, (len(ledgers[0]), len(ledgers[1])), len(matched), before, undecided, found)

    matches = [compare(kind) for kind in ("surface", "pair", "pad")]
    return LedgerMatch(window, explained, touching, tuple(match for match in matches if any(match.impacts)))


def _first_to_part(
    ledgers: list[pd.DataFrame], matched: np.ndarray, setup: Setup, window: float, explained: float
) -> tuple[tuple[float, int, int] | None, int]:
    """Time and rows (-1: none) of the first impact that parts, and the number undecided before it."""
    times, speeds = ([t[name].to_numpy() for t in ledgers] for name in ("time", "approach_speed"))
    nodes = [lowered_nodes(t, setup) for t in ledgers]
    a, b = matched.T
    differs = (np.abs(speeds[0][a] - speeds[1][b]) > explained) | (nodes[0][a] != nodes[1][b])
    candidates: list[tuple[float, int, int]] = [
        (min(times[0][i], times[1][j]), int(i), int(j)) for i, j in matched[differs]
    ]
    doubtful: list[float] = []
    for k in (0, 1):
        alone = np.setdiff1d(np.arange(len(times[k])), matched[:, k])
        alone = alone[times[k][alone] < setup.end_time - window]  # its partner may come after the end
        weak = speeds[k][alone] <= setup.case.numerics.ledger_speed + explained
        doubtful += times[k][alone[weak]].tolist()
        candidates += [(times[k][r], *((int(r), -1) if k == 0 else (-1, int(r)))) for r in alone[~weak]]
    first = min(candidates, default=None)
    return first, sum(time < (math.inf if first is None else first[0]) for time in doubtful)


def lowered_nodes(contacts: pd.DataFrame, setup: Setup) -> np.ndarray:
    """The node that each impact lowers, numbered row by row; -1 where none is, or where volume is removed."""
    if setup.model.deposit != DEPOSIT_NODE_DEPTH:
        return np.full(len(contacts), -1)
    shape = setup.state.heights.shape
    i, j = (
        np.floor(contacts[name].to_numpy(float) / setup.model.spacing + 0.5).astype(np.int64) % n
        for name, n in zip("xy", shape, strict=True)
    )
    return np.where(contacts["removed_volume"].to_numpy() > 0.0, i * shape[1] + j, -1)


def _describe(
    impacts: list[pd.Series | None],
    runs: tuple[Run, Run],
    setup: Setup,
    engine: Engine,
    resolutions: tuple[Resolution, Resolution],
    touching: float,
) -> PartingImpact:
    """The impact in both engines, and what was around it, from a run of the reference up to then."""
    shown = min((x for x in impacts if x is not None), key=lambda impact: impact["time"])
    time, i, partner = float(shown["time"]), int(shown["i"]), int(shown["j"])
    position, surface, pad = _state_at(time, setup, engine, resolutions[0])
    here = [i] if partner < 0 else [i, partner]
    around = neighbours(setup, position, here)
    surface_gap = min(_surface_gap(surface, position[k], 0.5 * float(setup.state.diameter[k])) for k in here)
    pad_gap = min(pad - float(position[k, 2]) - 0.5 * float(setup.state.diameter[k]) for k in here)
    others = [gap for _, gap in around]
    others += [surface_gap] * (shown["kind"] != "surface")
    others += [pad_gap] * (shown["kind"] != "pad" and math.isfinite(pad_gap))
    return PartingImpact(
        time=time,
        particle=i,
        partner=partner,
        reference_speed=_value(impacts[0], "approach_speed"),
        measured_speed=_value(impacts[1], "approach_speed"),
        duration=float(shown["duration"]),
        contact_times=(_value(impacts[0], "contact_time"), _value(impacts[1], "contact_time")),
        neighbours=around,
        surface_gap=surface_gap,
        pad_gap=pad_gap,
        crowded=min(others, default=math.inf) <= touching
        or any(_struck_otherwise(run.contacts, shown, lateness(*resolutions)) for run in runs),
        nodes=(_node(impacts[0], setup), _node(impacts[1], setup)),
        apart=_apart(impacts, setup),
    )


def _struck_otherwise(contacts: pd.DataFrame, impact: pd.Series, late: float) -> bool:
    """Whether a particle of the impact has another one, with something else, within `late` (s) of it."""
    near = contacts[(contacts["time"] - impact["time"]).abs() <= late]
    particles = [impact["i"], impact["j"]] if impact["kind"] == "pair" else [impact["i"]]
    mine = near[near["i"].isin(particles) | (near["kind"].eq("pair") & near["j"].isin(particles))]
    same = mine["kind"].eq(impact["kind"])
    if impact["kind"] == "pair":
        same &= mine["i"].isin(particles) & mine["j"].isin(particles)
    return not bool(same.all())


def _apart(impacts: list[pd.Series | None], setup: Setup) -> float:
    """Distance of the points of contact of an impact in two engines, m; nan if one lacks it."""
    one, other = impacts
    if one is None or other is None:
        return math.nan
    difference = np.array([float(other[name]) - float(one[name]) for name in "xyz"])
    for axis, period in enumerate((setup.model.length_x, setup.model.length_y)):
        difference[axis] -= period * round(difference[axis] / period)
    return float(np.linalg.norm(difference))


def _state_at(
    time: float, setup: Setup, engine: Engine, resolution: Resolution
) -> tuple[np.ndarray, Heightfield, float]:
    """Positions, surface and height of the pad at a time, m."""
    times = setup.output_times[setup.output_times < time]
    if not len(times):
        return (
            setup.state.position,
            Heightfield(setup.state.heights, setup.model.spacing),
            setup.state.pad_height,
        )
    run = engine.run(replace(setup, output_times=np.append(times, time), end_time=time), resolution)
    assert run.surface is not None
    return run.positions[-1], run.surface, float(run.history["pad_height"].iloc[-1])


def _surface_gap(surface: Heightfield, position: np.ndarray, radius: float) -> float:
    """From a sphere to the nearest point of the surface, m; negative for an overlap."""
    x, y, z = position
    found = surface.closest_point(position, 1.001 * abs(z - surface.height(x, y)))
    return found[1] - radius if found else math.nan


def neighbours(setup: Setup, position: np.ndarray, here: list[int]) -> tuple[tuple[int, float], ...]:
    """Other particles with centres within 1.1 (R_i + R_j) of some, and the gaps to them in m, nearest first.

    Parameters: position (N, 3) in m, in a box periodic along x and y; `here`, the numbers of the particles.
    """
    gaps: dict[int, float] = {}
    for i in here:
        apart = position - position[i]
        for axis, period in enumerate((setup.model.length_x, setup.model.length_y)):
            apart[:, axis] -= period * np.round(apart[:, axis] / period)
        contact = 0.5 * (setup.state.diameter + setup.state.diameter[i])
        gap = np.linalg.norm(apart, axis=1) - contact
        for k in np.flatnonzero(gap < (NEIGHBOUR - 1.0) * contact):
            gaps[int(k)] = min(float(gap[k]), gaps.get(int(k), math.inf))
    return tuple(sorted(((k, gap) for k, gap in gaps.items() if k not in here), key=lambda pair: pair[1]))


def _node(impact: pd.Series | None, setup: Setup) -> int:
    return -1 if impact is None else int(lowered_nodes(impact.to_frame().T, setup)[0])


def _value(impact: pd.Series | None, column: str) -> float:
    return math.nan if impact is None else float(impact[column])
