"""The same search on a Dask cluster on loopback: the same table, also when a worker is killed."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import design_example as example
import pytest

from cmpcheck.optimise.evaluation import Evaluator
from cmpcheck.optimise.results import ranked, table
from cmpcheck.optimise.search import MAIN, search
from cmpcheck.optimise.store import Store
from cmpcheck.optimise.workers import DaskCluster, WorkersError

pytest.importorskip("distributed")


class Cluster:
    """A scheduler and workers, each a process of its own."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._processes = folder, []
        scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        self.address = self._wait_for(scheduler, r"Scheduler at:\s+(tcp://\S+)")
        self.workers = [self._start("worker", self.address, "--nthreads", "1", "--no-nanny") for _ in "ab"]
        for worker in self.workers:
            self._wait_for(worker, r"Registered to:\s+(tcp://\S+)")

    def _start(self, *arguments: str) -> subprocess.Popen:
        log = (self._folder / f"{len(self._processes)}.log").open("w")
        paths = [str(Path(__file__).parent), *sys.path]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
        command = [sys.executable, "-m", "distributed.cli.dask_" + arguments[0], *arguments[1:]]
        process = subprocess.Popen(command, stdout=log, stderr=log, env=environment, cwd=self._folder)
        self._processes.append(process)
        return process

    def _wait_for(self, process: subprocess.Popen, pattern: str) -> str:
        log = self._folder / f"{self._processes.index(process)}.log"
        for _ in range(600):
            found = re.search(pattern, log.read_text())
            if found:
                return found[1]
            assert process.poll() is None, log.read_text()
            time.sleep(0.1)
        raise AssertionError(log.read_text())

    def stop(self) -> None:
        for process in reversed(self._processes):
            process.kill()
            process.wait()


@pytest.fixture
def cluster(tmp_path) -> Iterator[Cluster]:
    (tmp_path / "cluster").mkdir()
    cluster = Cluster(tmp_path / "cluster")
    yield cluster
    cluster.stop()


def run(folder: Path, workers, evaluate, on_sample=lambda sample: None):
    problem = example.problem(population=4, parents=2, generations=2)
    store = Store.create(folder, problem.case, True)
    try:
        with workers:
            search(problem, Evaluator(problem, store, workers, on_sample, evaluate))
        asked = store.asked(MAIN)
    finally:
        store.close()
    return asked, table(problem, ranked(asked)).to_csv()


@pytest.mark.slow
def test_a_worker_killed_on_the_way_changes_nothing(tmp_path, cluster):
    straight = run(tmp_path / "straight", example.Threads(), example.quick)
    seen: list = []

    def kill_one(sample) -> None:
        seen.append(sample)
        if len(seen) == 7:
            cluster.workers[0].kill()

    assert run(tmp_path / "cluster", DaskCluster(cluster.address), example.slow, kill_one) == straight
    assert cluster.workers[0].wait() != 0
    assert cluster.workers[1].poll() is None


@pytest.mark.slow
def test_a_scheduler_that_dies_is_one_line_and_what_was_computed_is_kept(tmp_path, cluster):
    seen: list = []

    def kill_scheduler(sample) -> None:
        seen.append(sample)
        if len(seen) == 3:
            cluster._processes[0].kill()

    with pytest.raises(WorkersError, match="the scheduler is gone"):
        run(tmp_path / "cut", DaskCluster(cluster.address), example.slow, kill_scheduler)
    store = Store.resume(tmp_path / "cut", example.design_case(population=4, parents=2, generations=2))
    assert store.totals()[0] == len(seen)
    store.close()


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://x", "127.0.0.1:notaport"])
def test_a_scheduler_that_does_not_answer_is_named_within_seconds(address):
    begin = time.monotonic()
    with pytest.raises(WorkersError) as caught:
        DaskCluster(address, timeout=1.0)
    assert time.monotonic() - begin < 10
    assert address in str(caught.value)
    assert "\n" not in str(caught.value)
    assert "allowed: the address of a running scheduler" in str(caught.value)
