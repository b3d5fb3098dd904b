"""A Python process of our own that does jobs for this one, and may die of them.

For engines that end their process on an error, or cannot share one with another MPI.  A job is a function and
its arguments, sent through a pipe; when the process dies or takes too long, the caller gets a ChildError.
What the jobs are is the engines' business.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

MPI_VARIABLES = ("PMI_", "PMIX_", "HYDI_", "HYDRA_", "MPIR_", "MPI_", "OMPI_", "SLURM_")  # of a launcher
ENDS_WITHIN = 5.0  # s
LOOKS_EVERY = 1.0  # s, after its parent
OUTPUT, ERRORS = "output", "errors"  # files
PIECES, LINES = 0, 1  # glibc's _IOFBF and _IOLBF


class ChildError(RuntimeError):
    """A job that the child process did not finish; one line for the user."""


class ChildLost(ChildError):
    """A job that ended the process, or that did not end."""


class Child:
    """A child process, started at the first job and again after it has died.

    `folder` is a temporary folder of its own: its working directory, gone with this object.
    """

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="cmpcheck-child-", ignore_cleanup_errors=True)
        self.folder = Path(self._folder.name)
        self.output = self.folder / OUTPUT  # what the last job has printed
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection | None = None

    def call(self, function: Callable[..., Any], *arguments: Any, timeout: float) -> Any:
        """The value of function(*arguments), computed by the child within `timeout` seconds.

        Raises ChildLost when the child dies or takes longer, ChildError when the function raises.
        """
        if self._process is None or self._process.poll() is not None:
            self._start()
        assert self._connection is not None
        os.truncate(self.output, 0)
        try:
            self._connection.send((function, arguments))
            if not self._connection.poll(timeout):
                self.stop()
                raise ChildLost(f"no answer within {timeout:g} s; the process was ended")
            done, value = self._connection.recv()
        except (EOFError, OSError):
            raise ChildLost(f"the process has died ({self._cause()})") from None
        if not done:
            raise ChildError(value)
        return value

    def stop(self) -> None:
        """End the process, if there is one."""
        if self._connection is not None:
            self._connection.close()
        if self._process is not None:
            with suppress(OSError):
                os.killpg(self._process.pid, signal.SIGKILL)  # it, and what its engine has started
            self._process.wait()
        self._process = self._connection = None

    def _start(self) -> None:
        self.stop()
        ours, theirs = Pipe()
        environment = {key: value for key, value in os.environ.items() if not key.startswith(MPI_VARIABLES)}
        environment["PYTHONPATH"] = os.pathsep.join(os.path.abspath(path) for path in sys.path)
        with theirs, self.output.open("ab") as output, (self.folder / ERRORS).open("wb") as errors:
            self._process = subprocess.Popen(
                [
                    sys.executable,
                    "-c",
                    f"from cmpcheck.engines.child import serve; serve({theirs.fileno()}, {os.getpid()})",
                ],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=errors,
                cwd=self.folder,
                env=environment,
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
        self._connection = ours

    def _cause(self) -> str:
        """How the process has ended, in words."""
        assert self._process is not None
        try:
            code = self._process.wait(ENDS_WITHIN)
        except subprocess.TimeoutExpired:
            self.stop()
            return "its connection broke"
        if code < 0:
            with suppress(ValueError):
                return f"signal {signal.Signals(-code).name}"
        return f"exit code {code}"


def shared_child(name: str) -> Child:
    """The child of that name of this process; it stays between jobs, because loading an engine takes long."""
    return _shared_child(name, os.getpid())


@cache
def _shared_child(name: str, process: int) -> Child:
    return Child()


def write_lines_at_once(at_once: bool) -> None:
    """Whether what C code prints is written line by line, to be there if it dies, or in pieces as usual."""
    library = ctypes.CDLL(None)
    with suppress(ValueError, AttributeError):  # another C library than glibc
        stream = ctypes.c_void_p.in_dll(library, "stdout")
        library.fflush(stream)
        library.setvbuf(
            stream, None, LINES if at_once else PIECES, ctypes.c_size_t(0 if at_once else 1 << 16)
        )


def serve(descriptor: int, parent: int) -> None:
    """Do jobs until the other end closes the pipe; runs in the child, and ends when its parent is gone."""
    connection = Connection(descriptor)
    threading.Thread(target=_follow, args=(parent,), daemon=True).start()
    while True:
        try:
            function, arguments = connection.recv()
        except EOFError:
            return
        try:
            answer = True, function(*arguments)
        except Exception as problem:  # goes to the caller, as a line
            answer = False, str(problem) or type(problem).__name__
        connection.send(answer)


def _follow(parent: int) -> None:
    """End this process, and what it started, when its parent has ended, even by a signal."""
    while os.getppid() == parent:
        time.sleep(LOOKS_EVERY)
    os.killpg(0, signal.SIGKILL)
