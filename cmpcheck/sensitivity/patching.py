"""Copies of the sources with seeded errors in them; the checkout itself is never touched.

A plain copy has one error, of one size.  A guarded copy has all of them: where the text of a function differs
both statements stand side by side, and `switch.py` says which one runs.
"""

from __future__ import annotations

import ast
import copy
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cmpcheck.provenance import PARTS
from cmpcheck.sensitivity.mutants import Mutant

SIZE = "SIZE"
IMPORT = "from cmpcheck.sensitivity.switch import seeded, seeded_size"


class PatchError(ValueError):
    """A seeded error that does not fit the sources."""


def project_root() -> Path:
    """The folder with the packages and the decks: the checkout, or an installed package's parent."""
    return Path(__file__).parents[2]


def copy_tree(folder: Path) -> Path:
    """Copy the packages and the decks into `folder`, which is made; returns it."""
    root = project_root()
    for part in PARTS:
        source = root / part
        if part == "lammps_inputs" and not source.is_dir():  # an installed package has them inside
            continue
        ignore = shutil.ignore_patterns("__pycache__", "*.nbi", "*.nbc")
        shutil.copytree(source, folder / part, ignore=ignore)
    return folder


def deck_file(tree: Path, mutant: Mutant) -> Path:
    """The file of a mutant in a copied tree; decks lie inside the package when it is installed."""
    path = tree / mutant.file
    return path if path.exists() else tree / "cmpcheck" / mutant.file


def patched(text: str, mutant: Mutant, size: str) -> str:
    """The text with the error in it, of the size that the expression `size` gives.

    Raises PatchError unless `old` occurs exactly once.
    """
    found = text.count(mutant.old)
    if found != 1:
        raise PatchError(
            f"{mutant.name}: {mutant.old!r} occurs {found} times in {mutant.file}; allowed: once"
        )
    return text.replace(mutant.old, mutant.new.replace(SIZE, size))


def seed_one(tree: Path, mutant: Mutant, size: float | None = None) -> None:
    """Put one error into a plain copy, for good."""
    path = deck_file(tree, mutant)
    text = patched(path.read_text("utf-8"), mutant, repr(mutant.size if size is None else size))
    path.write_text(text, "utf-8")


def seed_all(tree: Path, mutants: Sequence[Mutant]) -> None:
    """Put every error of a Python file into a guarded copy; that of `mutants[k]` runs while seeded(k).

    Decks are not guarded: see `checks.py`.
    """
    files: dict[str, list[tuple[int, Mutant]]] = {}
    for number, mutant in enumerate(mutants):
        if mutant.file.endswith(".py"):
            files.setdefault(mutant.file, []).append((number, mutant))
        else:
            patched(deck_file(tree, mutant).read_text("utf-8"), mutant, "0")
    for file, own in files.items():
        path = tree / file
        path.write_text(guarded(path.read_text("utf-8"), own), "utf-8")


@dataclass
class _Edit:
    """A range of the statements of one block, and what stands there in a mutant."""

    first: int
    last: int  # exclusive
    number: int
    statements: list[ast.stmt]


def guarded(text: str, mutants: Sequence[tuple[int, Mutant]]) -> str:
    """The source with every mutant in it, each behind `if seeded(number)`."""
    tree = ast.parse(text)
    edits: dict[int, list[_Edit]] = {}
    for number, mutant in mutants:
        changed = ast.parse(patched(text, mutant, "seeded_size()"))
        if ast.dump(changed) != ast.dump(tree):  # a mutant that changes nothing needs no guard
            _compare(tree, changed, number, mutant, edits)
    _rewrite(tree, edits)
    place = 1 + max(
        k
        for k, s in enumerate(tree.body)
        if k == 0 or (isinstance(s, ast.ImportFrom) and s.module == "__future__")
    )
    tree.body[place:place] = ast.parse(IMPORT).body
    return ast.unparse(ast.fix_missing_locations(tree)) + "\n"


def _blocks(node: ast.AST) -> list[str]:
    """The fields of a node that hold statements."""
    return [
        name
        for name in ("body", "orelse", "finalbody")
        if isinstance(getattr(node, name, None), list) and getattr(node, name)
    ]


def _header(node: ast.AST) -> str:
    """A node without its blocks."""
    bare = copy.copy(node)
    for name in _blocks(node):
        setattr(bare, name, [])
    return ast.dump(bare)


def _compare(a: ast.AST, b: ast.AST, number: int, mutant: Mutant, edits: dict[int, list[_Edit]]) -> None:
    """Find the smallest block of statements in which two sources differ, and enter it as an edit."""
    for name in _blocks(a):
        ours, theirs = getattr(a, name), getattr(b, name)
        dumps, others = [ast.dump(s) for s in ours], [ast.dump(s) for s in theirs]
        if dumps == others:
            continue
        first = 0
        while first < min(len(ours), len(theirs)) and dumps[first] == others[first]:
            first += 1
        tail = 0
        while tail < min(len(ours), len(theirs)) - first and dumps[-1 - tail] == others[-1 - tail]:
            tail += 1
        last, end = len(ours) - tail, len(theirs) - tail
        if last - first == end - first == 1:
            x, y = ours[first], theirs[first]
            if type(x) is type(y) and _blocks(x) == _blocks(y) != [] and _header(x) == _header(y):
                _compare(x, y, number, mutant, edits)
                continue
        if isinstance(a, (ast.Module, ast.ClassDef)):
            raise PatchError(f"{mutant.name}: the change in {mutant.file} is not inside a function")
        edits.setdefault(id(ours), []).append(_Edit(first, last, number, theirs[first:end]))


def _rewrite(node: ast.AST, edits: dict[int, list[_Edit]]) -> None:
    """Put the edits into the blocks of a node, innermost first."""
    for name in _blocks(node):
        block = getattr(node, name)
        own = edits.get(id(block), [])
        original = copy.deepcopy(block)  # what mutants keep of it has no further guards
        for statement in block:
            _rewrite(statement, edits)
        for group in reversed(_overlapping(own)):
            first, last = min(e.first for e in group), max(e.last for e in group)
            otherwise = block[first:last] or [ast.Pass()]
            for edit in reversed(group):
                mutated = [*original[first : edit.first], *edit.statements, *original[edit.last : last]]
                test = ast.parse(f"seeded({edit.number})", mode="eval").body
                otherwise = [ast.If(test=test, body=mutated or [ast.Pass()], orelse=otherwise)]
            block[first:last] = otherwise


def _overlapping(edits: list[_Edit]) -> list[list[_Edit]]:
    """Edits of one block in groups that share statements, in order."""
    groups: list[list[_Edit]] = []
    for edit in sorted(edits, key=lambda e: (e.first, e.last)):
        if groups and edit.first < max(e.last for e in groups[-1]):
            groups[-1].append(edit)
        else:
            groups.append([edit])
    return groups
