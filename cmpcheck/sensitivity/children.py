"""The processes that run checks in the guarded copy: how they are made, asked, and replaced when they die.

What they do is `worker.py`.  An error may make a run endless or kill its process: both end the request, with
`Died`, and the next one gets a new process.
"""

from __future__ import annotations

import json
import os
import queue
import selectors
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from cmpcheck.sensitivity.mutants import Mutant
from cmpcheck.sensitivity.patching import copy_tree, seed_all
from cmpcheck.sensitivity.worker import TREE, write_mutants

PATIENCE = 300.0  # s for one request: some fifty times what the slowest takes on an idle machine


class Died(RuntimeError):
    """A request that ended its process, or did not end."""


def prepare(folder: Path, mutants: list[Mutant]) -> None:
    """Make the guarded copy that the processes work in.  Raises PatchError for an error that does not fit."""
    tree = folder / TREE
    tree.mkdir(parents=True)
    copy_tree(tree)
    seed_all(tree, mutants)
    write_mutants(folder, mutants)


class Child:
    """One process; it is started at the first request."""

    def __init__(self, folder: Path, patience: float = PATIENCE) -> None:
        self.folder, self.patience = folder, patience
        self.process: subprocess.Popen[bytes] | None = None

    def ask(self, request: dict[str, Any]) -> dict[str, Any]:
        """The answer to a request; raises Died."""
        if self.process is None:
            self._start()
        assert self.process is not None
        assert self.process.stdin is not None
        try:
            self.process.stdin.write((json.dumps(request) + "\n").encode())
            self.process.stdin.flush()
            line = self._line()
        except (BrokenPipeError, Died) as problem:
            self.close()
            raise Died(str(problem) or "its process died") from None
        return json.loads(line)

    def _start(self) -> None:
        tree = self.folder / TREE
        environment = os.environ | {
            "NUMBA_CACHE_DIR": str(self.folder / "numba"), "PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1",
        }  # fmt: skip
        self.process = subprocess.Popen(
            [sys.executable, "-m", "cmpcheck.sensitivity.worker", str(self.folder)],
            cwd=tree, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=(self.folder / f"worker-{id(self)}.log").open("ab"), start_new_session=True,
        )  # fmt: skip

    def _line(self) -> bytes:
        """The next line of answers."""
        assert self.process is not None
        assert self.process.stdout is not None
        parts: list[bytes] = []
        with selectors.DefaultSelector() as selector:
            selector.register(self.process.stdout, selectors.EVENT_READ)
            while not (parts and parts[-1].endswith(b"\n")):
                if not selector.select(self.patience):
                    raise Died(f"no end within {self.patience:g} s")
                part = os.read(self.process.stdout.fileno(), 1 << 16)
                if not part:
                    raise Died("its process died")
                parts.append(part)
        return b"".join(parts)

    def close(self) -> None:
        """End the process."""
        if self.process is None:
            return
        self.process.kill()
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout):
            if stream is not None:
                stream.close()
        self.process = None


def run_parallel(
    jobs: Sequence[Any], work: Callable[[Child, Any], Any], children: Sequence[Child],
    done: Callable[[Any, Any], None],
) -> None:  # fmt: skip
    """work(child, job) for every job, each child one at a time; `done(job, result)` is called in this thread.

    Raises what `work` raises first; jobs that have not begun are then left.
    """
    waiting: queue.SimpleQueue[Any] = queue.SimpleQueue()
    finished: queue.SimpleQueue[Any] = queue.SimpleQueue()
    for job in jobs:
        waiting.put(job)
    stop = threading.Event()

    def run(child: Child) -> None:
        while not stop.is_set():
            try:
                job = waiting.get_nowait()
            except queue.Empty:
                break
            try:
                finished.put((job, work(child, job), None))
            except BaseException as problem:
                finished.put((job, None, problem))

    threads = [threading.Thread(target=run, args=(child,), daemon=True) for child in children]
    for thread in threads:
        thread.start()
    try:
        for _ in range(len(jobs)):
            job, result, problem = finished.get()
            if problem is not None:
                raise problem
            done(job, result)
    finally:
        stop.set()
