"""What has been computed of an optimisation: one SQLite file, where every finished sample stands.

A killed run loses the samples that were in flight.  Only the process that leads the run writes, and it holds
the file's lock; which strings are asked for is not decided here.
"""

from __future__ import annotations

import contextlib
import errno
import json
import sqlite3
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cmpcheck.optimise.problem import Sample, String
from cmpcheck.outputs import OutputError, writable
from cmpcheck.provenance import digest
from reference.case import Case, CaseError, load_case
from reference.toml_source import one_line

FILE, CASE_FILE, SCHEMA = "optimise.sqlite", "case.toml", "cmpcheck-optimise/1"
OWN_FILES = (
    f"{FILE}*", "index.html", "table.*", "strings.csv", "methods.*", "front.*", "figure_[78].*",
)  # fmt: skip
TABLES = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE strings (number INTEGER PRIMARY KEY, genes TEXT NOT NULL UNIQUE, cost REAL,
    standard_error REAL, samples INTEGER, settled INTEGER, reason TEXT);
CREATE TABLE samples (string INTEGER NOT NULL REFERENCES strings, k INTEGER NOT NULL, cost REAL,
    flatness REAL, removal_rate REAL, abrasive_mass REAL, seconds REAL, error TEXT NOT NULL,
    PRIMARY KEY (string, k));
CREATE TABLE asked (run TEXT NOT NULL, place INTEGER NOT NULL, generation INTEGER NOT NULL,
    origin TEXT NOT NULL, string INTEGER NOT NULL REFERENCES strings, PRIMARY KEY (run, place));
