"""Who runs the samples: processes of this machine, or a Dask cluster, behind the interface of an executor.

What is run, in which order, and what becomes of it is `evaluation.py`.
"""

from __future__ import annotations

import logging
import multiprocessing
import signal
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from typing import Any

from cmpcheck.pool import follow_parent

CONNECT_SECONDS = 10.0  # for a scheduler to answer


class WorkersError(RuntimeError):
    """Workers that cannot be had, or that are gone for good; one line for the user."""


class Workers:
    """An executor that can be replaced when it breaks.  Use it in a `with` statement."""

    attempts = 3  # times that a sample may take its worker with it

    def __init__(self) -> None:
        self._executor: Executor | None = None

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def executor(self) -> Executor:
        """The executor, started at its first use."""
        if self._executor is None:
            self._executor = self._start()
        return self._executor

    def submit(self, function: Callable[..., Any], *arguments: object) -> Future:
        """Run function(*arguments) on a worker."""
        return self.executor.submit(function, *arguments)

    def restart(self) -> None:
        """Replace an executor that broke."""
        self.stop()

    def lost(self, problem: BaseException | None) -> bool:
        """Whether the worker died, rather than that what it ran failed."""
        return isinstance(problem, BrokenExecutor)

    def size(self) -> int:
        """How many samples run at a time."""
        raise NotImplementedError

    def stop(self) -> None:
        """End the workers at once; what they were running is lost."""
        raise NotImplementedError

    def _start(self) -> Executor:
        raise NotImplementedError


class LocalProcesses(Workers):
    """Processes of this machine."""

    def __init__(self, jobs: int) -> None:
        super().__init__()
        self._jobs = jobs
        self._others: list[Any] = []  # processes that are not ours

    def size(self) -> int:
        """The number of processes."""
        return self._jobs

    def stop(self) -> None:
        """Terminate the processes."""
        if self._executor is None:
            return
        executor, self._executor = self._executor, None
        executor.shutdown(wait=False, cancel_futures=True)
        for process in multiprocessing.active_children():
            if process not in self._others:
                process.terminate()
        executor.shutdown(wait=True)

    def _start(self) -> Executor:
        self._others = multiprocessing.active_children()
        context = multiprocessing.get_context("spawn")  # compiled code does not survive a fork
        return ProcessPoolExecutor(self._jobs, context, initializer=_attend_parent)


def _attend_parent() -> None:
    """In a worker: leave interrupts to the parent, and end when it is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    follow_parent()


class DaskCluster(Workers):
    """The workers of a Dask scheduler; `cmpcheck` must be installed where they run.

    Raises WorkersError when `dask.distributed` is missing or the scheduler does not answer.
    """

    attempts = 1  # the scheduler has tried it on four workers before it gives a sample up

    def __init__(self, address: str, timeout: float | None = None) -> None:
        super().__init__()
        timeout = CONNECT_SECONDS if timeout is None else timeout
        try:
            import distributed
        except ImportError:
            how = 'install it with: pip install "cmpcheck[cluster]"'
            raise WorkersError(f"--scheduler {address}: dask.distributed is not installed; {how}") from None
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what matters is raised
        try:
            self._client = distributed.Client(address, timeout=timeout, set_as_default=False)
        except (OSError, ValueError, TypeError) as problem:
            allowed = "allowed: the address of a running scheduler, such as tcp://127.0.0.1:8786"
            reason = " ".join(str(problem).split()) or type(problem).__name__
            raise WorkersError(
                f"--scheduler {address}: no scheduler answers in {timeout:g} s ({reason}); {allowed}"
            ) from None
        if not self._client.nthreads():
            self._client.close(timeout=timeout)
            raise WorkersError(
                f"--scheduler {address}: the scheduler has no workers; start some: dask worker {address}"
            )

    def size(self) -> int:
        """The number of threads of all workers, as it is now."""
        return max(1, sum(self._client.nthreads().values()))

    def lost(self, problem: BaseException | None) -> bool:
        """Whether the scheduler gave a sample up because workers died under it."""
        from distributed.scheduler import KilledWorker

        return super().lost(problem) or isinstance(problem, KilledWorker)

    def restart(self) -> None:
        """Nothing: the scheduler goes on with the workers that it has."""

    def stop(self) -> None:
        """Disconnect; the cluster stays."""
        if self._executor is not None:
            self._executor.shutdown(wait=False)
            self._executor = None
        self._client.close(timeout=5)

    def _start(self) -> Executor:
        return self._client.get_executor()
