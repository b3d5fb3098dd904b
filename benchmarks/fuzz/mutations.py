"""How a good input is spoilt: bytes, numbers, words and lines are replaced, removed, doubled and moved.

Knows no format; the words are those that formats, units and paths are made of.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable

NUMBER = re.compile(rb"-?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
WORD = re.compile(rb"[A-Za-z_][\w.]*")
NUMBERS = (
    b"0", b"-0.0", b"1", b"-1", b"2", b"1e-320", b"1e-20", b"1e20", b"1e200", b"1e308", b"-1e308", b"1e400",
    b"nan", b"inf", b"-inf", b"0.1", b"1.0000001", b"999999999999", b"18446744073709551616", b"0x1F", b"1_0",
    b"0.5", b"0.999", b"1e-9", b"9" * 50, b"9" * 5000, b"true", b'"1"', b"1979-05-27", b"3.14.15", b"1e",
)  # fmt: skip
WORDS = (
    b"../../x", b"/etc/passwd", b"/dev/zero", b"..", b".", b"", b"<script>alert(1)</script>", b"\x1b[31m",
    b"__import__('os').system('id')", b"{{7*7}}", b"${HOME}", b"%s%n", b"a" * 300, b"a.b." * 400 + b"c",
    b"[" * 300, b"kg", b"um", b"m**-1", b"degC", b"m/s", b"1/0", b"9**9**9", b"si", b"micro", b"time", b"x",
    b"vx", b"particle", b"mass", b"\xff\xfe", b"\x00", "é".encode(), "١".encode(), b"variant", b"engine",
    b"name",
    b"ITEM: TIMESTEP", b"ITEM: ATOMS id x y z", b"# units: nano", b"# contact_duration: 1", b"# time_step: 1",
)  # fmt: skip
SIGNS = (
    b"\n",
    b"\r\n",
    b",",
    b";",
    b"\t",
    b" ",
    b"=",
    b'"',
    b"'",
    b"[",
    b"]",
    b"[[",
    b"{",
    b"}",
    b"#",
    b"<",
    b"&",
)


def spoilt(data: bytes, rng: random.Random, most: int = 4) -> bytes:
    """The input with up to `most` mutations."""
    for _ in range(rng.randint(1, most)):
        data = rng.choice(KINDS)(data, rng)
    return data


def _bytes(data: bytes, rng: random.Random) -> bytes:
    at = rng.randint(0, len(data))
    return data[:at] + rng.randbytes(rng.randint(0, 4)) + data[at + rng.randint(0, 4) :]


def _bit(data: bytes, rng: random.Random) -> bytes:
    if not data:
        return data
    at = rng.randrange(len(data))
    return data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :]


def _replaced(
    pattern: re.Pattern[bytes], values: tuple[bytes, ...]
) -> Callable[[bytes, random.Random], bytes]:
    def kind(data: bytes, rng: random.Random) -> bytes:
        found = list(pattern.finditer(data))
        if not found:
            return data
        match = rng.choice(found)
        new = rng.choice(values) if rng.random() < 0.6 else rng.choice(found).group()
        return data[: match.start()] + new + data[match.end() :]

    return kind


def _nudged(data: bytes, rng: random.Random) -> bytes:
    """A number that is off by a little: what a wrong code would write."""
    found = list(NUMBER.finditer(data))
    if not found:
        return data
    match = rng.choice(found)
    try:
        value = float(match.group()) * (1.0 + rng.choice((-1, 1)) * 10.0 ** rng.randint(-12, 0))
    except (ValueError, OverflowError):
        return data
    return data[: match.start()] + repr(value).encode() + data[match.end() :]


def _sign(data: bytes, rng: random.Random) -> bytes:
    at = rng.randint(0, len(data))
    return data[:at] + rng.choice(SIGNS) + data[at + rng.randint(0, 1) :]


def _lines(data: bytes, rng: random.Random) -> bytes:
    """A line or a few of them removed, doubled, or put elsewhere."""
    lines = data.split(b"\n")
    first = rng.randrange(len(lines))
    last = min(len(lines), first + rng.randint(1, 5))
    part, rest = lines[first:last], lines[:first] + lines[last:]
    how = rng.randrange(3)
    if how == 0:
        return b"\n".join(rest)
    at = rng.randint(0, len(rest))
    kept = lines if how == 1 else rest
    return b"\n".join(kept[:at] + part * rng.choice((1, 1, 2, 20)) + kept[at:])


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randint(0, len(data))]


KINDS = (
    _bytes, _bit, _replaced(NUMBER, NUMBERS), _replaced(NUMBER, NUMBERS), _replaced(WORD, WORDS), _nudged,
    _nudged, _sign, _lines, _lines, _cut,
)  # fmt: skip
