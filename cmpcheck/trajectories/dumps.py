"""Text dumps of LAMMPS and LIGGGHTS: `ITEM: ...` sections, one group of them for each time.

`dump_modify ID units yes time yes` puts units and times into the file.  Without the latter, times are
numbers of steps, and the time step has to be told.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cmpcheck.trajectories.digits import text_resolution
from cmpcheck.trajectories.frames import (
    COLUMNS,
    LARGEST,
    Frames,
    canonical,
    declare,
    rename,
    shown,
    unusable,
)
from reference.toml_source import CaseError

SCALED = {"xs": "x", "ys": "y", "zs": "z", "xsu": "x", "ysu": "y", "zsu": "z"}
MOST_ATOMS = 10_000_000


def read_dump(path: Path) -> Frames:
    """A text dump.  Raises CaseError, naming the line, for anything else."""
    try:
        lines = path.read_text("utf-8").splitlines()
    except UnicodeDecodeError:
        raise CaseError(f"{path}: not text; allowed: a text dump (dump ID all custom ...)") from None
    reader = _Reader(path, lines)
    while reader.at < len(lines):
        reader.section()
    reader.finish()
    return reader.result()


class _Reader:
    """Goes through the sections of a dump."""

    def __init__(self, path: Path, lines: list[str]) -> None:
        self.path, self.lines, self.at = path, lines, 0
        self.units: list[tuple[str, str]] = []
        self.time: str | None = None
        self.step: str | None = None
        self.count: int | None = None
        self.bounds: np.ndarray | None = None
        self.times: list[str] = []
        self.steps: list[str] = []
        self.frames: list[dict[str, np.ndarray]] = []
        self.texts: dict[str, list[str]] = {}

    def fail(self, what: str, line: int | None = None) -> CaseError:
        return CaseError(f"{self.path}:{(self.at if line is None else line) + 1}: {what}")

    def take(self, count: int) -> list[str]:
        """The next lines, all of which must be there."""
        found = self.lines[self.at : self.at + count]
        if len(found) < count:
            raise self.fail(
                f"the file ends within a section, {count - len(found)} lines short", len(self.lines) - 1
            )
        self.at += count
        return found

    def section(self) -> None:
        (line,) = self.take(1)
        if not line.strip():
            return
        if not line.startswith("ITEM: "):
            raise self.fail(f"{shown(line)} where a line ITEM: ... is expected", self.at - 1)
        what = line[6:].strip()
        if what == "UNITS":
            self.units.append(("units", self.take(1)[0].strip()))
        elif what == "TIME":
            self.time = self.take(1)[0].strip()
        elif what == "TIMESTEP":
            self.step = self.take(1)[0].strip()
        elif what == "NUMBER OF ATOMS":
            text = self.take(1)[0].strip()
            if not text.isascii() or not text.isdigit() or int(text[:20]) > MOST_ATOMS:
                raise self.fail(f"number of atoms {shown(text)}; allowed: up to {MOST_ATOMS}", self.at - 1)
            self.count = int(text)
        elif what.startswith("BOX BOUNDS"):
            self.bounds = self._bounds()
        elif what.startswith("ATOMS"):
            self._atoms(what.split()[1:])
        else:
            raise self.fail(f"unknown section {shown(what)}", self.at - 1)

    def _bounds(self) -> np.ndarray:
        first = self.at
        rows = [line.split() for line in self.take(3)]
        if any(len(row) != 2 for row in rows):
            raise self.fail("box bounds that are not two numbers: triclinic boxes are not read", first)
        try:
            bounds = np.array(rows, dtype=float)
        except ValueError:
            raise self.fail("box bounds that are not numbers", first) from None
        if unusable(bounds).any():
            raise self.fail("box bounds that are not finite", first)
        return bounds

    def _atoms(self, names: list[str]) -> None:
        first = self.at
        if self.count is None or self.step is None:
            raise self.fail("ITEM: ATOMS without a TIMESTEP and a NUMBER OF ATOMS before it", first - 1)
        rows = [line.split() for line in self.take(self.count)]
        for k, row in enumerate(rows):
            if len(row) != len(names):
                raise self.fail(f"{len(row)} values for {len(names)} columns", first + k)
        wanted = [k for k, name in enumerate(names) if canonical(name) in COLUMNS or name in SCALED]
        columns = {}
        for k in wanted:
            texts, name = [row[k] for row in rows], names[k]
            try:
                values = np.array(texts, dtype=float)
            except ValueError:
                raise self.fail(f"{name}: a value is not a number", first) from None
            if unusable(values).any():
                raise self.fail(f"{name}: a value is not a finite number up to {LARGEST:g}", first)
            if name in SCALED:
                if self.bounds is None:
                    raise self.fail(f"{name} is scaled by the box, but there are no BOX BOUNDS", first)
                low, high = self.bounds["xyz".index(name[0])]
                values, name = low + values * (high - low), SCALED[name]
            columns[name] = values
            if canonical(name) not in ("particle", "time"):
                self.texts.setdefault(canonical(name), []).extend(texts)
        self.frames.append(rename(self.path, columns))
        self.steps.append(self.step)
        if self.time is not None:
            self.times.append(self.time)
        self.time = self.step = self.count = None

    def finish(self) -> None:
        if self.step is not None or self.count is not None or self.time is not None:
            raise self.fail("the file ends before the atoms of its last time", len(self.lines) - 1)
        if self.times and len(self.times) < len(self.frames):
            raise CaseError(
                f"{self.path}: {len(self.times)} of {len(self.frames)} times have an ITEM: TIME; all or none"
            )

    def result(self) -> Frames:
        said = self.times or self.steps
        try:
            times = np.array(said, dtype=float)
            if unusable(times).any():
                raise ValueError
        except ValueError:
            raise CaseError(f"{self.path}: a time or step is not a finite number") from None
        groups = {"time": self.times} if self.times else {}
        largest = {"time": float(np.abs(times).max(initial=0.0))}
        for key in ("x y z", "vx vy vz", "mass", "diameter"):
            texts = [text for name in key.split() for text in self.texts.get(name, [])]
            if texts:
                groups[key] = texts
                largest[key] = max(
                    float(np.abs(frame[name]).max(initial=0.0))
                    for frame in self.frames for name in key.split() if name in frame
                )  # fmt: skip
        found = text_resolution(groups, largest)
        resolution = {name: value for key, value in found.items() for name in key.split()}
        declared = declare(self.path, self.units)
        return Frames(self.path, times, self.frames, resolution, declared, time_is_step=not self.times)
