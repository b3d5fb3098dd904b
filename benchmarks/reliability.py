"""What the project survives, measured: `python -m benchmarks.reliability` writes `reports/reliability.md`.

Options: --profile quick|full (default full: more than an hour), --section NAME (may be repeated: only these
are measured, the others stay as they were), --out FOLDER.  The page is a list of sections, each the
`findings(full)` of a module `reliability_NAME.py`, and written after each of them; what was found is kept
beside it, in `reliability.json`.  Exit code 1 when anything does not hold or is missing.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import json
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.reliability_finding import Finding
from cmpcheck import provenance
from cmpcheck.display import duration, number
from cmpcheck.markdown import pipe_table, plain
from cmpcheck.outputs import write_whole

PAGE, KEPT = "reliability.md", "reliability.json"


class Section(NamedTuple):
    """One part of the page."""

    name: str  # of the module reliability_NAME.py
    title: str
    promise: str


SECTIONS = (
    Section(
        "kill", "Killed",
        "A run, a comparison or a search that is killed by SIGKILL at any moment goes on with --resume to "
        "the same arrays.  A run loses at most the time since its last checkpoint (every 10 s; here every "
        "0.3 s), a comparison the variants of cases and a search the samples that were in flight.  A file is "
        "there under its name as a whole or not at all.",
    ),
    Section(
        "disk", "Disk full, folder gone, no permission",
        "One line, exit code 1 or 2, no traceback; what was written before is readable, and --resume goes on "
        "to the same arrays.  A comparison whose workers cannot write is a whole report, exit code 1, whose "
        "rows are errors that say it; the same command makes it anew.",
    ),
    Section(
        "engines", "Engines that fail",
        "A crash, a hang, an error, a lost particle or a broken fix in LAMMPS, LIGGGHTS or an engine of "
        "another package is `error` for that engine's comparisons of that variant, with the reason and the "
        "last lines of its log; the rest goes on.  Each runs in a child process of the worker; a run that "
        "takes longer than `[engine.NAME] timeout`, 600 s where the case says nothing, is ended.",
    ),
    Section(
        "repeat", "The same bits",
        "A case and its seed give the same arrays whatever the number of workers and threads, the folder, "
        "the locale, the time zone, and whether compiled code was there.",
    ),
    Section(
        "inputs", "Bad input",
        "Files are data: no input gives a traceback, a hang, or a wrong `agree`.",
    ),
    Section(
        "extremes", "Extremes of physics",
        "Each gives the right answer or one clear error.",
    ),
    Section(
        "long_runs", "Long runs",
        "Memory is bounded, and the balances close within the derived bounds.",
    ),
    Section(
        "packaging", "Packaging",
        "What is built can be installed and used outside of the checkout, with and without other engines.",
    ),
    Section(
        "versions", "Versions of dependencies",
        "The lowest and the newest version of each direct dependency that is allowed pass the cheap tests.",
    ),
)  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, write the page, and return the exit code."""
    names = [section.name for section in SECTIONS if _module(section.name)]
    parser = argparse.ArgumentParser(prog="python -m benchmarks.reliability", description=__doc__)
    parser.add_argument("--profile", choices=("quick", "full"), default="full")
    parser.add_argument("--section", choices=names, action="append")
    parser.add_argument("--out", type=Path, default=Path("reports"))
    asked = parser.parse_args(arguments)
    kept = _read(asked.out / KEPT)
    for name in asked.section or names:
        begin, found = time.perf_counter(), []
        for finding in _findings(name, asked.profile == "full"):
            print(finding.line(), flush=True)
            found.append(finding)
            kept[name] = record(found, asked.profile, time.perf_counter() - begin) | {"ended": False}
            _write(asked.out, kept)
        kept[name] = record(found, asked.profile, time.perf_counter() - begin)
        _write(asked.out, kept)
    ended = all(entry.get("ended", True) for entry in kept.values())
    return int(not ended or not all(found["holds"] for entry in kept.values() for found in entry["findings"]))


def _write(folder: Path, kept: dict[str, Any]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / KEPT, json.dumps(kept, indent=1, ensure_ascii=False) + "\n")
    write_whole(folder / PAGE, page(kept))


def _module(name: str) -> str:
    """The module of a section, "" where there is none."""
    module = f"benchmarks.reliability_{name}"
    return module if importlib.util.find_spec(module) else ""


def _findings(name: str, full: bool) -> Iterator[Finding]:
    """Those of a section, as they come; one that breaks off is a finding that does not hold."""
    try:
        yield from importlib.import_module(_module(name)).findings(full)
    except Exception as problem:  # the other sections are measured all the same
        text = " ".join(str(problem).split())[:400]
        yield Finding(f"the section {name}", "Measured.", f"{type(problem).__name__}: {text}", False)


def _read(path: Path) -> dict[str, Any]:
    try:
        found: dict[str, Any] = json.loads(path.read_text("utf-8"))
    except FileNotFoundError:
        return {}
    return found


def record(found: Sequence[Finding], profile: str, seconds: float) -> dict[str, Any]:
    """What is kept of a section, with what it was measured on."""
    machine, versions = provenance.machine(), provenance.collect()["versions"]
    return {
        "profile": profile,
        "seconds": seconds,
        "commit": provenance.commit(),
        "machine": f"{machine['processors']} processors {machine['processor']}, {machine['system']}",
        "versions": {name: versions[name] for name in ("numpy", "numba", "h5py", "lammps")},
        "findings": [finding._asdict() | {"holds": bool(finding.holds)} for finding in found],
    }


def page(kept: dict[str, Any]) -> str:
    """The page of everything that was found."""
    findings = [finding for entry in kept.values() for finding in entry["findings"]]
    failed = [finding for finding in findings if not finding["holds"]]
    lines = [
        "# What cmpcheck survives", "",
        "Written by `make reliability`; every number was measured.  Tests keep the quick part true.", "",
        f"{len(findings) - len(failed)} of {len(findings)} promises hold."
        + (f"  Not: {', '.join(plain(finding['name']) for finding in failed)}." if failed else ""),
    ]  # fmt: skip
    for section in SECTIONS:
        if section.name in kept:
            lines += ["", f"## {section.title}", "", section.promise, "", *_section(kept[section.name])]
    return "\n".join(lines) + "\n"


def _section(entry: dict[str, Any]) -> list[str]:
    rows = [
        ["holds" if found["holds"] else "FAILS", found["name"], found["done"], found["outcome"],
         "; ".join(f"{name}: {_shown(value)}" for name, value in found["numbers"].items())]
        for found in entry["findings"]
    ]  # fmt: skip
    missing = "" if entry.get("ended", True) else "**Interrupted: what was not tried is missing.**  "
    commit = entry["commit"]
    made_with = ", ".join(f"{name} {version}" for name, version in entry["versions"].items())
    return [
        *pipe_table(["", "what", "done", "outcome", "measured"], rows), "",
        f"{missing}Profile {entry['profile']}, {duration(entry['seconds'])}; {plain(entry['machine'])}; "
        f"{made_with}; commit {commit[:12] or 'unknown'}{'-modified' * commit.endswith('-modified')}.",
    ]  # fmt: skip


def _shown(value: float | str) -> str:
    return number(value, 4) if isinstance(value, float) else str(value)


if __name__ == "__main__":
    sys.exit(main())
