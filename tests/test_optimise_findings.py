"""What a design run says of itself follows from its numbers, and changes with them."""

from __future__ import annotations

import math

import design_example as example
import numpy as np
import pytest

from cmpcheck.optimise import figures, findings, page
from cmpcheck.optimise.methods import METHODS, Trial
from cmpcheck.optimise.response import shares
from cmpcheck.optimise.results import Design, Distribution, markdown_table, table
from cmpcheck.optimise.store import Asked, Evaluated

CENTRE = np.array([2.0, 20.0, 8e-7, 0.25])


def design(widths: tuple[float, ...], tolerance: float = 0.01, errors: float = 0.03, **more) -> Design:
    """Thirty random strings, the ten best of which range over parts of the bounds of four genes."""
    problem = example.problem(tolerance=tolerance)
    low, high = problem.bounds.T
    rng = np.random.default_rng(1)
    asked = []
    for n in range(30):
        place = rng.random(4) if n >= 10 else 0.5 + (n / 9 - 0.5) * np.array(widths)
        string = low + place * (high - low)
        string[1] = round(string[1])
        found = Evaluated(tuple(map(float, string)), 0.1 + 0.01 * n, errors, 16, True)
        asked.append(Asked(1 + n // 10, "random", found))
    costs = np.random.default_rng(2).gamma(2.0, 0.05, 60)
    sets = [
        Distribution("the case as it stands", (1.0, 20.0, 9e-7, 0.1), 2 * costs),
        Distribution("the best string", asked[0].found.string, costs),
    ]
    tops = [costs[:16] + 0.01 * n for n in range(10)]
    return Design(problem, asked, sets, tops, 480, 100.0, **more)


def test_uniform_numbers_range_as_little_as_the_formula_says():
    ranges = np.ptp(np.random.default_rng(0).random((40_000, 10)), axis=1)
    for relative in (0.5, 0.61, 0.8):
        chance = findings.range_chance(relative, 10)
        assert abs((ranges <= relative).mean() - chance) < 5 * math.sqrt(chance * (1 - chance) / 40_000)


def test_genes_that_range_little_cluster_and_others_spread():
    like_paper = findings.spreads(design((0.1, 0.2, 0.05, 0.95)))
    assert [round(s.relative, 2) for s in like_paper] == [0.1, 0.2, 0.05, 0.95]
    assert [s.clusters for s in like_paper] == [True, True, True, False]
    text = findings.conclusion(design((0.1, 0.2, 0.05, 0.95)))
    assert "Ours agrees for V_pad, N, d̄ and δd." in text
    text = findings.conclusion(design((0.9, 0.2, 0.05, 0.1)))
    assert "Ours agrees for N and d̄, but V_pad spreads and δd clusters." in text
    assert "V_pad over 90 %" in text
    text = findings.conclusion(design((0.9, 0.9, 0.9, 0.1)))
    assert "Ours does not: V_pad spreads, N spreads, d̄ spreads and δd clusters." in text


def test_a_gene_that_matters_explains_and_one_that_does_not_does_no_more_than_chance():
    """The cost is a bowl in two genes, far from monotone; the third does nothing."""
    rng = np.random.default_rng(4)
    chances = []
    for _ in range(200):
        points = rng.uniform(-1.0, 1.0, (60, 3))
        costs = np.exp(points[:, 0] ** 2 + (points[:, 1] - points[:, 0]) ** 2 + rng.normal(0.0, 0.2, 60))
        first, second, third = shares(points, costs)
        assert max(first.chance, second.chance) < 1e-3
        assert third.explained < min(first.explained, second.explained)
        chances.append(third.chance)
    assert abs((np.array(chances) < 0.05).mean() - 0.05) < 5 * math.sqrt(0.05 * 0.95 / 200)
    assert all(math.isnan(share.chance) for share in shares(points[:12], costs[:12]))


def test_the_stopping_rule_is_too_early_where_the_standard_error_exceeds_the_tolerance():
    early = findings.stopping(design((0.1,) * 4, tolerance=0.01, errors=0.03))
    assert "ended 30 of 30 ensembles too early" in early
    assert "about 144 samples" in early  # 16 (0.03/0.01)^2
    assert "ended 0 of 30" in findings.stopping(design((0.1,) * 4, tolerance=0.05, errors=0.03))


def test_the_best_mean_is_held_against_samples_that_did_not_choose_it():
    found = design((0.1,) * 4)
    fresh = found.distributions[1].costs[16:]
    text = findings.selection(found)
    assert f"on 44 others, which did not choose it, Π = {fresh.mean():.3g} ± " in text


def test_strings_on_equal_surfaces_are_told_apart_by_their_differences():
    found = design((0.1,) * 4)
    assert findings.indistinct(found).endswith("tells the best from all others of the top 10.")
    noise = np.random.default_rng(3).normal(0.0, 0.002, (10, 16))
    costs = [found.top_samples[0] + 0.01 * n + noise[n] for n in range(10)]
    costs[4] = costs[0] + 5 * noise[4]
    apart = Design(found.problem, found.asked, [], costs, 480, 100.0)
    assert findings.indistinct(apart).startswith("2 of the top 10, itself included, cannot be told")


def trials(means: dict[str, tuple[float, ...]]) -> list[Trial]:
    return [
        Trial(method, seed, (16, 32), (0.3, mean), tuple(CENTRE), np.array([mean - 0.01, mean + 0.01]))
        for method, values in means.items()
        for seed, mean in enumerate(values)
    ]


def test_the_best_method_is_named_and_chance_is_not_called_a_lead():
    names = list(METHODS)
    clear = {names[0]: (0.30, 0.31, 0.32), names[1]: (0.20, 0.21, 0.22), names[2]: (0.31, 0.30, 0.33)}
    text = findings.best_method(trials(clear))
    assert text.startswith("Best is: random search; its lead over genetic algorithm, 0.1")
    assert "is more than chance" in text
    even = {names[0]: (0.30, 0.20, 0.25), names[1]: (0.21, 0.29, 0.26)}
    assert "no more than chance may do with 3 seeds" in findings.best_method(trials(even))
    assert "One seed says nothing about chance" in findings.best_method(trials(dict.fromkeys(names, (0.2,))))


def test_the_skew_of_fig_7_stands_in_its_caption():
    found = design((0.1,) * 4)
    (seven, eight) = figures.drawings(found)
    costs = found.distributions[1].costs
    n, deviations = len(costs), costs - costs.mean()
    skewness = n / (n - 1) / (n - 2) * (deviations**3).sum() / costs.std(ddof=1) ** 3
    assert f"skewness {skewness:.2g} ± 0.3" in seven.caption
    assert len(seven.panels) == 2
    assert "never rises" in eight.caption


def test_a_best_string_at_a_bound_is_remarked():
    found = design((0.1,) * 4)
    assert findings.bound_remark(found) == ""
    at_bound = Asked(1, "random", Evaluated((2.0, 20.0, 8e-7, 0.25), 0.01, 0.01, 16, True))
    moved = Design(found.problem, [*found.asked, at_bound], [], [], 1, 1.0)
    assert "at the upper bound of V_pad, 2 m/s: a better one may lie beyond" in findings.bound_remark(moved)


def test_history_is_the_least_cost_up_to_each_generation():
    found = design((0.1,) * 4)
    asked = [Asked(4 - a.generation, a.origin, a.found) for a in found.asked]  # the best come last
    turned = Design(found.problem, asked, [], [], 1, 1.0)
    assert turned.history == [turned.ranked[20].cost, turned.ranked[10].cost, turned.ranked[0].cost]


def test_the_table_reads_like_the_paper_s():
    found = design((0.1,) * 4)
    text = markdown_table(found)
    assert text.splitlines()[2] == "| V_pad (m/s) | N | d̄ (nm) | δd | Π | standard error | samples |"
    assert len([line for line in text.splitlines() if line.startswith("| ")]) == 11
    assert table(found.problem, found.ranked).columns.tolist()[:4] == [
        "V_pad",
        "N",
        "mean_diameter",
        "diameter_spread",
    ]


@pytest.mark.parametrize("more", [{}, {"trials": trials(dict.fromkeys(METHODS, (0.2, 0.3)))}])
def test_equal_designs_give_equal_pages(more):
    assert page.render(design((0.1,) * 4, **more)) == page.render(design((0.1,) * 4, **more))