CREATE TABLE states (generation INTEGER PRIMARY KEY, state TEXT NOT NULL);
"""


@dataclass(frozen=True)
class Evaluated:
    """A string with the cost of its ensemble: infinite, with a reason, where it cannot be run."""

    string: String
    cost: float
    standard_error: float
    samples: int
    settled: bool  # the rule was met; otherwise the maximum of samples ended it
    reason: str = ""


@dataclass(frozen=True)
class Asked:
    """One string of a run, in the order of asking."""

    generation: int
    origin: str  # random, offspring, or the method that asked
    found: Evaluated


class Store:
    """The strings, samples and states of one folder; `create` or `resume` makes it."""

    def __init__(self, folder: Path, connection: sqlite3.Connection) -> None:
        self.folder, self._sql = folder, connection

    @classmethod
    def create(cls, folder: Path, case: Case, force: bool) -> Store:
        """An empty store in a folder, made if need be.

        Raises OutputError when the folder holds anything, unless `force`, and where nothing can be written.
        """
        if not force and folder.is_dir() and any(folder.iterdir()):
            if (folder / FILE).exists():
                how = "--resume to go on with it, --force to start again, or choose another folder"
                raise OutputError(f"{folder}: holds an optimisation; {how}")
            raise OutputError(f"{folder}: exists already; choose another folder, or --force to write into it")
        writable(folder)
        if (folder / FILE).exists():
            with _connected(folder):  # refused while another process writes there
                pass
            for pattern in OWN_FILES:
                for path in folder.glob(pattern):
                    path.unlink()
        case.save(folder / CASE_FILE)
        with _connected(folder, keep=True) as sql:
            sql.executescript(TABLES)
            meta = {"schema": SCHEMA, "case": case.name, "digest": digest(case)}
            sql.executemany("INSERT INTO meta VALUES (?, ?)", meta.items())
            sql.commit()
        return cls(folder, sql)

    @classmethod
    def resume(cls, folder: Path, case: Case) -> Store:
        """The store of a run of this case that goes on, or an empty one where a run was killed at its start.

        Raises OutputError for anything else.
        """
        if not (folder / FILE).is_file():
            if folder.is_dir() and {path.name for path in folder.iterdir()} == {CASE_FILE}:
                return cls.create(folder, case, force=True)
            raise OutputError(
                f"{folder}: holds no optimisation to go on with; leave --resume out to start one"
            )
        with _connected(folder) as sql:
            begun = sql.execute("SELECT count(*) FROM sqlite_master WHERE name = 'meta'").fetchone()[0]
            begun = begun and sql.execute("SELECT count(*) FROM meta").fetchone()[0]
        if not begun:
            return cls.create(folder, case, force=True)
        with _connected(folder, keep=True) as sql:
            store = cls(folder, sql)
            store._require_whole()
            meta = dict(sql.execute("SELECT key, value FROM meta"))
            if meta.get("schema") != SCHEMA:
                raise OutputError(f"{folder / FILE}: not an optimisation of this version; allowed: {SCHEMA}")
            if meta.get("case") != case.name:
                held = f"holds the case {meta.get('case')!r}, not {case.name!r}"
                raise OutputError(f"{folder}: {held}; allowed with --resume: the folder of the same case")
            if meta.get("digest") != digest(case):
                how = "restore it, or choose another folder"
                raise OutputError(f"{folder}: the case has changed since: {_change(folder, case)}; {how}")
        return store

    def _require_whole(self) -> None:
        """Refuse a file that SQLite finds damaged, or whose rows are not what was written."""
        try:
            found = [said for (said,) in self._sql.execute("PRAGMA integrity_check(1)")]
            if found != ["ok"]:
                raise ValueError(found[0])
            for (run,) in self._sql.execute("SELECT DISTINCT run FROM asked").fetchall():
                self.asked(run)
            for (number,) in self._sql.execute("SELECT number FROM strings").fetchall():
                self.samples(number)
            self.last_state()
            self.totals()
        except (sqlite3.Error, ValueError, TypeError, OverflowError, RecursionError) as problem:
            if "locked" in str(problem):
                raise
            again = "allowed: --force to start again, or another folder"
            raise OutputError(f"{self.folder / FILE}: damaged ({one_line(problem)}); {again}") from None

    def close(self) -> None:
        """Let go of the file."""
        self._sql.close()

    def recall(self, key: str) -> str:
        """What was asked of the run by an option; "" if nothing."""
        row = self._sql.execute("SELECT value FROM meta WHERE key = ?", (key,)).fetchone()
        return row[0] if row else ""

    def remember(self, key: str, value: str) -> None:
        """Keep what is asked of the run, so that it goes on with it when it is resumed."""
        with self._transaction():
            self._sql.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (key, value))

    def number_of(self, string: String) -> int:
        """The number of a string, entered if it is new."""
        genes = json.dumps(list(string))
        with self._transaction():
            self._sql.execute("INSERT OR IGNORE INTO strings (genes) VALUES (?)", (genes,))
        (number,) = self._sql.execute("SELECT number FROM strings WHERE genes = ?", (genes,)).fetchone()
        return int(number)

    def samples(self, number: int) -> dict[int, Sample]:
        """The samples of a string, by k."""
        rows = self._sql.execute("SELECT * FROM samples WHERE string = ?", (number,))
        return {k: Sample(_nan(c), _nan(f), _nan(r), _nan(m), _nan(s), e) for _, k, c, f, r, m, s, e in rows}

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[None]:
        """A change that is made as a whole or not at all.  Raises OSError that names the file."""
        try:
            with self._sql:
                yield
        except sqlite3.OperationalError as problem:
            raise OSError(errno.EIO, str(problem), str(self.folder / FILE)) from None

    def add_samples(self, finished: Sequence[tuple[int, int, Sample]]) -> None:
        """Keep finished samples, each with the number of its string and its k, for good."""
        rows = [(number, k, *sample) for number, k, sample in finished]
        with self._transaction():
            self._sql.executemany("INSERT OR REPLACE INTO samples VALUES (?, ?, ?, ?, ?, ?, ?, ?)", rows)

    def add_result(self, number: int, found: Evaluated) -> None:
        """Keep what an ensemble came to."""
        with self._transaction():
            self._sql.execute(
                "UPDATE strings SET cost = ?, standard_error = ?, samples = ?, settled = ?, reason = ? "
                "WHERE number = ?",
                (found.cost, found.standard_error, found.samples, found.settled, found.reason, number),
            )

    def add_asked(
        self, run: str, first: int, generation: int, origins: Sequence[str], numbers: Sequence[int]
    ) -> None:
        """Keep that a run asked for these strings, at the places from `first` on."""
        rows = [
            (run, first + n, generation, origin, number)
            for n, (origin, number) in enumerate(zip(origins, numbers, strict=True))
        ]
        with self._transaction():
            self._sql.executemany("INSERT OR REPLACE INTO asked VALUES (?, ?, ?, ?, ?)", rows)

    def asked(self, run: str) -> list[Asked]:
        """The strings of a run that have their cost, in the order of asking."""
        rows = self._sql.execute(
            "SELECT generation, origin, genes, cost, standard_error, samples, settled, reason FROM asked "
            "JOIN strings ON string = number WHERE run = ? AND cost IS NOT NULL ORDER BY place",
            (run,),
        )
        return [
            Asked(g, o, Evaluated(tuple(json.loads(genes)), cost, _nan(error), n, bool(settled), reason))
            for g, o, genes, cost, error, n, settled, reason in rows
        ]

    def save_state(self, generation: int, state: dict[str, Any]) -> None:
        """Keep the state of the genetic algorithm after a generation."""
        with self._transaction():
            row = (generation, json.dumps(state))
            self._sql.execute("INSERT OR REPLACE INTO states VALUES (?, ?)", row)

    def last_state(self) -> dict[str, Any] | None:
        """The state after the last whole generation."""
        row = self._sql.execute("SELECT state FROM states ORDER BY generation DESC LIMIT 1").fetchone()
        return json.loads(row[0]) if row else None

    def totals(self) -> tuple[int, float]:
        """How many samples there are, and the time that they took, s."""
        number, seconds = self._sql.execute("SELECT count(*), total(seconds) FROM samples").fetchone()
        return int(number), float(seconds)


@contextlib.contextmanager
def _connected(folder: Path, keep: bool = False) -> Iterator[sqlite3.Connection]:
    """A connection that alone may use the file, closed after an error and unless it is kept."""
    sql = sqlite3.connect(folder / FILE, timeout=0.0)
    try:
        sql.execute("PRAGMA locking_mode = EXCLUSIVE")
        sql.execute("PRAGMA journal_mode = WAL")  # one write to the disk for each commit
        sql.execute("PRAGMA synchronous = FULL")
        sql.execute("BEGIN EXCLUSIVE")
        sql.commit()
        yield sql
    except sqlite3.OperationalError as problem:
        sql.close()
        busy = "another run is writing there; wait for it, or choose another folder"
        raise OutputError(f"{folder}: {busy if 'locked' in str(problem) else one_line(problem)}") from None
    except sqlite3.DatabaseError as problem:
        sql.close()
        raise OutputError(f"{folder / FILE}: cannot be read: {one_line(problem)}") from None
    except UnicodeDecodeError as problem:  # of SQLite's own message about a damaged file
        sql.close()
        raise OutputError(f"{folder / FILE}: cannot be read: {one_line(problem)}") from None
    except BaseException:
        sql.close()
        raise
    if not keep:
        sql.close()


def _nan(value: float | None) -> float:
    return float("nan") if value is None else value


def _change(folder: Path, case: Case) -> str:
    """The first key in which the case differs from the one that the run was started with."""
    try:
        before = _leaves(load_case(folder / CASE_FILE).model_dump(mode="json", by_alias=True))
    except CaseError:
        return "its content"
    after = _leaves(case.model_dump(mode="json", by_alias=True))
    for key in sorted(before.keys() | after.keys()):
        if before.get(key) != after.get(key):
            return f"{key} was {before.get(key)!r}, is {after.get(key)!r}"
    return "its content"


def _leaves(data: Any, key: str = "") -> dict[str, Any]:
    if isinstance(data, dict):
        parts = [_leaves(value, f"{key}.{name}" if key else name) for name, value in data.items()]
    elif isinstance(data, list):
        parts = [_leaves(value, f"{key}[{n}]") for n, value in enumerate(data)]
    else:
        return {key: data}
    return {name: value for part in parts for name, value in part.items()}
