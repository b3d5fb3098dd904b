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
RERUN_ENTRIES = ("changes.json", "changes.md")  # beside them, of a report that repeats another one
STAGING, PUBLISHED = ".unfinished", ".published"  # folders in that of a report: being made, done with
FINISHED = "finished"  # in the former: results that are there
PUBLISHING = "publishing"  # likewise: the report is whole and about to be moved
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


def stage_report(folder: Path, force: bool, resume: bool = False) -> Path:
    """A folder in which a report for `folder` can be made: empty, or to be resumed, what a killed run left.

    Raises OutputError when `folder` holds anything but an earlier report, unless `force`; when an unfinished
    report is there that has found something, unless `force` or `resume`; and when another process is writing.
    """
    staging = folder / STAGING
    if folder.is_dir() and not force and not is_report(folder):
        foreign = sorted(entry.name for entry in folder.iterdir() if entry.name not in (STAGING, PUBLISHED))
        if foreign and not (staging / PUBLISHING).exists():
            raise OutputError(
                f"{folder}: holds {foreign[0]} and no report of ours; choose another folder, or --force to "
                "put the report beside what is there"
            )
    if resume and is_report(folder) and not staging.is_dir():
        raise OutputError(
            f"{folder}: holds a complete report and no comparison to go on with; without --resume it is made "
            "anew"
        )
    writable(folder)
    _lock(folder)
    shutil.rmtree(folder / PUBLISHED, ignore_errors=True)
    if staging.is_dir() and not force and not resume and count_finished(staging):
        _unlock(folder)
        raise OutputError(
            f"{folder}: holds an unfinished comparison; --resume goes on with it, --force starts again"
        )
    if not resume:
        shutil.rmtree(staging, ignore_errors=True)
    staging.mkdir(exist_ok=True)
    return staging


def count_finished(staging: Path) -> int:
    """How many results an unfinished report holds."""
    return len(list((staging / FINISHED).glob("*/*.json")))


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
    """Move a finished report into its folder, in place of an earlier one; what was interrupted is ended."""
    if not (staging / PUBLISHING).exists():
        for name in (*REPORT_ENTRIES, *RERUN_ENTRIES):
            if not (staging / name).exists():
                _remove(folder / name)
        (staging / PUBLISHING).touch()
    for name in (*REPORT_ENTRIES, *RERUN_ENTRIES):
        if (staging / name).exists():  # else it has been moved before an interruption
            _remove(folder / name)
            os.replace(staging / name, folder / name)
    os.replace(staging, folder / PUBLISHED)
    shutil.rmtree(folder / PUBLISHED)
    _unlock(folder)


def release_report(staging: Path) -> None:
    """Leave an unfinished report that has found something as it is; remove one that has not."""
    if count_finished(staging):
        _unlock(staging.parent)
    else:
        discard_report(staging)


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
    files = [path.name for path in folder.rglob("*") if path.is_file()]
    begun = all(name == "case.toml" or name[0] == "." for name in files)  # and stopped before it recorded
    if held and resume and not ours and not begun:
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


def write_whole(path: Path, text: str) -> None:
    """Write a text file so that it is there as a whole or not at all, even after a loss of power.

    Raises OSError.
    """
    part = path.with_name(path.name + ".part")
    with part.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write(text)
        stream.flush()
        os.fsync(stream.fileno())
    part.replace(path)


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
