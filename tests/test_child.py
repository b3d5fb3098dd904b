"""Laws of the child process: it does what it is told, may die of it, and is there again for the next job."""

from __future__ import annotations

import os
import time

import numpy as np
import pytest

from cmpcheck.engines.child import Child, ChildError


@pytest.fixture(scope="module")
def child():
    made = Child()
    yield made
    made.stop()


def test_a_job_is_done_in_another_process_that_stays(child):
    first = child.call(os.getpid, timeout=60)
    assert first != os.getpid()
    assert child.call(os.getpid, timeout=60) == first


def test_arrays_come_back_as_they_are(child):
    sent = np.arange(6.0).reshape(2, 3)
    np.testing.assert_array_equal(child.call(np.negative, sent, timeout=60), -sent)


def test_an_exception_is_an_error_in_one_line_and_the_process_stays(child):
    before = child.call(os.getpid, timeout=60)
    with pytest.raises(ChildError, match="invalid literal"):
        child.call(int, "x", timeout=60)
    assert child.call(os.getpid, timeout=60) == before


@pytest.mark.parametrize(
    "job, argument, cause", [(os._exit, 3, "exit code 3"), (os.abort, None, "signal SIGABRT")]
)
def test_a_death_is_an_error_that_says_how_and_the_next_job_is_done(child, job, argument, cause):
    with pytest.raises(ChildError, match=cause):
        child.call(job, *([] if argument is None else [argument]), timeout=60)
    assert child.call(abs, -2, timeout=60) == 2


def test_a_job_that_takes_too_long_is_ended(child):
    child.call(abs, -1, timeout=60)  # started
    begin = time.monotonic()
    with pytest.raises(ChildError, match=r"no answer within 0\.2 s"):
        child.call(time.sleep, 3600, timeout=0.2)
    assert time.monotonic() - begin < 60
    assert child.call(abs, -2, timeout=60) == 2


def test_the_variables_of_an_mpi_launcher_do_not_reach_it(child, monkeypatch):
    child.stop()
    monkeypatch.setenv("PMI_RANK", "1")
    monkeypatch.setenv("KEPT_FOR_THE_CHILD", "1")
    assert child.call(os.getenv, "PMI_RANK", timeout=60) is None
    assert child.call(os.getenv, "KEPT_FOR_THE_CHILD", timeout=60) == "1"
