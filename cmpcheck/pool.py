"""Tasks in processes of their own, as they are done; a worker that dies takes only its own task with it."""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

Task = TypeVar("Task")
Found = TypeVar("Found")


def run_tasks(
    work: Callable[[Task], Found], tasks: Sequence[Task], jobs: int
) -> Iterator[tuple[Task, Future[Found]]]:
    """Each task with the finished future of work(task), in the order in which they end.

    Parameters: work, importable; tasks, longest first; jobs, processes.
    """
    context = multiprocessing.get_context("spawn")  # MPI and compiled code do not survive a fork
    left = dict(enumerate(tasks))
    with ProcessPoolExecutor(jobs, context, initializer=follow_parent) as pool:
        futures = {pool.submit(work, task): k for k, task in left.items()}
        pending = set(futures)
        while pending:
            done, pending = wait(pending, return_when=FIRST_COMPLETED)
            for future in done:
                if not isinstance(future.exception(), BrokenProcessPool):
                    yield left.pop(futures[future]), future
        pool.shutdown(wait=False)  # all is done: processes with much compiled code take seconds to end
    for task in left.values():  # the pool broke: each task that it had not finished gets a process of its own
        with ProcessPoolExecutor(1, context, initializer=follow_parent) as single:
            future = single.submit(work, task)
            future.exception()
            yield task, future


def problem_of(future: Future) -> str:
    """Why a finished task failed, in one line; "" if it did not."""
    problem = future.exception()
    if problem is None:
        return ""
    if isinstance(problem, BrokenProcessPool):
        return "the process that ran it died"
    return " ".join(f"{type(problem).__name__}: {problem}".split())


def follow_parent() -> None:
    """In a worker: end when the parent is gone, even if it was killed; it would wait for tasks for ever.

    Workers share out the cores already: none needs threads of its own.
    """
    os.environ["NUMBA_NUM_THREADS"] = "1"
    parent = multiprocessing.parent_process()
    assert parent is not None

    def follow() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
