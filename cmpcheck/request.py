"""What one `cmpcheck compare` is asked for: from the command line, into the report, and back from a report.

Bad options are refused here, before anything is run; what is done with a request is `comparing.py`.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from cmpcheck import provenance
from cmpcheck.engines import engine_names, make_engine
from cmpcheck.outputs import write_whole
from cmpcheck.published import benchmark_names, load_benchmark
from cmpcheck.shell import BadInput
from cmpcheck.suite_cases import comparable_cases, variants_by_case
from cmpcheck.trajectories import Options, Trajectories, requested
from reference.case import available_cases, load_case
from reference.toml_source import nearest

INPUTS = "inputs"  # folder in data/ with the case files and decks of the user


@dataclass(frozen=True)
class Request:
    """Which cases, engines and studies are asked for, and the user's own files."""

    cases: tuple[str, ...]  # names or files
    engines: tuple[str, ...] | None  # None: all that are there
    profile: str  # quick | full
    studies: tuple[str, ...] = ()
    components: bool = False
    decks: Mapping[str, Path] = field(default_factory=dict)
    trajectories: Trajectories = field(default_factory=Trajectories)

    @property
    def variants(self) -> dict[str, list[str]]:
        """Each case's own name and its variants."""
        return variants_by_case(self.cases)

    def plain(self) -> dict[str, Any]:
        """What the report keeps of it, without the place of any file but a trajectory."""
        return {
            "cases": list(self.variants),
            "own_cases": [load_case(name).name for name in self.cases if not _ships(name)],
            "engines": None if self.engines is None else list(self.engines),
            "profile": self.profile,
            "studies": list(self.studies),
            "components": self.components,
            "decks": {case: file_digest(path) for case, path in sorted(self.decks.items())},
            "trajectories": {
                f"{case}/{variant}".rstrip("/"): {"file": os.path.relpath(path), "digest": file_digest(path)}
                for (case, variant), path in sorted(self.trajectories.files.items())
            },
            "options": asdict(self.trajectories.options),
        }

    def settings(self) -> dict[str, Any]:
        """Everything that a result depends on: what is asked for, cases, sources and versions."""
        infos = [make_engine(name).info() for name in self._engines()]
        return self.plain() | {
            "contents": {
                name: load_benchmark(name).digest
                if name in benchmark_names()
                else provenance.digest(load_case(name))
                for name in self.cases
            },
            "versions": {info.name: info.version for info in infos if info.available}
            | {name: provenance.version(name) for name in provenance.DISTRIBUTIONS},
            "sources": provenance.sources_digest(),
        }

    def _engines(self) -> list[str]:
        return [
            name for name in engine_names() if self.engines is None or name in ("reference", *self.engines)
        ]

    def keep_inputs(self, data: Path) -> None:
        """Copy the user's case files and decks to `data`, so that the report can be repeated from there."""
        files = {
            f"{load_case(name).name}.toml": load_case(name).toml() for name in self.cases if not _ships(name)
        }
        files |= {f"in.{case}": path.read_text("utf-8", "replace") for case, path in self.decks.items()}
        if files:
            (data / INPUTS).mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            write_whole(data / INPUTS / name, text)


def request_of(
    cases: Sequence[str],
    engines: Sequence[str],
    profile: str,
    decks: Sequence[str] = (),
    trajectories: Sequence[str] = (),
    options: Options | None = None,
    studies: Sequence[str] = (),
) -> Request:
    """The request of these options of `cmpcheck compare`.

    Raises BadInput and CaseError, in one line, for what cannot be done.
    """
    found = _studies(studies, everything=profile == "full" and not cases)
    names = tuple(cases) or (() if studies else tuple(comparable_cases(profile, engines)))
    variants = variants_by_case(names)
    if len(variants) < len(names):
        raise BadInput(f"a case is named twice among {', '.join(names)}; allowed: each case once")
    own = _decks(decks, variants)
    files = requested(trajectories, variants, options or Options())
    require_engines(engines)
    components = not cases and not studies
    return Request(names, tuple(engines) or None, profile, found, components, own, files)


