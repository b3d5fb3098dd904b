"""What a run conserves: momentum, energy, mass and volume, each closed to a bound on round-off.

Both sides of a balance are computed independently: one from the state, the other from what `timestep.py` has
booked of single contacts and of the drag.  The bounds of energy and momentum are running sums, derived at
`ROUNDINGS` there; the others are derived here.  Discretisation is no part of it: the sums are those of the
discrete scheme, and that they converge to the integrals over time is shown in tests.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from reference.case import Case
from reference.recording import SUMS, Run
from reference.state import DEPOSIT_NONE, DEPOSIT_VOLUME, Model

EPS = float(np.finfo(float).eps)
SIMULTANEOUS_SHARE = 0.01  # of the energy that contacts dissipate, from which on a run says so


@dataclass(frozen=True)
class Balance:
    """What one balance is short of, in SI."""

    name: str
    equation: str  # what has to vanish
    residual: float
    bound: float  # of its round-off
    unit: str

    @property
    def holds(self) -> bool:
        """Whether the residual is round-off; one that is not a number is not."""
        return abs(self.residual) <= self.bound


class Removing(NamedTuple):
    """How material leaves the surface."""

    by_volume: bool  # deposit `volume`, else `node_depth`
    acceleration: float  # A
    mass_pickup: bool
    density: float  # of the surface, kg/m3


def removing_of_case(case: Case) -> Removing | None:
    """As the case has it; None where nothing is removed."""
    if case.removal is None or case.surface.material is None:
        return None
    density = case.material[case.surface.material].density
    removal = case.removal
    return Removing(removal.deposit == "volume", removal.acceleration, removal.mass_pickup, density)


def removing_of_model(model: Model) -> Removing | None:
    """As the constants of a setup have it, which may differ from its case; None where nothing is removed."""
    if model.deposit == DEPOSIT_NONE:
        return None
    by_volume = model.deposit == DEPOSIT_VOLUME
    return Removing(by_volume, model.acceleration, model.mass_pickup, model.surface_density)


def balances(run: Run, removing: Removing | None = None) -> list[Balance]:
    """The balances of a run between its first and its last record; `removing` is by default its case's.

    They are energy and momentum_x, y, z, unless the stepper was the fast one; mass; removed_mass and volume
    where there is a removable surface.
    Runs of other engines do not record what they need: there the list is empty.
    """
    if not set(SUMS) <= set(run.history.columns) or run.history.empty:
        return []
    removing = removing or removing_of_case(run.case)
    first, last = run.history.iloc[0], run.history.iloc[-1]
    found = [_mass(run, last, removing)]
    if run.case.numerics.stepper == "plain":  # the fast one keeps no books of what the fluid gives
        found = [
            _energy(run, first, last),
            *(_momentum(run, first, last, axis) for axis in "xyz"),
            *found,
        ]
    if removing is not None and run.surface is not None:
        found += [_removed_mass(last, removing), _volume(run, last, removing)]
    return found


def violation(run: Run, removing: Removing | None = None) -> str:
    """One line that names a balance that does not hold, its residual and its bound; empty if all hold."""
    for balance in balances(run, removing):
        if not balance.holds:
            return (
                f"the balance of {balance.name} is off by {balance.residual:.3g} {balance.unit}, more than "
                f"its round-off of {balance.bound:.3g} {balance.unit}: {balance.equation} is not 0"
            )
    return ""


def close_books(run: Run, removing: Removing | None = None) -> str:
    """Record balances and remarks on them in the run's provenance; return the violation, if any.

    A run that violates a balance is marked as not complete; one that was cut short is left as it is.
    """
    if not run.provenance["complete"]:
        return ""
    run.provenance["balances"] = {
        balance.name: {"residual": balance.residual, "bound": balance.bound, "unit": balance.unit}
        for balance in balances(run, removing)
    }
    problem = violation(run, removing)
    remarks = [*_remarks(run), *([problem] if problem else [])]
    run.provenance["notes"] = [*run.provenance.get("notes", []), *remarks]
    if problem:
        run.provenance["complete"] = False
    return problem


def simultaneous_share(run: Run) -> float:
    """Part of the energy dissipated in contacts that depends on how simultaneous ones are joined.

    Impulses of simultaneous contacts are added; each by itself would dissipate contact_loss + pad_work.
    """
    last = run.history.iloc[-1]
    joined = float(last["simultaneous_loss"])
    dissipated = float(last["contact_loss"] + last["pad_work"]) + joined
    return abs(joined) / dissipated if dissipated > 0.0 else 0.0


def lowered_over_removed(run: Run) -> float:
    """Volume by which the surface fell over that of the removed caps times A; not a number without any.

    1 with deposit `volume`; with `node_depth` nodes fall by the depth of the cap, whatever its volume.
    """
    assert run.case.removal is not None
    caps = run.case.removal.acceleration * float(run.history["removed_volume"].iloc[-1])
    return _volume_lost(run) / caps if caps > 0.0 else math.nan


def _remarks(run: Run) -> list[str]:
    """What the balances tell a user about the run."""
    if not run.provenance["balances"]:
        return []
    remarks, share = [], simultaneous_share(run) if run.case.numerics.stepper == "plain" else 0.0
    if share > SIMULTANEOUS_SHARE:
        remarks.append(
            f"{share:.1%} of the energy dissipated in contacts is of particles with several contacts at "
            "once, whose outcome is not unique: their impulses are added"
        )
    node_depth = run.case.removal is not None and run.case.removal.deposit == "node_depth"
    if node_depth and math.isfinite(lowered_over_removed(run)):
        remarks.append(
            f"deposit node_depth lowers the surface by {lowered_over_removed(run):.3g} times the volume of "
            "the removed caps; the mass picked up is that of the caps"
        )
    return [*remarks, *_worn_through(run)]


def _worn_through(run: Run) -> list[str]:
    """A surface has no lowest height, as a wafer is thick; but flatness counts a pit as an asperity."""
    if run.surface is None or run.surface_initial is None:
        return []
    first, lowest = run.surface_initial.z, float(run.surface.z.min())
    asperities, base = float(np.ptp(first)), float(first.min())
    if not 0.0 < asperities < base - lowest:
        return []
    return [
        f"the surface is worn {base - lowest:.3g} m below its base plane, deeper than its asperities of "
        f"{asperities:.3g} m were high: flatness (Eq 44) counts such pits as it counts asperities"
    ]


def _energy(run: Run, first: pd.Series, last: pd.Series) -> Balance:
    change = last["kinetic_energy"] - first["kinetic_energy"]
    lost = last["contact_loss"] + last["simultaneous_loss"]
    sizes = last["kinetic_energy"] + first["kinetic_energy"] + abs(lost) + abs(last["fluid_work"])
    return Balance(
        "energy",
        "change of kinetic_energy - fluid_work + contact_loss + simultaneous_loss",
        float(change - last["fluid_work"] + lost),
        float(last["energy_rounding"] + _record_rounding(run) * sizes),
        "J",
    )


def _momentum(run: Run, first: pd.Series, last: pd.Series, axis: str) -> Balance:
    sources = [
        f"fluid_impulse_{axis}",
        f"surface_impulse_{axis}",
        *(["pad_impulse_z"] if axis == "z" else []),
    ]
    change = last[f"momentum_{axis}"] - first[f"momentum_{axis}"]
    sizes = float((run.masses[[0, -1], :] * np.abs(run.velocities[[0, -1]][..., "xyz".index(axis)])).sum())
    sizes += float(sum(abs(last[name]) for name in sources))
    return Balance(
        f"momentum_{axis}",
        " - ".join([f"change of momentum_{axis}", *sources]),
        float(change - sum(last[name] for name in sources)),
        float(last["momentum_rounding"] + _record_rounding(run) * sizes),
        "N s",
    )


def _record_rounding(run: Run) -> float:
    """Relative round-off of a row of the history: sums of N terms, and of five columns."""
    return EPS * (run.masses.shape[1] + 10)


def _mass(run: Run, last: pd.Series, removing: Removing | None) -> Balance:
    """Each of the removals rounds one mass by u m; the two sums and their difference round by (N + 2) eps."""
    carried = removing is not None and removing.mass_pickup
    picked_up = float(last["removed_mass"]) if carried else 0.0
    gained = math.fsum(run.masses[-1]) - math.fsum(run.masses[0])
    heaviest, total = float(run.masses[-1].max(initial=0.0)), float(run.masses[-1].sum())
    return Balance(
        "mass",
        "change of the particles' mass - removed_mass" if carried else "change of the particles' mass",
        gained - picked_up,
        EPS * (float(last["removals"]) * heaviest + 4.0 * total) if picked_up > 0.0 else 0.0,
        "kg",
    )


def _removed_mass(last: pd.Series, removing: Removing) -> Balance:
    """Each mass is a volume times the density, rounded once; both sums are compensated."""
    mass = float(last["removed_mass"])
    return Balance(
        "removed_mass",
        "removed_mass - density removed_volume",
        mass - removing.density * float(last["removed_volume"]),
        8.0 * EPS * mass,
        "kg",
    )


def _volume_lost(run: Run) -> float:
    """By how much the integral of z has fallen, in m3.

    A node's share of the area is h^2 everywhere: a third of the six triangles of h^2/2 that meet in it.
    """
    assert run.surface is not None
    assert run.surface_initial is not None
    return run.surface.spacing**2 * math.fsum((run.surface_initial.z - run.surface.z).ravel())


def _volume(run: Run, last: pd.Series, removing: Removing) -> Balance:
    """The surface against the sum of what impacts took off it; nothing else moves a node, no floor stops one.

    A removal rounds three heights with deposit `volume`, one with `node_depth`, by u z each; no |z| exceeds
    that of the first and of the last surface, as nodes only fall.  The amount of one removal is rounded some
    ten times, shared out with weights whose sum is off by 3 u; sums and differences round by as much again.
    """
    assert run.surface is not None
    assert run.surface_initial is not None
    area, by_volume = run.surface.spacing**2, removing.by_volume
    amount = float(last["removed_volume"]) if by_volume else area * float(last["depth_sum"])
    lost, taken = _volume_lost(run), removing.acceleration * amount
    highest = max(float(np.abs(surface.z).max()) for surface in (run.surface_initial, run.surface))
    lowerings = (3.0 if by_volume else 1.0) * float(last["removals"])
    return Balance(
        "volume",
        "volume lost by the surface - A removed_volume" if by_volume else "volume lost - A h^2 depth_sum",
        lost - taken,
        EPS * (lowerings * area * highest + 16.0 * taken),
        "m3",
    )
