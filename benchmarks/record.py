"""What a benchmark says of itself: machine, versions, date and load; and `results.json`, where numbers go."""

from __future__ import annotations

import json
import os
import platform
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from cmpcheck import provenance
from cmpcheck.engines import liggghts_library

RESULTS = Path(__file__).with_name("results.json")
WATCHED = 0.5  # s


def conditions(command: str) -> dict[str, Any]:
    """Command, date, commit, machine and versions, to be kept beside what was measured."""
    versions = {name: provenance.version(name) for name in provenance.DISTRIBUTIONS}
    return {
        "command": command,
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "commit": provenance.commit(),
        "machine": f"{os.cpu_count()} cores of {_processor()}, {platform.system()} {platform.machine()}",
        "versions": {
            "python": platform.python_version(), **versions,
            "liggghts": liggghts_library.version() or "not installed",
        },
    }  # fmt: skip


def shown(commit: str) -> str:
    """A commit in short, and whether there were changes on top of it."""
    name, _, changed = commit.partition("-")
    return name[:12] + (", with changes on top" if changed else "")


def _processor() -> str:
    """The name of the processor, as Linux has it."""
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or "unknown"


def busy_cores(seconds: float = WATCHED) -> float:
    """How many cores are at work now, watched for some time in which the caller does nothing.

    Where Linux's /proc/stat is missing: the load average of the last minute, which the caller is part of.
    """
    try:
        before = _ticks()
        time.sleep(seconds)
        after = _ticks()
    except OSError:
        return os.getloadavg()[0]
    total, idle = after[0] - before[0], after[1] - before[1]
    return (os.cpu_count() or 1) * (1.0 - idle / total) if total else 0.0


def _ticks() -> tuple[int, int]:
    """All ticks of all cores, and those in which they waited."""
    ticks = [int(word) for word in Path("/proc/stat").read_text("ascii").splitlines()[0].split()[1:9]]
    return sum(ticks), ticks[3] + ticks[4]


def load(path: Path = RESULTS) -> dict[str, Any]:
    """What `results.json` holds; nothing where there is none."""
    found: dict[str, Any] = json.loads(path.read_text("utf-8")) if path.exists() else {}
    return found


def store(values: dict[str, Any], path: Path = RESULTS) -> None:
    """Replace these keys of `results.json` and keep the others."""
    path.write_text(json.dumps(load(path) | values, indent=1, sort_keys=True) + "\n", "utf-8")
