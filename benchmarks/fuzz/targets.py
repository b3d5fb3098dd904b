"""What may happen to an input of each kind; anything else is a `Finding`.

Allowed are the answers of a user's tool: it is taken, or refused in one line.  Not allowed are another
exception, a warning on the screen, more than one line, an answer after more than `SECONDS`, a folder outside
the one that was asked for, and agreement with a trajectory that is not right.
"""

from __future__ import annotations

import hashlib
import json
import random
import shutil
import signal
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.fuzz import mutations, seeds
from cmpcheck.deck import (
    _input_file,
    _require_known_variables,
    _require_readable_numbers,
    _return_to_caller,
)
from cmpcheck.engines.lammps_library import EngineError
from cmpcheck.engines.lammps_setup import Deck
from cmpcheck.export import export_run
from cmpcheck.judges import judge_of
from cmpcheck.optimise.store import Store
from cmpcheck.outputs import OutputError
from cmpcheck.summary import summary
from cmpcheck.trajectories import Options
from cmpcheck.trajectories.judged import verdicts
from cmpcheck.trajectories.starts import Evidence, evidence
from cmpcheck.trajectories.units import duration, parse_units
from reference.case import Case, CaseError, load_case
from reference.process import build_setup
from reference.recording import Run
from reference.simulation import SimulationError, simulate
from reference.state import Setup
from reference.units import MEANING, to_si

SECONDS = 20.0  # for one input; the slowest good one takes less than one
SMALL = 300  # particles, and nodes along a side, up to which a case is also set up
WRONG = 0.03  # of restitution, and of a diameter for a path: three times what a verdict may leave open
REFUSED = (CaseError, EngineError, OutputError)


class Finding(AssertionError):
    """What may not happen."""


class TooLong(BaseException):
    """Not caught by what is tested."""


@contextmanager
def watched() -> Iterator[None]:
    """Ends after `SECONDS`; a warning is an error, since a user would see it on the screen."""

    def stop(*_: object) -> None:
        raise TooLong

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            yield
    except TooLong:
        raise Finding(f"no answer in {SECONDS:g} s") from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def tried(target: str, data: bytes) -> str:
    """What becomes of an input, "taken" or "refused"; raises Finding, with its cause, for anything else."""
    with tempfile.TemporaryDirectory(prefix="fuzz-", dir=_memory()) as folder:
        try:
            with watched():
                TARGETS[target](data, Path(folder))
        except REFUSED as refusal:
            if "\n" in str(refusal) or not str(refusal).isprintable():
                raise Finding(f"not one line: {str(refusal)!r}") from refusal
            return "refused"
        except Finding:
            raise
        except Exception as problem:
            raise Finding(f"{type(problem).__name__}: {str(problem)[:300]}") from problem
    return "taken"


def _memory() -> str | None:
    return "/dev/shm" if Path("/dev/shm").is_dir() else None


def case(data: bytes, folder: Path) -> None:
    """A case file: loads back equal, its variants stay in the folder, and it can be set up."""
    path = folder / "case.toml"
    path.write_bytes(data)
    loaded = load_case(path)
    for variant in loaded.variants()[:3]:
        place = (folder / "runs" / variant.name / variant.variant).resolve()
        if not place.is_relative_to((folder / "runs").resolve()) or place == (folder / "runs").resolve():
            raise Finding(f"leaves the folder: {place}")
        variant.save(folder / "again.toml")
        if load_case(folder / "again.toml") != variant:
            raise Finding("does not load back equal")
        if (variant.particles.count if variant.particles else 0) <= SMALL >= (variant.surface.nodes or 0):
            build_setup(variant)


@cache
def _setup() -> Setup:
    return build_setup(seeds.pair())


def _judged(path: Path, units: str = "si") -> None:
    """The verdicts on a trajectory: agreement with what is clearly wrong is a finding."""
    setup = _setup()
    found = evidence(path, setup, Options(units), judge_of(setup))
    rows = {(m.quantity, m.place): verdict for m, verdict, _ in verdicts(judge_of(found.setup), found)}
    wrong = _wrong(found)
    if wrong and all(verdict.status == "agree" for verdict in rows.values()):
        raise Finding(f"agrees although {', '.join(wrong.values())}")
    for (quantity, _), verdict in rows.items():
        if verdict.status == "agree" and quantity in wrong:
            raise Finding(f"{quantity} agrees although {wrong[quantity]}")


def _wrong(found: Evidence) -> dict[str, str]:
    """Quantities that are clearly wrong, from the numbers of the file and arithmetic alone."""
    run, right, wrong = found.run, seeds.right_run(), {}
    m = right.masses[0]
    n = np.array([0.6, 0.48, 0.64])  # the line of centres of the case
    approach = float((right.velocities[0, 0] - right.velocities[0, 1]) @ n)
    e = float((run.velocities[-1, 1] - run.velocities[-1, 0]) @ n) / approach
    asked = found.setup.model.restitution
    if abs(e / asked - 1.0) > WRONG:
        wrong["restitution"] = f"e is {e:g}, not {asked:g}"
    before, after = (float(abs(m @ run.velocities[k] @ n)) for k in (0, -1))
    size = float((m[:, np.newaxis] * np.abs(right.velocities[0])).sum())
    if abs(after - before) > WRONG * size:
        wrong["momentum"] = f"momentum changes by {(after - before) / size:.2g}"
    at_end = abs(run.times[-1] / right.times[-1] - 1.0) < 1e-3
    apart = np.abs(run.positions[-1] - right.positions[-1])
    period = found.setup.model.length_x
    apart[:, :2] = np.minimum(apart[:, :2], period - apart[:, :2])
    if at_end and float(apart.max()) > WRONG * float(right.diameters.min()):
        wrong["trajectory_distance"] = f"a particle ends {apart.max():.2g} m off"
    return wrong


