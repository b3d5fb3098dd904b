"""A Python process of our own that does jobs for this one, and may die of them.

For engines that end their process on an error, or cannot share one with another MPI.  A job is a function and
its arguments, sent through a pipe; when the process dies or takes too long, the caller gets a ChildError.
What the jobs are is the engines' business.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

MPI_VARIABLES = ("PMI_", "PMIX_", "HYDI_", "HYDRA_", "MPIR_", "MPI_", "OMPI_", "SLURM_")  # of a launcher
ENDS_WITHIN = 5.0  # s


class ChildError(RuntimeError):
    """A job that the child process did not finish; one line for the user."""


class Child:
    """A child process, started at the first job and again after it has died.

    `folder` is a temporary folder of its own: its working directory, gone with this object.
    """

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="cmpcheck-child-", ignore_cleanup_errors=True)
        self.folder = Path(self._folder.name)
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection | None = None

    def call(self, function: Callable[..., Any], *arguments: Any, timeout: float) -> Any:
        """The value of function(*arguments), computed by the child within `timeout` seconds.

        Raises ChildError when the child dies, takes longer, or the function raises.
        """
        if self._process is None or self._process.poll() is not None:
            self._start()
        assert self._connection is not None
        try:
            self._connection.send((function, arguments))
            if not self._connection.poll(timeout):
                self.stop()
                raise ChildError(f"no answer within {timeout:g} s; the process was ended")
            done, value = self._connection.recv()
        except (EOFError, OSError):
            raise ChildError(f"the process has died ({self._cause()})") from None
        if not done:
            raise ChildError(value)
        return value

    def stop(self) -> None:
        """End the process, if there is one."""
        if self._connection is not None:
            self._connection.close()
        if self._process is not None:
            with suppress(OSError):
                self._process.kill()
            self._process.wait()
        self._process = self._connection = None

    def _start(self) -> None:
        self.stop()
        ours, theirs = Pipe()
        environment = {key: value for key, value in os.environ.items() if not key.startswith(MPI_VARIABLES)}
        environment["PYTHONPATH"] = os.pathsep.join(os.path.abspath(path) for path in sys.path)
        with theirs, open(self.folder / "output", "wb") as output:
            self._process = subprocess.Popen(
                [sys.executable, "-c", f"from cmpcheck.engines.child import serve; serve({theirs.fileno()})"],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                cwd=self.folder,
                env=environment,
                pass_fds=[theirs.fileno()],
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


def serve(descriptor: int) -> None:
    """Do jobs until the other end closes the pipe; runs in the child."""
    connection = Connection(descriptor)
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
