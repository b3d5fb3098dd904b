"""The list of known departures: what each kind of row becomes of it, and what a wrong entry says."""

from __future__ import annotations

import re

import pytest

from cmpcheck.departures import KNOWN, Departure, apply_departures, load_departures
from cmpcheck.engines.lammps_setup import departure_deck
from cmpcheck.published import benchmark_names
from cmpcheck.results import Comparison, SuiteResult
from cmpcheck.verdicts import exit_code, standing
from reference.case import CaseError, available_cases

VERSIONS = {"lammps": "20250722"}
ENTRY = Departure(
    name="too-little", engine="lammps", versions=">=20250722, <20260101", case="polish_pair",
    variant="soft, *", quantity="flattening", measure="relative", low=-0.2, high=-0.1,
    reason="long contacts", deck="in.resting_struck",
)  # fmt: skip


def row(measured: float, status: str = "disagree", **changes) -> Comparison:
    """A row whose reference is 2."""
    fields = {
        "case": "polish_pair", "variant": "soft, t_c = 3 ns", "engine": "lammps", "quantity": "flattening",
        "equations": "44", "unit": "1", "reference": 2.0, "measured": measured, "error": abs(measured - 2.0),
        "tolerance": 0.02, "kind": "statistical", "reason": "as judged", "status": status,
    }  # fmt: skip
    return Comparison(**{**fields, **changes})


def judged(before: Comparison, versions=VERSIONS) -> Comparison:
    (after,) = apply_departures([before], versions, [ENTRY])
    return after


def code(after: Comparison) -> int:
    from cmpcheck.results import CaseResult

    case = CaseResult("polish_pair", "", "", "", [after])
    return exit_code(SuiteResult("quick", [], [case], {}))


@pytest.mark.parametrize("measured", [1.61, 1.7, 1.79])
def test_a_departure_of_its_listed_size_is_known_and_changes_no_exit_code(measured):
    after = judged(row(measured))
    assert (after.status, standing(after), code(after)) == ("disagree", "known", 0)
    assert after.known_departure == "too-little: long contacts (in.resting_struck)"


@pytest.mark.parametrize("measured", [1.5, 1.9, 2.3])
def test_one_of_another_size_or_sign_is_a_disagreement_that_says_so(measured):
    after = judged(row(measured))
    assert (standing(after), code(after), after.known_departure) == ("disagree", 1, "")
    assert "outside the known departure 'too-little' of -0.2 to -0.1 of the reference" in after.reason


def test_one_that_no_longer_occurs_is_a_disagreement_with_the_list():
    after = judged(row(1.99, "agree"))
    assert (standing(after), code(after)) == ("disagree", 1)
    assert "no longer occurs" in after.reason


def test_a_row_without_verdict_neither_confirms_nor_refutes():
    after = judged(row(1.99, "not_tested"))
    assert (after.status, after.known_departure, code(after)) == ("not_tested", "", 0)
    assert "neither confirms nor refutes" in after.reason
    failed = row(float("nan"), "error")
    assert repr(judged(failed)) == repr(failed)


@pytest.mark.parametrize(
    "changes, versions",
    [
        ({"engine": "liggghts"}, VERSIONS),
        ({"case": "polish"}, VERSIONS),
        ({"variant": "impulse, at 100 us"}, VERSIONS),
        ({"quantity": "removals"}, VERSIONS),
        ({}, {"lammps": "20260101"}),
        ({}, {"lammps": "of unknown age"}),
        ({}, {}),
    ],
)
def test_an_entry_excuses_nothing_else(changes, versions):
    before = row(1.7, **changes)
    assert judged(before, versions) == before


def test_what_ships_is_valid_and_has_a_deck_of_at_most_thirty_lines():
    entries = load_departures()
    assert entries
    for entry in entries:
        assert entry.case in [*available_cases(), *benchmark_names()]
        assert len(departure_deck(entry.deck).read_text("utf-8").splitlines()) <= 30


@pytest.mark.parametrize(
    "old, new, message",
    [
        ('quantity = "velocity_z"', 'quantify = "velocity_z"', "departure[0].quantify"),
        ('quantity = "velocity_z"\n', "", "departure[0].quantity: required, but missing"),
        ('engine = "lammps"', 'engine = "lamps"', "departure[0].engine = 'lamps': did you mean 'lammps'?"),
        ('">=20250722"', '"since 2025"', "departure[0].versions = 'since 2025': allowed: version specifiers"),
        ("low = 0.209", "low = 0.9", "departure[0].low = 0.9: allowed: <= high, 0.231"),
        ("low = 0.209", "low = -0.209", "an interval without 0"),
        ('"absolute"', '"percent"', "departure[0].measure = 'percent'"),
        (
            'deck = "in.resting_struck"',
            'deck = "in.nowhere"',
            "departure[0].deck = 'in.nowhere': no such file",
        ),
        ('deck = "in.resting_struck"\n', "", "allowed: either deck or upstream"),
        ("[[departure]]", "[[departures]]", "departures"),
    ],
)
def test_a_wrong_entry_is_one_line_that_names_it(old, new, message, tmp_path):
    text = KNOWN.read_text("utf-8")
    assert old in text
    path = tmp_path / "known.toml"
    path.write_text(text.replace(old, new, 1), "utf-8")
    with pytest.raises(CaseError, match=re.escape(message)) as caught:
        load_departures(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
