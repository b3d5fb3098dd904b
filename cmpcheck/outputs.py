"""Where results go: which folder may be written, what of it may be replaced, and when.

A report is made in a hidden folder inside its own and moved into place when it is whole, so that an
interrupted run leaves the earlier report as it was.  Files that are not ours are never removed.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
import shutil
import tempfile
from pathlib import Path
from typing import IO

from reference.checkpoint import INDEX

REPORT_ENTRIES = ("index.html", "report.md", "report.json", "junit.xml", "data")
STAGING = ".unfinished"
_LOCKS: dict[Path, IO[str]] = {}  # folders that this process is writing to


class OutputError(ValueError):
    """A folder or file that cannot or may not be written; one line for the user."""


def writable(folder: Path) -> Path:
    """The folder, made if need be; raises OutputError where nothing can be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as problem:
        raise OutputError(f"{folder}: cannot be written: {problem.strerror}") from None
    return folder


def is_report(folder: Path) -> bool:
    """Whether the folder holds a report of ours."""
    try:
        document = json.loads((folder / "report.json").read_text("utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(document, dict) and str(document.get("schema", "")).startswith("cmpcheck-report/")


def stage_report(folder: Path, force: bool) -> Path:
    """An empty folder in which a report for `folder` can be made.

    Raises OutputError when `folder` holds anything but an earlier report, unless `force`.
    """
    if folder.is_dir() and not force and not is_report(folder):
        foreign = sorted(entry.name for entry in folder.iterdir() if entry.name != STAGING)
        if foreign:
            raise OutputError(
                f"{folder}: holds {foreign[0]} and no report of ours; choose another folder, or --force to "
                "put the report beside what is there"
            )
    staging = writable(folder) / STAGING
    _lock(folder)
    shutil.rmtree(staging, ignore_errors=True)
    staging.mkdir()
    return staging


def _lock(folder: Path) -> None:
    """Keep other processes from writing to the same folder; the lock ends with the process."""
    key = folder.resolve()
    if key in _LOCKS:
        return
    name = hashlib.sha256(os.fsencode(key)).hexdigest()[:16]
    handle = (Path(tempfile.gettempdir()) / f"cmpcheck-{name}.lock").open("w")
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        handle.close()
        raise OutputError(f"{folder}: another run is writing there; choose another folder") from None
    _LOCKS[key] = handle


def _unlock(folder: Path) -> None:
    handle = _LOCKS.pop(folder.resolve(), None)
    if handle is not None:
        handle.close()


def publish_report(staging: Path, folder: Path) -> None:
    """Move a finished report into its folder, in place of an earlier one."""
    for name in REPORT_ENTRIES:
        _remove(folder / name)
        if (staging / name).exists():
            os.replace(staging / name, folder / name)
    shutil.rmtree(staging)
    _unlock(folder)


def discard_report(staging: Path) -> None:
    """Remove an unfinished report, and its folder if nothing else is in it."""
    shutil.rmtree(staging, ignore_errors=True)
    _unlock(staging.parent)
    with contextlib.suppress(OSError):
        staging.parent.rmdir()


def claim_run_folder(folder: Path, force: bool, resume: bool = False) -> Path:
    """The folder for a run, made if need be; unless it is resumed, marked as holding no complete run.

    Raises OutputError when it already holds something, unless `force`, or `resume` and it holds a run of
    ours; and when another process is writing there.
    """
    held = sorted(entry.name for entry in folder.iterdir()) if folder.is_dir() else []
    ours = any(folder.rglob("provenance.json")) or any(folder.rglob(INDEX))
    if held and resume and not ours:
        raise OutputError(
            f"{folder}: holds {held[0]} and no run to go on with; choose another folder, or --force to write "
            "over it"
        )
    if held and not resume and not force:
        ways = "--resume goes on with a run that is not complete" if ours else "choose another folder"
        raise OutputError(f"{folder}: exists already; {ways}, --force writes over it")
    writable(folder)
    _lock(folder)
    if not resume:
        for complete in folder.rglob("provenance.json"):
            complete.unlink()
        for index in folder.rglob(INDEX):
            shutil.rmtree(index.parent)
    return folder


def write_new(path: Path, text: str, force: bool) -> None:
    """Write a text file; raises OutputError where one exists, unless `force`, or none can be written."""
    if path.exists() and not force:
        raise OutputError(f"{path}: exists already; choose another name, or --force to write over it")
    try:
        path.write_text(text, "utf-8", newline="\n")
    except OSError as problem:
        raise OutputError(f"{path}: cannot be written: {problem.strerror}") from None


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
