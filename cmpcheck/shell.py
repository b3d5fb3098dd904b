"""The frame around every command: the application, expected errors as one line, progress bars.

The commands themselves are `cli.py`.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NoReturn

import typer

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

BAD_INPUT, INTERRUPTED = 2, 130

app = typer.Typer(
    help="Check a particle model of polishing, and engines that run it, against closed forms and each other.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


class BadInput(ValueError):
    """An option that cannot be used; one line for the user."""


def complain(message: str, code: int) -> NoReturn:
    """One line on standard error, and the exit code."""
    typer.echo(f"cmpcheck: {' '.join(message.split())}", err=True)
    raise typer.Exit(code)


def command(**settings: Any) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register a command whose expected errors become one line and an exit code."""

    def register(function: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(function)
        def guarded(*args: Any, **kwargs: Any) -> None:
            try:
                function(*args, **kwargs)
            except typer.Exit:
                raise
            except KeyboardInterrupt:
                complain("interrupted", INTERRUPTED)
            except (ValueError, RuntimeError, OSError) as problem:
                code = _exit_code_of(problem)
                if code is None:
                    raise
                complain(sentence_of(problem), code)

        return app.command(**settings)(guarded)

    return register


def sentence_of(problem: Exception) -> str:
    """What went wrong; of a file or folder, its name first."""
    if not isinstance(problem, OSError) or not problem.strerror:
        return str(problem)
    if problem.filename is not None:
        return f"{problem.filename}: {problem.strerror}"
    import numba

    return f"{problem.strerror}: in the output folder, or in that of compiled code, {numba.config.CACHE_DIR}"


def _exit_code_of(problem: Exception) -> int | None:
    """2 for bad input, 1 for what failed on the way, None for what nobody expected."""
    from cmpcheck.engines.lammps_library import EngineError
    from cmpcheck.outputs import OutputError
    from reference.case import CaseError
    from reference.simulation import SimulationError

    if isinstance(problem, BadInput | CaseError | OutputError):
        return BAD_INPUT
    if isinstance(problem, EngineError | SimulationError | OSError):
        return 1
    return None


@contextlib.contextmanager
def progress_bars() -> Iterator[Progress]:
    """Bars on a terminal's standard error, which an error wipes away so that its line stands alone."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    bars = Progress(console=console, disable=not console.is_terminal)
    # one that was started ends with an empty line, up to rich 14.2 also where it is disabled
    with bars if console.is_terminal else contextlib.nullcontext():
        try:
            yield bars
        except BaseException:
            bars.live.transient = True
            raise


def show_fraction(bars: Progress, task: TaskID) -> Callable[[float], None]:
    """What sets a bar to a fraction done."""

    def show(fraction: float) -> None:
        bars.update(task, completed=fraction)

    return show
