"""What has been found so far, a file each, so that a run that is stopped loses at most the one at hand.

A folder holds the settings that it was started with; it goes on only with the same ones.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cmpcheck.outputs import OutputError, writable, write_whole
from cmpcheck.provenance import sources_digest

DOCUMENT, FOUND, SETTINGS = "sensitivity.json", "data", "settings.json"
OWN = (DOCUMENT, "index.html", "sensitivity.md", FOUND)
SHOWING = ("document", "words", "figures", "page", "command")  # of this package: they find nothing


def source_digest() -> str:
    """Digest of everything that a finding depends on: sources, cases and decks."""
    return sources_digest(lambda path: path.parent.name == "sensitivity" and path.stem in SHOWING)


@dataclass(frozen=True)
class Store:
    """Findings by kind and name, in files of one folder."""

    folder: Path

    @classmethod
    def create(cls, folder: Path, settings: dict[str, Any], force: bool) -> Store:
        """An empty store; raises OutputError where the folder holds anything but a result of ours."""
        held = sorted(entry.name for entry in folder.iterdir()) if folder.is_dir() else []
        foreign = [name for name in held if name not in OWN]
        if held and not force:
            unfinished, finished = (folder / FOUND / SETTINGS).is_file(), (folder / DOCUMENT).is_file()
            if foreign or not (unfinished or finished):
                what = (foreign or held)[0]
                raise OutputError(
                    f"{folder}: holds {what} and no result of ours; choose another folder, or --force"
                )
            if not finished:
                how = "--resume to go on with it, --force to start again, or choose another folder"
                raise OutputError(f"{folder}: holds an unfinished run; {how}")
        writable(folder)
        for name in OWN:
            path = folder / name
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink(missing_ok=True)
        (folder / FOUND).mkdir()
        write_whole(folder / FOUND / SETTINGS, json.dumps(settings, indent=1) + "\n")
        return cls(folder)

    @classmethod
    def resume(cls, folder: Path, settings: dict[str, Any]) -> Store:
        """The store of a run with these settings that goes on; raises OutputError for anything else."""
        try:
            kept = json.loads((folder / FOUND / SETTINGS).read_text("utf-8"))
        except (OSError, ValueError):
            raise OutputError(
                f"{folder}: holds no run to go on with; leave --resume out to start one"
            ) from None
        for key, value in settings.items():
            if kept.get(key) != value:
                what = (
                    "the sources have changed since" if key == "sources" else f"{key} was {kept.get(key)!r}"
                )
                raise OutputError(f"{folder}: {what}; --force starts again, or choose another folder")
        return cls(folder)

    def path(self, kind: str, name: str) -> Path:
        """Where a finding is kept; names that differ only in signs get files of their own."""
        slug = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")
        mark = hashlib.sha256(name.encode()).hexdigest()[:6]
        return self.folder / FOUND / kind / f"{slug}-{mark}.json"

    def get(self, kind: str, name: str) -> Any:
        """A finding, or None."""
        try:
            return json.loads(self.path(kind, name).read_text("utf-8"))
        except FileNotFoundError:
            return None

    def put(self, kind: str, name: str, found: Any) -> None:
        """Keep a finding."""
        path = self.path(kind, name)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, json.dumps(found, indent=1, ensure_ascii=False) + "\n")

    def count(self, kind: str) -> int:
        """How many findings of a kind there are."""
        return len(list((self.folder / FOUND / kind).glob("*.json")))
