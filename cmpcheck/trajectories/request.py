"""Which trajectory belongs to which run of a case: what `--trajectory CASE=FILE` asks for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from cmpcheck.judges import judge_of
from cmpcheck.trajectories.starts import Options, evidence
from reference.case import Case
from reference.state import Setup
from reference.toml_source import CaseError, nearest


@dataclass(frozen=True)
class Trajectories:
    """Files by case and variant, and what the command line says of all of them."""

    files: Mapping[tuple[str, str], Path] = field(default_factory=dict)
    options: Options = field(default_factory=Options)

    def of(self, case: Case) -> Path | None:
        """The file of a variant."""
        return self.files.get((case.name, case.variant))

    def check(self, setup: Setup) -> None:
        """Read the file of a setup, if there is one.  Raises CaseError when it cannot be compared."""
        path = self.of(setup.case)
        if path is not None:
            evidence(path, setup, self.options, judge_of(setup))


def requested(entries: Iterable[str], cases: Mapping[str, list[str]], options: Options) -> Trajectories:
    """The files of `CASE=FILE` or `CASE/VARIANT=FILE`.

    Parameters: cases, the variants of each case that is compared, [""] without any.
    Raises CaseError for another case, a variant that is missing or unknown, and a run that is named twice.
    """
    files: dict[tuple[str, str], Path] = {}
    for entry in entries:
        where, _, file = entry.partition("=")
        name, _, variant = where.partition("/")
        said = f"--trajectory {entry}"
        if not file or name not in cases:
            raise CaseError(
                f"{said}: allowed: CASE=FILE with a case that is compared: {', '.join(sorted(cases))}"
            )
        variants = cases[name]
        if len(variants) == 1 and not variant:
            variant = variants[0]
        if variant not in variants:
            one = "" if variant else "the case has variants, name one as in CASE/VARIANT=FILE; "
            raise CaseError(f"{said}: {one}{nearest(variant, variants)}")
        if (name, variant) in files:
            raise CaseError(f"{said}: a second file for {where}; allowed: one")
        if not Path(file).is_file():
            raise CaseError(f"{said}: {file}: no such file")
        files[name, variant] = Path(file)
    return Trajectories(files, options)
