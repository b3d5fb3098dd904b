"""What an unfinished comparison has found so far, a file each, so that a killed one goes on from there.

A file is whole or not there; one that cannot be read counts as not there, and what it held is found again.
What is kept under which name is `suite.py`'s business; whose results these are is said by `settings.json`.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cmpcheck.outputs import FINISHED, OutputError, write_whole
from cmpcheck.records import from_json, to_json

SETTINGS = "settings.json"


@dataclass(frozen=True)
class Finished:
    """Results by kind and name; without a folder nothing is kept."""

    folder: Path | None = None

    @classmethod
    def begin(cls, staging: Path, settings: dict[str, Any]) -> Finished:
        """An empty store in the folder of an unfinished report, for a comparison with these settings."""
        folder = staging / FINISHED
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        write_whole(folder / SETTINGS, json.dumps(settings, indent=1) + "\n")
        return cls(folder)

    @classmethod
    def go_on(cls, staging: Path, settings: dict[str, Any]) -> Finished:
        """The store of an unfinished comparison with the same settings.

        Raises OutputError, naming the first setting that differs, for another one.
        """
        try:
            kept = json.loads((staging / FINISHED / SETTINGS).read_text("utf-8"))
        except (OSError, ValueError):
            kept = None
        if not isinstance(kept, dict):
            raise OutputError(f"{staging.parent}: holds no comparison to go on with; --force starts again")
        for key in settings.keys() | kept.keys():
            if kept.get(key) != settings.get(key):
                raise OutputError(
                    f"{staging.parent}: the unfinished comparison is of other {key}: "
                    f"{_shown(kept.get(key), settings.get(key))}; allowed: to go on with what began it, or "
                    "to start again with --force"
                )
        return cls(staging / FINISHED)

    def get(self, kind: str, name: str) -> Any:
        """A result, None where there is none."""
        if self.folder is None:
            return None
        try:
            return from_json(self._path(kind, name).read_text("utf-8"))
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def put(self, kind: str, name: str, found: Any) -> None:
        """Keep a result.  Raises OSError."""
        if self.folder is not None:
            path = self._path(kind, name)
            path.parent.mkdir(exist_ok=True)
            write_whole(path, to_json(found) + "\n")

    def _path(self, kind: str, name: str) -> Path:
        assert self.folder is not None
        slug = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")
        return self.folder / kind / f"{slug}-{hashlib.sha256(name.encode()).hexdigest()[:8]}.json"


def _shown(before: Any, now: Any) -> str:
    """Where two settings differ."""
    if isinstance(before, dict) and isinstance(now, dict):
        key = min(key for key in before.keys() | now.keys() if before.get(key) != now.get(key))
        return f"{key} was {before.get(key)!r}, is {now.get(key)!r}"
    return f"was {before!r}, is {now!r}"
