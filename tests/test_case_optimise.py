"""The section [optimise]: bounds in any unit of their key, and one line for what makes no sense."""

from __future__ import annotations

import pytest

from cmpcheck.optimise.problem import Problem
from reference.case import CASES, CaseError, load_case

GOOD = (CASES / "polish_design.toml").read_text("utf-8")


def load(tmp_path, text: str):
    path = tmp_path / "mine.toml"
    path.write_text(text, "utf-8")
    return load_case(path)


def test_bounds_are_in_si_and_whole_numbers_stay_whole():
    part = load_case("polish_design").optimise
    assert part is not None
    assert [(gene.key, gene.low, gene.high) for gene in part.gene] == [
        ("pad.speed", 0.5, 2.0),
        ("particles.count", 5, 40),
        ("particles.mean_diameter", 5e-7, 1.2e-6),
        ("particles.diameter_spread", 0.0, 0.5),
    ]
    assert [gene.integer for gene in part.gene] == [False, True, False, False]


def test_the_same_bounds_in_another_unit_are_the_same_case(tmp_path):
    other = load(tmp_path, GOOD.replace('low = "0.5 m/s"', 'low = "50 cm/s"').replace('"1.2 um"', "1.2e-6"))
    assert other == load_case("polish_design")


def test_a_string_replaces_its_keys_and_nothing_else():
    problem = Problem(load_case("polish_design"))
    case = problem.case_of((2.0, 31.0, 8e-7, 0.25))
    assert case.pad is not None
    assert case.particles is not None
    assert (case.pad.speed, case.particles.count) == (2.0, 31)
    assert (case.particles.mean_diameter, case.particles.diameter_spread) == (8e-7, 0.25)
    assert problem.case_of(problem.as_it_stands()) == problem.case.replaced({})
    changed = {"pad", "particles"}
    assert case.model_dump(exclude=changed) == problem.case.replaced({}).model_dump(exclude=changed)


REFUSED = {
    "inverted bounds": ('high = "2 m/s"', 'high = "0.1 m/s"', "gene[0].high = '0.1 m/s'", "> low, 0.5"),
    "empty bounds": ("high = 40", "high = 5", "gene[1].high = 5", "allowed: > low, 5"),
    "wrong dimension": ('low = "0.5 m/s"', 'low = "5 kg"', "gene[0].low = '5 kg'", "wrong dimension"),
    "out of the key's range": ('low = "0.5 m/s"', "low = -1", "gene[0].low = -1", "a speed > 0"),
    "half a particle": ("low = 5\n", "low = 5.5\n", "gene[1].low = 5.5", "particles.count"),
    "not finite": ("high = 0.5", "high = inf", "gene[3].high = inf", "finite"),
    "too large for the box": ('"1.2 um"', '"6 um"', "gene[2].high = '6 um'", "half the period"),
    "unknown section": ('key = "pad.speed"', 'key = "pat.speed"', "gene[0].key", "did you mean 'pad'"),
    "unknown key": ('key = "pad.speed"', 'key = "pad.sped"', "gene[0].key", "did you mean 'speed'"),
    "not a number": ('key = "pad.speed"', 'key = "surface.kind"', "gene[0].key", "not a number"),
    "a key of the computation": ('key = "pad.speed"', 'key = "numerics.gamma"', "gene[0].key", "may vary"),
    "a key twice": ('"particles.diameter_spread"', '"pad.speed"', "gene[3].key", "each key once"),
    "odd parents": ("parents = 4", "parents = 3", "parents = 3", "even"),
    "too many parents": ("parents = 4", "parents = 8", "parents = 8", "half the population of 12"),
    "maximum below minimum": ("maximum_samples = 40", "maximum_samples = 10", "maximum_samples = 10", "15"),
    "negative tolerance": ("tolerance = 0.01", "tolerance = -0.01", "tolerance = -0.01", ">= 0"),
    "unknown setting": ("tolerance = 0.01", "tolerence = 0.01", "optimise.tolerence", "did you mean"),
    "flat surface": (
        'kind = "asperities"\nsize = "10 um"\nnodes = 20  # spacing 0.5 um\nasperity_height = "0.5 um"\n'
        "asperity_density = 0.025  # 10 squares of four raised nodes",
        'kind = "flat"\nsize = "10 um"\nnodes = 20',
        "optimise",
        "asperities",
    ),
    "nothing that counts": (
        "[[optimise.gene]]",
        "[optimise.weights]\nflatness = 0\n\n[[optimise.gene]]",
        "optimise.weights",
        "above zero",
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_makes_no_sense_is_refused_in_one_line(what, tmp_path):
    old, new, key, allowed = REFUSED[what]
    assert old in GOOD
    with pytest.raises(CaseError) as caught:
        load(tmp_path, GOOD.replace(old, new, 1))
    message = str(caught.value)
    assert "\n" not in message
    assert "mine.toml:" in message
    assert key in message
    assert allowed in message


def test_a_case_without_the_section_is_named():
    with pytest.raises(CaseError, match=r"polish.toml.*optimise.*missing"):
        Problem(load_case("polish"))
