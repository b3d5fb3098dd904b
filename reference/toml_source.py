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
                self.text = path.read_text(encoding="utf-8")
            except FileNotFoundError:
                raise CaseError(f"{path}: no such file") from None
            except (OSError, UnicodeDecodeError) as problem:
                reason = getattr(problem, "strerror", None) or "not UTF-8 text"
                raise CaseError(f"{path}: cannot be read: {reason}") from None
        try:
            self.data: dict[str, Any] = tomllib.loads(self.text)
        except (tomllib.TOMLDecodeError, RecursionError) as problem:
            raise self._malformed(str(problem)) from None

    def _malformed(self, message: str) -> CaseError:
        found = re.search(r"line (\d+)", message)
        line = int(found.group(1)) if found else len(self.text.splitlines())
        written = (self.text.splitlines() or [""])[min(line, len(self.text.splitlines())) - 1].strip()
        return CaseError(
            f"{self.path}:{line}: malformed TOML at {_shown(written)}: {message}; "
            'allowed: lines such as key = value, with text in "quotes"'
        )

    def line(self, key: Key) -> int:
        """Line (from 1) on which `key`, or the last part of it that is there, is complete; 0 if none is."""
        lines = self.text.splitlines(keepends=True)
        while key and _found(self.data, key) is MISSING:
            key = key[:-1]

        def complete(n: int) -> bool:
            for end in range(n, 0, -1):  # a cut inside a value of several lines does not parse: step back
                try:
                    return _found(tomllib.loads("".join(lines[:end])), key) is not MISSING
                except tomllib.TOMLDecodeError:
                    continue
            return False

        return bisect.bisect_left(range(len(lines)), True, key=complete) if key else 0

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
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in key).lstrip(".")


def nearest(name: object, known: Iterable[str]) -> str:
    """`did you mean X? ` if a known name is near, and the list of all known ones."""
    names = sorted(known)
    near = difflib.get_close_matches(str(name), names, n=1)
    return (f"did you mean {near[0]!r}? " if near else "") + "known: " + (", ".join(names) or "none")


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _found(data: Any, key: Key) -> Any:
    for part in key:
        try:
            data = data[part]
        except (KeyError, IndexError, TypeError):
            return MISSING
    return data
