"""Numbers, units and names as people read them; no layout and no verdicts.

Records carry plain SI units ("N s", "m3"); here they get a prefix, so that micrometre physics reads as
um, fN s and pg.  Values below the smallest familiar prefix keep the SI unit and an exponent.
"""

from __future__ import annotations

import math
import re

_PREFIXES = {-18: "a", -15: "f", -12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
_SMALLEST = {"m": -12, "m/s": -6, "m2": -9, "m3": -9, "s": -15, "m/s2": -6}
_LARGEST = {"Pa": 9, "N": 3, "J": 3, "Hz": 9}
_LEADING_UNIT = re.compile(r"(kg|Pa|Hz|[mgsNJW])(\d?)(?![A-Za-z])(.*)", re.DOTALL)
_SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\ud800-\udfff\ufffe\uffff]")


def printable(text: object) -> str:
    """Text with the characters that XML and terminals cannot carry replaced by U+FFFD."""
    return _CONTROL.sub("\ufffd", str(text))


def words(name: str) -> str:
    """A quantity's name as words, e.g. "normal_impulse" as "normal impulse"."""
    return printable(name).replace("_", " ")


def superscript(exponent: int) -> str:
    """An integer as superscript characters."""
    return str(exponent).translate(_SUPERSCRIPTS)


def unit_text(unit: str) -> str:
    """A plain SI unit as printed: "m/s2" as m/s², the dimensionless "1" as nothing."""
    if unit.strip() in ("", "1"):
        return ""
    return re.sub(r"(?<=[A-Za-z])-?\d", lambda match: superscript(int(match[0])), printable(unit))


def scale(magnitude: float, unit: str) -> tuple[float, str]:
    """The factor and the prefixed unit in which a magnitude is a number between about 0.1 and 1000.

    `magnitude` is in `unit` (plain SI).  Returns (factor, label): magnitude*factor is in `label`.
    """
    plain = (1.0, unit_text(unit))
    match = _LEADING_UNIT.fullmatch(unit)
    if not match or not math.isfinite(magnitude) or magnitude == 0 or 0.1 <= abs(magnitude) < 1000:
        return plain
    base, power, rest = match[1], int(match[2] or 1), match[3]
    gram = 1000.0 if base == "kg" else 1.0
    room = power if power > 1 else 0  # areas and volumes: 0.03 um3 rather than 3e7 nm3
    steps = math.floor((math.log10(abs(magnitude) * gram) + room) / (3 * power) + 1e-12)
    exponent = min(3 * steps, 0 if base == "kg" else _LARGEST.get(unit, 0))
    smallest = _SMALLEST.get(unit, -18)
    if exponent < smallest - 3:
        return plain
    exponent = max(exponent, smallest)
    label = _PREFIXES[exponent] + ("g" if base == "kg" else base) + match[2] + rest
    return gram * 10.0 ** (-exponent * power), unit_text(label)


def number(value: float | None, digits: int = 6) -> str:
    """A number with at most `digits` significant digits, "n/a" where there is none."""
    if value is None or math.isnan(value):
        return "n/a"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    text = f"{value:.{digits}g}"
    if "e+" in text and abs(value) < 1e6:
        text = f"{value:.0f}"
    return re.sub(r"e([+-])0*", lambda m: "e" + m[1].replace("+", ""), text).replace("-", "−")


def ratio_text(ratio: float | None) -> str:
    """error/tolerance to two digits, or to as many as keep it on its side of one."""
    if ratio is None:
        return "n/a"
    if 0 < ratio < 0.001:
        return "<0.001"
    digits = 2
    while ratio != 1 and digits < 12 and (float(f"{ratio:.{digits}g}") > 1) != (ratio > 1):
        digits += 1
    while ratio < 1 and digits < 12 and float(f"{ratio:.{digits}g}") == 1:
        digits += 1
    return number(ratio, digits)


def quantity_text(value: float, unit: str, like: float | None = None, digits: int = 6) -> str:
    """A value with its unit, in the prefix that suits the magnitude `like` (its own by default)."""
    if math.isnan(value):
        return "n/a"
    factor, label = scale(abs(value) if like is None else like, unit)
    return f"{number(value * factor, digits)} {label}".rstrip()


def uncertain(value: float, error: float) -> str:
    """A value and its standard error, to two digits of the error.

    >>> uncertain(0.41234, 0.0123)
    '0.412 ± 0.012'
    """
    if not (math.isfinite(value) and math.isfinite(error)):
        return f"{number(value)} ± {number(error)}"
    if error == 0:
        return f"{number(value)} ± 0"
    decimals = max(0, 1 - math.floor(math.log10(float(f"{error:.1e}"))))
    return f"{value:.{decimals}f} ± {error:.{decimals}f}".replace("-", "−")


def percent(fraction: float | None) -> str:
    """A relative error for a reader: percent, or a power of ten where it is rounding."""
    if fraction is None:
        return ""
    if fraction == 0:
        return "0"
    if fraction < 1e-7:
        return number(fraction, 1)
    return f"{number(100 * fraction, 2)} %"


def duration(seconds: float) -> str:
    """A wall-clock time in words that fit a heading."""
    if seconds < 90:
        return f"{number(seconds, 2)} s"
    return f"{int(seconds // 60)} min {int(seconds % 60)} s"
