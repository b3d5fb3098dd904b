"""Laws of a design run: its result depends on the case alone, and nothing that was computed is lost."""

from __future__ import annotations

import math
from pathlib import Path

import design_example as example
import numpy as np
import pytest

from cmpcheck.optimise.evaluation import Evaluator
from cmpcheck.optimise.problem import evaluate_sample
from cmpcheck.optimise.search import MAIN, new_algorithm, search
from cmpcheck.optimise.store import FILE, Store
from cmpcheck.optimise.workers import LocalProcesses, WorkersError
from cmpcheck.outputs import OutputError
from reference.ensemble import adaptive_mean


def run(
    folder: Path,
    evaluate=example.quick,
    workers=None,
    resume: bool = False,
    on_sample=lambda s: None,
    **settings,
):
    """A whole search; returns the algorithm and what it asked for."""
    problem = example.problem(**settings)
    store = Store.resume(folder, problem.case) if resume else Store.create(folder, problem.case, False)
    store._sql.execute("PRAGMA synchronous = OFF")  # the disk is not what is tested
    try:
        with workers or example.Threads() as some:
            ga = search(problem, Evaluator(problem, store, some, on_sample, evaluate))
        return ga, store.asked(MAIN)
    finally:
        store.close()


def test_every_string_has_the_adaptive_mean_of_its_samples(tmp_path):
    ga, asked = run(tmp_path / "a")
    problem = example.problem()
    assert len(asked) == 8 + 2 * 6
    assert len({ask.found.samples for ask in asked}) > 1
    for found in (ask.found for ask in asked):
        alone = adaptive_mean(lambda k, s=found.string: example.quick(problem, s, k).cost, 4, 0.01, 9)
        assert (found.cost, found.standard_error, found.samples) == (*alone[:2], len(alone.values))
        assert found.settled == alone.settled(0.01)
    assert min(ask.found.cost for ask in asked) == ga.best[1]


def test_strings_meet_the_same_surfaces():
    """Common random numbers: sample k of any string begins with the surface of sample k of the case."""
    from reference.ensemble import sample_case

    problem = example.problem()
    seeds = {sample_case(problem.case_of(s), 3).case.seed for s in new_algorithm(problem).ask()}
    assert seeds == {sample_case(problem.case, 3).case.seed}


@pytest.mark.parametrize("jobs", [1, 2, 5])
def test_the_result_does_not_depend_on_the_number_of_workers_or_on_who_is_first(tmp_path, jobs):
    straight = run(tmp_path / "straight")[1]
    assert run(tmp_path / "other", example.shuffled, example.Threads(jobs))[1] == straight


class Stop(Exception):
    pass


@pytest.mark.parametrize("after", [1, 5, 37, 60, 95])
def test_an_interrupted_run_goes_on_to_the_same_result_and_computes_nothing_twice(tmp_path, after):
    whole: list = []
    straight = run(tmp_path / "straight", on_sample=whole.append)[1]
    seen: list = []

    def stop(sample) -> None:
        seen.append(sample)
        if len(seen) == after:
            raise Stop

    with pytest.raises(Stop):
        run(tmp_path / "stopped", on_sample=stop)
    store = Store.resume(tmp_path / "stopped", example.design_case())
    kept, _ = store.totals()
    store.close()
    rest: list = []
    assert run(tmp_path / "stopped", resume=True, on_sample=rest.append)[1] == straight
    assert kept >= after
    assert kept + len(rest) == len(whole)
    again: list = []
    assert run(tmp_path / "stopped", resume=True, on_sample=again.append)[1] == straight
    assert not again


def test_a_string_that_cannot_be_packed_costs_infinity_with_its_reason_and_the_run_goes_on(tmp_path):
    for jobs in (1, 4):
        ga, asked = run(tmp_path / str(jobs), example.crowded, example.Threads(jobs))
        impossible = [ask.found for ask in asked if ask.found.string[1] > 20]
        assert impossible
        for found in impossible:
            assert math.isinf(found.cost)
            assert (
                found.reason == f"no place for {found.string[1]:g} particles in 2"
            )  # of its first such sample
            assert found.samples == 2
        assert math.isfinite(ga.best[1])
        assert ga.best[0][1] <= 20


def test_particles_that_find_no_place_are_named_by_the_simulation_itself():
    problem = example.problem()
    full = evaluate_sample(problem, (1.0, 40.0, 1.2e-6, 0.0), 0)
    assert math.isnan(full.cost)
    assert "particles.count = 40: random sequential packing placed" in full.error
    thick = evaluate_sample(problem, (1.0, 5.0, 1.2e-6, 0.0), 0)
    assert thick.error == ""
    assert 0 < thick.cost == thick.flatness < 1.5
    assert evaluate_sample(problem, (1.0, 5.0, 1.2e-6, 0.0), 0)[:4] == thick[:4]
    wide = evaluate_sample(problem, (1.0, 5.0, 2.4e-6, 0.4), 0)  # 3.4 um > half of 5 um
    assert "particles.mean_diameter" in wide.error


