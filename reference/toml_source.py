"""Where a case was written: reads TOML, finds the line of a key, and words the error about it.

What a case may contain is `case.py`; nothing here knows a key by name.
"""

from __future__ import annotations

import bisect
import difflib
import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pydantic import ValidationError

Key = tuple[str | int, ...]
MOST_BYTES = 2_000_000  # of a case file: 10 000 particles placed by hand, and room for words
MOST_LEVELS = 20  # of tables within tables; a case needs five
MOST_SEARCHED = 2_000_000  # characters that are parsed again to find the line of a key, a second or two
LONGEST = 60  # characters of a value that are shown
WORD = re.compile(r"[\w-]{1,60}")  # keys that are shown as they are
MISSING = object()  # the value of a key that is not there


class CaseError(ValueError):
    """A case that cannot be used; its one-line message names file, key, value and what is allowed."""


class Refusal(ValueError):
    """A value refused by a rule, before it is known where in a file the value stands."""

    def __init__(self, key: Key, value: object, allowed: str) -> None:
        super().__init__(allowed)
        self.key, self.value, self.allowed = key, value, allowed


class TomlSource:
    """The text of a TOML file, its data, and the errors about its keys.

    Raises CaseError if the file cannot be read or is not TOML.
    """

    def __init__(self, path: Path | None, text: str = "") -> None:
        self.path, self.text = path, text
        if path is not None:
            try:
                self.text = _read(path)
            except FileNotFoundError:
                raise CaseError(f"{path}: no such file") from None
            except (OSError, UnicodeDecodeError) as problem:
                reason = getattr(problem, "strerror", None) or "not UTF-8 text"
                raise CaseError(f"{path}: cannot be read: {reason}") from None
        try:
            self.data: dict[str, Any] = tomllib.loads(self.text)
        except (ValueError, RecursionError) as problem:  # a number of 5000 digits is a ValueError alone
            raise self._malformed(str(problem)) from None
        if not _is_shallow(self.data):
            raise CaseError(
                f"{self.path or 'case'}: tables within tables; allowed: up to {MOST_LEVELS} levels"
            )

    def _malformed(self, message: str) -> CaseError:
        found = re.search(r"line (\d+)", message)
        line = int(found.group(1)) if found else len(self.text.splitlines())
        written = (self.text.splitlines() or [""])[min(line, len(self.text.splitlines())) - 1].strip()
        return CaseError(
            f"{self.path}:{line}: malformed TOML at {_shown(written)}: {message}; "
            'allowed: lines such as key = value, with text in "quotes"'
        )

    def line(self, key: Key) -> int:
        """Line (from 1) on which `key`, or the last part of it that is there, is complete; 0 if none is.

        0 also where the search would take long, as in a list of thousands of lines.
        """
        lines, left = self.text.splitlines(keepends=True), MOST_SEARCHED
        while key and _found(self.data, key) is MISSING:
            key = key[:-1]

        def complete(n: int) -> bool:
            nonlocal left
            for end in range(n, 0, -1):  # a cut inside a value of several lines does not parse: step back
                part = "".join(lines[:end])
                left -= len(part)
                if left < 0:
                    break
                try:
                    return _found(tomllib.loads(part), key) is not MISSING
                except ValueError:
                    continue
            return False

        found = bisect.bisect_left(range(len(lines)), True, key=complete) if key else 0
        return found if left >= 0 else 0

    def error(self, key: Key, value: object, allowed: str, variant: int | None = None) -> CaseError:
        """The error about a key, which variant number `variant` may have overridden; `value` as written."""
        where, note, at = str(self.path or "case"), "", key
        if variant is not None:
            note = f"variant {self.data['variant'][variant].get('name', variant)!r}: "
            overridden: Key = ("variant", variant, "overrides", *key)
            at = overridden if _found(self.data, overridden) is not MISSING else key
        line = self.line(at)
        written = value if value is MISSING or _found(self.data, at) is MISSING else _found(self.data, at)
        shown = "" if value is MISSING else f" = {_shown(written)}"
        return CaseError(f"{where}{f':{line}' if line else ''}: {note}{spelled(key)}{shown}: {allowed}")

    def translate(self, problem: ValidationError, variant: int | None = None) -> CaseError:
        """The first error that pydantic found, as a CaseError."""
        first = problem.errors(include_url=False)[0]
        key, value = tuple(first["loc"]), first["input"]
        cause = first.get("ctx", {}).get("error")
        if isinstance(cause, Refusal):
            return self.error((*key, *cause.key), cause.value, cause.allowed, variant)
        if first["type"] == "missing":
            return self.error(key, MISSING, "required, but missing", variant)
        allowed = str(cause) if cause else first["msg"].replace("Input should be ", "allowed: ", 1)
        return self.error(key, value, allowed, variant)


def spelled(key: Key) -> str:
    """A key as one writes it: particle[0].diameter."""
    parts = (part if isinstance(part, int) or WORD.fullmatch(part) else _shown(part) for part in key)
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts).lstrip(".")


def one_line(problem: object, longest: int = 240) -> str:
    """What a library has to say of a file: one line of printable characters, of bounded length."""
    text = " ".join(str(problem).split())[:longest]
    return "".join(sign if sign.isprintable() else "\ufffd" for sign in text)


def nearest(name: object, known: Iterable[str]) -> str:
    """`did you mean X? ` if a known name is near, and the list of all known ones."""
    names = sorted(known)
    near = difflib.get_close_matches(str(name)[:LONGEST], names, n=1)
    return (f"did you mean {near[0]!r}? " if near else "") + "known: " + (", ".join(names) or "none")


def _read(path: Path) -> str:
    """The text of a file, which is not read when it is too large for a case."""
    if path.is_file() and path.stat().st_size > MOST_BYTES:
        raise CaseError(f"{path}: {path.stat().st_size} bytes; allowed: a case file, up to {MOST_BYTES}")
    return path.read_text(encoding="utf-8")


def _is_shallow(data: Any) -> bool:
    """Whether tables and lists are not nested too deep; without recursion, which would end too early."""
    level = [data]
    for _ in range(MOST_LEVELS):
        level = [
            inner
            for part in level
            for inner in (part.values() if isinstance(part, dict) else part)
            if isinstance(inner, dict | list)
        ]
        if not level:
            return True
    return False


def _shown(value: object) -> str:
    try:
        text = ascii(value) if isinstance(value, str) and not value.isprintable() else repr(value)
    except ValueError:  # a whole number of more digits than Python writes
        return "a number of thousands of digits"
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."


def _found(data: Any, key: Key) -> Any:
    for part in key:
        try:
            data = data[part]
        except (KeyError, IndexError, TypeError):
            return MISSING
    return data
