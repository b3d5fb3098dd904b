"""Mutation testing of the tests: which of them fail while an error is on.

The tests run in the guarded copy with the error named in the environment (`switch.py`), so that nothing is
compiled for a single one.  Only errors of the model are asked: those of the reference's files.  Of the tests
those that reach an error's file by imports are asked, by the fewest steps first.
"""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from cmpcheck.sensitivity.mutants import Mutant
from cmpcheck.sensitivity.patching import project_root
from cmpcheck.sensitivity.store import Store
from cmpcheck.sensitivity.switch import VARIABLE
from cmpcheck.sensitivity.worker import TREE

Progress = Callable[[str, int, int], None]
KIND, BEFORE = "tests", "before"
PATIENCE = 1800.0  # s for the tests with one error
NONE_COLLECTED = 5  # what pytest ends with where files hold no test
FAILED = re.compile(r"^(?:FAILED|ERROR) (\S.*?)(?: - .*)?$", re.MULTILINE)  # names of parameters have spaces
# The tests of the model, those that fail soonest first; the rest needs a checkout, or runs other programs.
FILES = (
    "contact", "drag", "removal", "heightfield", "neighbors", "flatness", "genetic", "ensemble", "packing",
    "pad", "process", "timestep", "simulation", "balances", "phases", "new_contacts", "exact_surface",
    "exact_flow", "judges", "case_files", "recording", "checkpoint", "components", "fast",
)  # fmt: skip


def available() -> bool:
    """Whether the tests and their tools are here: they are in a checkout, not in an installed package."""
    from importlib.util import find_spec

    return (project_root() / "tests").is_dir() and find_spec("pytest") is not None


def keep(store: Store, mutants: Sequence[Mutant], jobs: int, work: Path, progress: Progress) -> None:
    """Ask the tests about every error of the reference's files."""
    from cmpcheck.sensitivity.children import prepare, run_parallel

    asked = [k for k, m in enumerate(mutants) if m.file.startswith("reference/") and m.side == "reference"]
    left = [k for k in asked if store.get(KIND, mutants[k].name) is None]
    if not available() or not left:
        return
    if not (work / TREE).exists():
        prepare(work, list(mutants))
    if not (work / TREE / "tests").exists():
        shutil.copytree(project_root() / "tests", work / TREE / "tests")
        shutil.copy(project_root() / "pyproject.toml", work / TREE)
    progress("tests", len(asked) - len(left), len(asked))
    before = store.get(BEFORE, "tests")
    if before is None:
        before = failing(work, None, 0.0, [], [*test_files(), "reference"], first_only=False)
        store.put(BEFORE, "tests", before)

    def one(number: int, found: list[str]) -> None:
        store.put(KIND, mutants[number].name, found)
        progress("tests", sum(store.get(KIND, mutants[k].name) is not None for k in asked), len(asked))

    steps = import_steps(work / TREE)

    def ask(_: Any, number: int) -> list[str]:
        mutant = mutants[number]
        return failing(work, number, mutant.size, before, reaching(steps, mutant.file))

    run_parallel(left, ask, [None] * jobs, one)  # type: ignore[list-item]


def test_files() -> list[str]:
    """The tests of the model in a tree."""
    return [f"tests/test_{name}.py" for name in FILES]


def import_steps(tree: Path) -> dict[str, dict[str, int]]:
    """For each file of tests, and of the model with its doctests: what it reaches, and in how many steps.

    A step is an import, wherever in a module it stands.
    """
    paths = [path for part in ("reference", "cmpcheck") for path in sorted((tree / part).rglob("*.py"))]
    own = {path.relative_to(tree).as_posix() for path in paths}
    known = {name: _imported(tree / name, own) for name in [*test_files(), *sorted(own)]}
    return {
        name: _steps(name, known)
        for name in [*test_files(), *sorted(n for n in own if Path(n).parent == Path("reference"))]
    }


def _steps(start: str, known: dict[str, set[str]]) -> dict[str, int]:
    """Steps from one file to all that it reaches, by breadth."""
    found, edge = {start: 0}, [start]
    while edge:
        edge = [name for name in sorted(set().union(*(known[e] for e in edge))) if name not in found]
        found |= dict.fromkeys(edge, max(found.values()) + 1)
    return found


def reaching(steps: dict[str, dict[str, int]], file: str) -> list[str]:
    """The files of tests that reach a file, the nearest first."""
    near = [name for name, reached in steps.items() if file in reached]
    return sorted(near, key=lambda name: steps[name][file])  # stable: as in FILES among equals


def _imported(path: Path, own: set[str]) -> set[str]:
    """Those of the files `own` that a module imports: modules, and the packages that they are in."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    stems = [name.replace(".", "/") for name in names]
    return {file for stem in stems for file in (f"{stem}.py", f"{stem}/__init__.py") if file in own}


def failing(
    work: Path,
    number: int | None,
    size: float,
    without: Sequence[str],
    files: Sequence[str],
    first_only: bool = True,
) -> list[str]:
    """Tests of `files` that fail in the guarded copy, or the first of them.

    Those in `without` are left out, as they fail without an error.
    Parameters: number of the error, None for none.
    """
    if not files:
        return []
    tree = work / TREE
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist"]
    command += ["-m", "not slow", *(["-x"] if first_only else [])]
    command += [*(f"--deselect={name}" for name in without), *files]
    environment = os.environ | {
        "NUMBA_CACHE_DIR": str(work / "numba"), "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1",
    } | ({} if number is None else {VARIABLE: f"{number} {size!r}"})  # fmt: skip
    try:
        done = subprocess.run(
            command, cwd=tree, env=environment, capture_output=True, text=True, timeout=PATIENCE, check=False
        )
    except subprocess.TimeoutExpired:
        return [f"no end within {PATIENCE:g} s"]
    found = sorted(set(FAILED.findall(done.stdout)))
    if done.returncode not in (0, NONE_COLLECTED) and not found:
        return [f"pytest ended with code {done.returncode}"]
    return found
