"""What an engine is to the suite: something that turns a setup into a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from cmpcheck.results import EngineInfo

if TYPE_CHECKING:
    from reference.case import Case
    from reference.recording import Run
    from reference.state import Setup

TIMEOUT = 600.0  # s for one run of another code, unless `[engine.NAME] timeout` says otherwise


@dataclass(frozen=True)
class Resolution:
    """How finely an engine resolves one run."""

    time_step: float  # s
    contact_duration: float = 0.0  # t_c of soft contacts, s; the reference has none
    form: str = "native"  # of surface contacts in the Python fix: soft | impulse; native: no fix
    pair_ratio: float = 1.0  # t_c of contacts between particles, over contact_duration

    @property
    def steps_per_contact(self) -> float:
        """Steps that resolve one soft contact."""
        return self.contact_duration / self.time_step


class NotSupported(RuntimeError):
    """What an engine raises for a setup that it was not made for: the row says `not_tested`, not `error`."""


class Engine(Protocol):
    """A code that simulates setups.

    One of another package is imported, made and run in a child process, whose working directory is a folder
    of its own; a run that takes longer than `[engine.NAME] timeout` is ended.

    An engine without a ledger of contacts returns `cmpcheck.trajectories.trajectory_run(...)`, which is
    judged by velocities, positions and masses.
    """

    name: str
    surface_forms: tuple[str, ...]  # how it can resolve contacts with a surface: soft, impulse

    def info(self) -> EngineInfo:
        """Whether the engine is there, and which version."""
        ...

    def run(self, setup: Setup, resolution: Resolution) -> Run:
        """Simulate a setup, of `setup.copies` equal problems side by side along x.

        Raises a RuntimeError, in one line, when the engine fails, and NotSupported for what it cannot do.
        """
        ...


def timeout_of(case: Case, engine: str) -> float:
    """Seconds of wall-clock time that one run of an engine may take.

    Raises CaseError for a `timeout` in the case that is not positive.
    """
    table, path = case.engine.get(engine, {}), f"engine.{engine}.timeout"
    if "timeout" not in table:
        return TIMEOUT
    value = case.quantity(table["timeout"], "s", path)
    if not value > 0.0:
        raise case.error(path, table["timeout"], "allowed: > 0")
    return value