def request_of_report(report: Path) -> Request:
    """The request that a report came from; report is its `report.json`, or the folder of that.

    The user's cases and decks are read from the report's data/inputs; cases that ship, as they are now.
    Raises BadInput for a file that is no such report, or lacks what is needed to repeat it.
    """
    file, document = read_report(report)
    asked = document.get("provenance", {}).get("request")
    if not isinstance(asked, dict):
        raise BadInput(f"{file}: does not say what was asked for: made by a version before `cmpcheck rerun`")
    inputs = file.parent / "data" / INPUTS
    try:
        cases = [_kept(inputs / f"{n}.toml") if n in asked["own_cases"] else n for n in asked["cases"]]
        decks = [f"{case}={_kept(inputs / f'in.{case}')}" for case in asked["decks"]]
        trajectories = [f"{where}={_known(found)}" for where, found in asked["trajectories"].items()]
        request = request_of(
            cases, asked["engines"] or [], asked["profile"], decks, trajectories,
            Options(**asked["options"]), asked["studies"],
        )  # fmt: skip
        return replace(request, studies=tuple(asked["studies"]), components=bool(asked["components"]))
    except (KeyError, TypeError, AttributeError) as problem:
        raise BadInput(f"{file}: the record of what was asked for is damaged ({problem!r})") from None


def read_report(report: Path) -> tuple[Path, dict[str, Any]]:
    """The file and the content of a report of ours.  Raises BadInput, in one line, for anything else."""
    file = report / "report.json" if report.is_dir() else report
    try:
        document = json.loads(file.read_text("utf-8"))
    except OSError as problem:
        raise BadInput(f"{file}: {problem.strerror}") from None
    except ValueError as problem:
        raise BadInput(f"{file}: no report: {problem}") from None
    if not isinstance(document, dict) or not str(document.get("schema", "")).startswith("cmpcheck-report/"):
        raise BadInput(f"{file}: no report of ours; allowed: the report.json that cmpcheck compare writes")
    return file, document


def require_engines(engines: Sequence[str]) -> None:
    """Raise BadInput for engines that do not exist or are not on this machine."""
    for name in engines:
        if name not in engine_names():
            raise BadInput(f"unknown engine {name!r}: {nearest(name, engine_names())}")
        info = make_engine(name).info()
        if not info.available:
            raise BadInput(f"the engine {name} is missing: {info.reason}")


def file_digest(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _ships(case: str) -> bool:
    return case in available_cases() or case in benchmark_names()


def _studies(names: Sequence[str], everything: bool) -> tuple[str, ...]:
    """The studies to run; raises BadInput for names that there are not."""
    if not names and not everything:
        return ()
    from cmpcheck.studies.registry import STUDIES

    for name in names:
        if name not in STUDIES:
            raise BadInput(f"unknown study {name!r}: {nearest(name, STUDIES)}")
    return tuple(names or STUDIES)


def _decks(entries: Sequence[str], cases: Mapping[str, list[str]]) -> dict[str, Path]:
    """The decks of `--deck CASE=FILE`, by case."""
    decks = {}
    for entry in entries:
        name, _, file = entry.partition("=")
        if not file or name not in cases:
            raise BadInput(
                f"--deck {entry}: allowed: CASE=FILE with a case that is compared: {', '.join(sorted(cases))}"
            )
        if not Path(file).is_file():
            raise BadInput(f"--deck {entry}: {file}: no such file")
        decks[name] = Path(file)
    return decks


def _kept(path: Path) -> str:
    if not path.is_file():
        raise BadInput(
            f"{path}: no such file; to repeat a report of one's own cases or decks, keep its data/"
        )
    return str(path)


def _known(found: Mapping[str, str]) -> str:
    """The file of a trajectory, where it was when the report was made."""
    path = Path(found["file"])
    if not path.is_file():
        raise BadInput(f"{path}: no such file; the report was made with it, from the present folder")
    return str(path)
