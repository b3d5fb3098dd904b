"""Where a result came from: the commit, the content of the case, the kind of machine.

No dates, user names, host names or absolute paths, so that it can be published as it is.  What else a record
of a result holds is `recording.py`'s business, and the suite's.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

from reference.case import Case


def machine() -> dict[str, Any]:
    """The kind of machine that this is: system, architecture, model of processor and their number."""
    return {
        "system": platform.system(),
        "architecture": platform.machine(),
        "processor": _processor(),
        "processors": os.cpu_count() or 1,
    }


@cache
def _processor() -> str:
    """The model of the processor, "" where the system does not tell it."""
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8", "replace").splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")


def digest(case: Case) -> str:
    """SHA-256 of a case's content: equal for equal physics and settings, whatever the file's spelling."""
    content = json.dumps(case.model_dump(mode="json", by_alias=True), sort_keys=True, ensure_ascii=True)
    return hashlib.sha256(content.encode()).hexdigest()


@cache
def commit(root: Path | None = None) -> str:
    """The commit of the checkout at `root` (default: the one that this file runs from), "" outside of one.

    "-modified" is appended when tracked files differ from it.
    """
    root = Path(__file__).parents[1] if root is None else root
    if not (root / ".git").exists():
        return ""
    head = _git(root, "rev-parse", "HEAD")
    if not head:
        return ""
    return head + ("-modified" if _git(root, "status", "--porcelain", "--untracked-files=no") else "")


def _git(root: Path, *arguments: str) -> str:
    """Output of a git command in `root`; "" if git is missing or refuses."""
    try:
        done = subprocess.run(
            ["git", "-C", str(root), *arguments], capture_output=True, text=True, timeout=30, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""