def test_weights_add_what_they_name():
    flat, mass, rate, both = (
        evaluate_sample(example.problem(weights=weights), (1.0, 5.0, 9e-7, 0.0), 0)
        for weights in (
            {"flatness": 1.0},
            {"flatness": 0.0, "abrasive_mass": 1.0},
            {"flatness": 0.0, "removal_rate": 1.0},
            {"flatness": 2.0, "removal_rate": 0.5, "abrasive_mass": 0.25},
        )
    )
    assert mass.cost == pytest.approx(5 / (20 * (1 + 0.1**2)), rel=1e-12, abs=0)  # of 20 with a spread of 0.1
    assert 0 < rate.cost < 1
    total = 2 * flat.cost + 0.5 * rate.cost + 0.25 * mass.cost
    assert both.cost == pytest.approx(total, rel=1e-12, abs=0)  # three roundings


@pytest.mark.slow
def test_a_worker_that_is_killed_loses_nothing(tmp_path, monkeypatch):
    monkeypatch.setenv("CMPCHECK_TEST_MARK", str(tmp_path / "mark"))
    straight = run(tmp_path / "straight")[1]
    assert run(tmp_path / "killed", example.deadly_once, LocalProcesses(2))[1] == straight
    assert (tmp_path / "mark").exists()


@pytest.mark.slow
def test_a_sample_that_kills_every_worker_costs_infinity_and_takes_no_other_with_it(tmp_path):
    sizes = {"population": 4, "parents": 2, "generations": 1}
    straight = run(tmp_path / "straight", **sizes)[1]
    asked = run(tmp_path / "killed", example.deadly, LocalProcesses(2), **sizes)[1]
    middle = np.mean(example.problem().bounds[0])
    assert any(ask.found.string[0] > middle for ask in asked)
    for ask, alive in zip(asked, straight, strict=True):
        if ask.found.string[0] > middle:
            assert math.isinf(ask.found.cost)
            assert ask.found.reason == "sample 1 took its worker with it 3 times"
        else:
            assert ask == alive


@pytest.mark.slow
def test_workers_that_all_die_at_once_end_the_run_and_condemn_no_string(tmp_path):
    with pytest.raises(WorkersError, match="die before they have run anything"):
        run(tmp_path, example.always_deadly, LocalProcesses(2))
    store = Store.resume(tmp_path, example.design_case())
    assert store.totals()[0] == 0
    store.close()


def refusal(call) -> str:
    with pytest.raises(OutputError) as caught:
        call()
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_a_folder_of_something_else_is_refused_and_left_alone(tmp_path):
    case = example.design_case()
    assert "holds no optimisation to go on with" in refusal(lambda: Store.resume(tmp_path, case))
    (tmp_path / "mine.txt").write_text("mine")
    assert "exists already" in refusal(lambda: Store.create(tmp_path, case, False))
    (tmp_path / "mine.csv").write_text("mine")
    for name in ("figure_7.svg", "methods.csv", "index.html"):
        (tmp_path / name).write_text("of an earlier run")
    (tmp_path / FILE).write_bytes(b"")
    Store.create(tmp_path, case, True).close()
    assert {path.name for path in tmp_path.iterdir()} == {"mine.txt", "mine.csv", "case.toml", FILE}
    assert "--resume to go on" in refusal(lambda: Store.create(tmp_path, case, False))


def test_a_changed_case_and_another_case_are_not_resumed(tmp_path):
    case = example.design_case()
    Store.create(tmp_path, case, True).close()
    changed = example.design_case(tolerance=0.02)
    message = refusal(lambda: Store.resume(tmp_path, changed))
    assert "the case has changed since: optimise.tolerance was 0.01, is 0.02" in message
    other = case.model_copy(update={"case": case.case.model_copy(update={"name": "other"})})
    assert "holds the case 'polish_design', not 'other'" in refusal(lambda: Store.resume(tmp_path, other))
    Store.resume(tmp_path, case).close()


def test_two_runs_do_not_write_into_one_folder(tmp_path):
    case = example.design_case()
    first = Store.create(tmp_path, case, True)
    assert "another run is writing there" in refusal(lambda: Store.resume(tmp_path, case))
    assert "another run is writing there" in refusal(lambda: Store.create(tmp_path, case, True))
    first.close()
    Store.resume(tmp_path, case).close()


def test_a_file_that_is_no_database_is_named(tmp_path):
    (tmp_path / FILE).write_text("not a database, but long enough to have a header" * 10)
    assert "cannot be read" in refusal(lambda: Store.resume(tmp_path, example.design_case()))