def _file(name: str, units: str = "si") -> Callable[[bytes, Path], None]:
    def target(data: bytes, folder: Path) -> None:
        (folder / name).write_bytes(data)
        _judged(folder / name, units)

    return target


def series(data: bytes, folder: Path) -> None:
    """An index and its files, which are beside it."""
    index, *files = data.split(seeds.CUT)
    name = "mine.series" if index.lstrip()[:1] == b"{" else "mine.pvd"
    (folder / name).write_bytes(index)
    for k, text in enumerate(files[:20]):
        (folder / f"p{k}.vtu").write_bytes(text)
    _judged(folder / name)


def text(data: bytes, folder: Path) -> None:
    """A quantity with its unit, the units of a trajectory, a duration: a finite number, or a ValueError."""
    words = data.decode("utf-8", "surrogateescape")
    for unit in MEANING:
        with suppress(ValueError):
            if not np.isfinite(to_si(words, unit)):
                raise Finding(f"{words!r} is not finite in {unit}")
    with suppress(ValueError):
        units = parse_units(words)
        if not all(0.0 < value < np.inf for value in (units.length, units.time, units.mass)):
            raise Finding(f"{words!r}: {units}")
        duration(words, units)


def deck(data: bytes, folder: Path) -> None:
    """The flags of `cmpcheck deck` and its file, up to where LAMMPS would read it."""
    flags, _, script = data.partition(seeds.CUT)
    (folder / "in.case").write_bytes(script)
    words = [word for word in flags.decode("utf-8", "replace").split("\n") if "\0" not in word]
    _input_file(words)
    read = Deck.read(folder / "in.case")
    _require_known_variables(read, words)
    _require_readable_numbers(read, words)
    if "quit" in read.definitions().split():
        raise Finding("a quit is left, which would end the process")
    for part in read.around_fix():
        _return_to_caller(part)


@cache
def _bounce() -> Case:
    return load_case("bounce_train").replaced({"case.outputs": 9, "case.duration": 3e-6})


@cache
def _folders() -> tuple[Path, Path, Run]:
    """A run that was interrupted, the same one complete, and what it has to end in."""
    place = Path(tempfile.mkdtemp(prefix="fuzz-seed-", dir=_memory()))

    def stop(done: float) -> None:
        if done > 0.6:
            raise KeyboardInterrupt

    with suppress(KeyboardInterrupt):
        simulate(_bounce(), place / "begun", stop, checkpoint_interval=0.0)
    return place / "begun", place / "whole", simulate(_bounce(), place / "whole")


def folder(data: bytes, place: Path) -> None:
    """A run folder in which a file is spoilt, by a recipe: which, how, and a seed.

    How: 0 as it is; 1 in a checkpoint with its digest made right again; 2 in a complete run.
    """
    which, how = (data + b"\0\0")[:2]
    rng = random.Random(data[2:])
    begun, whole, right = _folders()
    mine = place / "run"
    shutil.copytree(whole if how % 3 == 2 else begun, mine)
    files = sorted(path for path in mine.rglob("*") if path.is_file())
    victim = files[which % len(files)]
    victim.write_bytes(mutations.spoilt(victim.read_bytes(), rng))
    if how % 3 == 1 and victim.suffix == ".h5":
        _sign(mine)
    if how % 3 == 2:
        run = Run.load(mine)
        summary(run)
        if run.provenance.get("complete"):
            export_run(run, "csv", mine / "csv")
        return
    try:
        run = simulate(_bounce(), mine, resume=True, checkpoint_interval=np.inf)
    except SimulationError:
        return  # a balance that does not close, or a state that is not finite, in one line
    if how % 3 == 0 and (
        run.positions.tobytes() != right.positions.tobytes() or not run.contacts.equals(right.contacts)
    ):
        raise Finding(f"goes on from a spoilt {victim.name} to other numbers")


def store(data: bytes, place: Path) -> None:
    """The samples of an optimisation, which are gone on with: all that is there is read."""
    (place / "optimise.sqlite").write_bytes(data)
    case = load_case(seeds.OPTIMISED)
    case.save(place / "case.toml")
    resumed = Store.resume(place, case)
    try:
        resumed.last_state()
        resumed.number_of((1.0, 2.0))
        for found in resumed.asked("genetic"):
            resumed.samples(resumed.number_of(found.found.string))
    finally:
        resumed.close()


def _sign(mine: Path) -> None:
    """Make the digests of a checkpoint right, as who spoils it on purpose would."""
    index = mine / "checkpoint" / "checkpoint.json"
    with suppress(OSError, ValueError, KeyError):
        said: dict[str, Any] = json.loads(index.read_text("utf-8"))
        for name in said["parts"]:
            said["parts"][name] = hashlib.sha256((mine / "checkpoint" / name).read_bytes()).hexdigest()
        index.write_text(json.dumps(said), "utf-8")


TARGETS: dict[str, Callable[[bytes, Path], None]] = {
    "case": case,
    "table": _file("mine.csv"),
    "parquet": _file("mine.parquet"),
    "dump": _file("mine.dump", "micro"),
    "series": series,
    "text": text,
    "deck": deck,
    "folder": folder,
    "store": store,
}
