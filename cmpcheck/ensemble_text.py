"""What part 3 says of ensembles in words and tables, the same on the page and in Markdown."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from cmpcheck.display import number, percent, quantity_text, scale, words
from cmpcheck.results import Ensemble, EnsembleCurve, KindMatch, LedgerMatch, PartingImpact, Planning
from cmpcheck.verdicts import REFERENCE


class TextTable(NamedTuple):
    """A table of texts; the first column names its rows."""

    caption: str
    header: list[str]
    rows: list[list[str]]


def heading(ensemble: Ensemble) -> str:
    """Which ensemble it is."""
    parts = [ensemble.variant, f"{ensemble.engine} with contacts of the form {ensemble.form}"]
    return f"{', '.join(part for part in parts if part)}: {ensemble.pairs} pairs"


def curve_caption(curve: EnsembleCurve, ensemble: Ensemble) -> str:
    """What a figure shows and which margin is drawn."""
    factor, unit = scale(curve.margin, curve.unit)
    size = f"{number(curve.margin * factor, 3)} {unit}".rstrip()
    rule = curve.margin_rule if curve.unit == "1" and "absolute" in curve.margin_rule else ""
    return (
        f"{words(curve.quantity).capitalize()}, mean of {ensemble.pairs} samples; below, "
        f"{ensemble.engine} minus reference in pairs with its 90 % band (Student's t), and the margin of ±"
        + (rule or f"{size} ({curve.margin_rule})")
    )


def planning_table(ensemble: Ensemble) -> TextTable:
    """How many pairs were needed and what those that were run can tell."""
    header = ["quantity", "margin", "spread in the pilot", "assumed", "pairs needed", "pairs run"]
    header += ["power", "detectable", "spread found", "largest"]
    sources = list(dict.fromkeys(p.source for p in ensemble.planning))
    caption = (
        "Sample size. Spread: standard deviation of the paired differences, of flatness the largest of its "
        f"times. Assumed: {'; '.join(sources)}. Pairs needed: to show equivalence with a power of 90 %. "
        "Power: of showing it with the pairs run, if nothing differs. Detectable: the difference that they "
        "tell from zero with a power of 80 %. Largest: the difference of a single pair."
    )
    return TextTable(caption, header, [_planning_row(p) for p in ensemble.planning])


def _planning_row(p: Planning) -> list[str]:
    def share(value: float) -> str:
        return ("none" if math.isnan(value) else percent(value)) if p.relative else number(value, 2)

    name = words(p.quantity) + (", step doubled" if p.engine == REFERENCE else "")
    return [
        name, share(p.margin), "none" if math.isnan(p.pilot) else share(p.pilot), share(p.assumed),
        str(p.needed), str(p.pairs), percent(p.power), share(p.detectable), share(p.found),
        share(p.largest),
    ]  # fmt: skip


def ledger_table(ledger: LedgerMatch, engine: str) -> TextTable:
    """Impacts of each kind in two engines, how many are the same, and the first that is not."""
    rows = [
        [f"recorded, reference / {engine}", *(f"{k.impacts[0]} / {k.impacts[1]}" for k in ledger.kinds)],
        ["matched in the whole run", *(str(k.matched) for k in ledger.kinds)],
        ["matched before they part", *(_before(k) for k in ledger.kinds)],
        ["part at", *(_of(k, lambda p: quantity_text(p.time, "s", digits=4)) for k in ledger.kinds)],
        ["particle", *(_of(k, _particles) for k in ledger.kinds)],
        [
            f"approach speed (m/s), reference / {engine}",
            *(
                _of(k, lambda p: f"{_speed(p.reference_speed)} / {_speed(p.measured_speed)}")
                for k in ledger.kinds
            ),
        ],
        [f"lowers a node, reference / {engine}", *(_of(k, _nodes) for k in ledger.kinds)],
        ["contact lasts, in the model", *(_of(k, lambda p: _length(p.duration)) for k in ledger.kinds)],
        [f"resolved over, reference / {engine}", *(_of(k, _resolved) for k in ledger.kinds)],
        ["gap to the surface (nm)", *(_of(k, lambda p: _nm(p.surface_gap)) for k in ledger.kinds)],
        ["gap to the pad (nm)", *(_of(k, lambda p: _nm(p.pad_gap)) for k in ledger.kinds)],
        ["neighbours (gap in nm)", *(_of(k, _neighbours) for k in ledger.kinds)],
        ["something else touches", *(_of(k, lambda p: "yes" if p.crowded else "no") for k in ledger.kinds)],
    ]
    caption = (
        "Contact ledgers of sample 0. Two impacts are the same if kind and particles are, and each is the "
        f"nearest to the other within {quantity_text(ledger.window, 's', digits=3)}: a step of each engine, "
        "a soft contact and a tenth of the drag time tau. They part at the first impact that one engine "
        f"lacks, that differs by more than the {ledger.explained:.2g} m/s that late contacts explain, or "
        "that lowers another node. Neighbours: centres within 1.1 (R_i + R_j). Something else touches: "
        f"within {quantity_text(ledger.touching, 'm', digits=2)}, or strikes one of the particles within a "
        "step of each engine and a soft contact."
    )
    return TextTable(caption, ["impacts with", *(_WITH[k.kind] for k in ledger.kinds)], rows)


def ledger_sentences(ensemble: Ensemble) -> list[str]:
    """The first impact at which the engines part, and the first of those that remove material."""
    assert ensemble.ledger is not None
    parted = sorted(
        ((k.parting.time, k, k.parting) for k in ensemble.ledger.kinds if k.parting is not None),
        key=lambda entry: entry[0],
    )
    if not parted:
        return ["Started from the same arrays, the two engines never part."]
    _, first, impact = parted[0]
    texts = [f"Started from the same arrays, the engines part at {_told(first, impact, ensemble.engine)}."]
    texts += [
        f"On the surface {match.before} impacts agree before the first that does not, "
        f"{_told(match, surface, ensemble.engine)}."
        for _, match, surface in parted[1:]
        if match.kind == "surface"
    ]
    if any(p.crowded for _, _, p in parted):
        texts.append(
            "Impacts at the same time have no unique outcome: the reference adds the impulses of one step; "
            f"in {ensemble.engine} a contact of two particles lasts and is recorded once, as it began."
        )
    return [*texts, "No verdict hangs on this: single trajectories part, means need not."]


def _told(match: KindMatch, p: PartingImpact, engine: str) -> str:
    ours, theirs = p.reference_speed, p.measured_speed
    if math.isnan(theirs):
        how = f"at {_speed(ours)} m/s in the reference and missing in {engine}"
    elif math.isnan(ours):
        how = f"at {_speed(theirs)} m/s in {engine} and missing in the reference"
    else:
        how = f"at {_speed(ours)} m/s in the reference and {_speed(theirs)} m/s in {engine}"
    what = {
        "pair": f"the contact of particles {p.particle} and {p.partner}",
        "surface": f"the impact of particle {p.particle} on the surface",
        "pad": f"the contact of particle {p.particle} with the pad",
    }[match.kind]
    if min(p.nodes) >= 0 and p.nodes[0] != p.nodes[1]:
        how += f"; the nodes that it lowers differ, nearest to points {_nm(p.apart, 2)} nm apart"
    crowd = ", while something else touches" if p.crowded else ""
    return f"{what}, {quantity_text(p.time, 's', digits=4)} after the start{crowd}: {how}"


_WITH = {"surface": "surface", "pair": "each other", "pad": "pad"}


def _of(match: KindMatch, text: Callable[[PartingImpact], str]) -> str:
    return "never" if match.parting is None else text(match.parting)


def _before(match: KindMatch) -> str:
    doubt = f", {match.undecided} too slow to tell" if match.undecided else ""
    return f"{match.before}{doubt}"


def _particles(p: PartingImpact) -> str:
    return str(p.particle) if p.partner < 0 else f"{p.particle} and {p.partner}"


def _speed(value: float) -> str:
    return "none" if math.isnan(value) else number(value, 3)


def _length(seconds: float) -> str:
    return "no time" if seconds == 0.0 else quantity_text(seconds, "s", digits=3)


def _nodes(p: PartingImpact) -> str:
    different = min(p.nodes) >= 0 and p.nodes[0] != p.nodes[1]
    text = " / ".join("no" if node < 0 else "yes" for node in p.nodes)
    return text + (", not the same" if different else "")


def _resolved(p: PartingImpact) -> str:
    return " / ".join("none" if math.isnan(t) else _length(t) for t in p.contact_times)


def _nm(metres: float, decimals: int = 1) -> str:
    return "n/a" if math.isnan(metres) else number(round(metres * 1e9, decimals) + 0.0, 4)


def _neighbours(p: PartingImpact) -> str:
    return ", ".join(f"{k} ({_nm(gap)})" for k, gap in p.neighbours) or "none"
