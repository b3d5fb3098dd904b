"""Units at the border: text such as "0.9 um" or a plain number becomes an SI float, or is refused.

`Quantity` states, in a field's annotation, which dimension and which range the field allows.  What the
fields are is `case.py`.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from decimal import Decimal
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any

from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

if TYPE_CHECKING:
    import pint

NUMBER_AND_UNIT = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?)\s*([^\d\s.].*)?", re.ASCII)

LONGEST = 200  # characters of a number and its unit

# SI unit of a field: what it measures, and how one may write it
MEANING = {
    "": ("a number", "0.5"),
    "m": ("a length", '"0.9 um"'),
    "s": ("a time", '"4 ns"'),
    "m/s": ("a speed", '"1 m/s"'),
    "kg/m^3": ("a density", '"3950 kg/m^3"'),
    "Pa": ("a pressure", '"0.3 GPa"'),
    "Pa s": ("a viscosity", '"1 mPa s"'),
}


@cache
def registry() -> pint.UnitRegistry:
    """Units that pint knows, built at first use (slow); decimal, so that "0.9 um" is the float 9e-7."""
    import pint

    return pint.UnitRegistry(non_int_type=Decimal)


def to_si(value: object, unit: str) -> float:
    """The finite SI float that a number (taken as SI) or a text with a unit stands for.

    `unit` is the SI unit of the quantity, in pint's spelling; "" for a pure number.
    Raises ValueError saying what is wrong with `value`.

    >>> to_si("0.9 um", "m")
    9e-07
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError("neither a number nor a text with a unit")
    if isinstance(value, str):
        value = _text_to_si(value, unit)
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError("not finite")
    return number


def _text_to_si(text: str, unit: str) -> float:
    if len(text) > LONGEST:  # on longer ones the parsers of numbers and units take for ever
        raise ValueError(f"a text of {len(text)} characters, more than {LONGEST}")
    match = NUMBER_AND_UNIT.fullmatch(text)
    if match is None:
        raise ValueError("not a number followed by a unit")
    number, given = match.groups()
    if not given:
        if unit:
            raise ValueError("text without a unit (a bare number is SI, without quotes)")
        return float(number)
    return float(Decimal(number) * _factor(given, unit))


@lru_cache(maxsize=1000)  # a file repeats a few units many times; bounded, for texts come from users
def _factor(given: str, unit: str) -> Decimal:
    """How many `unit` one of the `given` units is."""
    try:
        parsed, target = registry().parse_units(given), registry().parse_units(unit)
        same = parsed.dimensionality == target.dimensionality
    except Exception as problem:  # pint's parser raises a dozen unrelated types on malformed text
        raise ValueError(f"unknown unit {given!r}") from problem
    if not same:
        raise ValueError(f"wrong dimension, {parsed.dimensionality}")
    return Decimal(registry().Quantity(Decimal(1), parsed).to(target).magnitude)


@dataclass(frozen=True)
class Quantity:
    """What a float field of the case allows: `Annotated[float, Quantity("m", gt=0)]`.

    `unit` is the SI unit ("" for a pure number); `gt`, `ge`, `lt`, `le` bound the SI value.
    """

    unit: str = ""
    gt: float | None = None
    ge: float | None = None
    lt: float | None = None
    le: float | None = None

    @property
    def allowed(self) -> str:
        """What may stand there, for a person."""
        what, example = MEANING.get(self.unit, (f"a quantity in {self.unit}", f'"1 {self.unit}"'))
        signs = ((">", self.gt), (">=", self.ge), ("<", self.lt), ("<=", self.le))
        bounds = " and ".join(f"{sign} {bound:g}" for sign, bound in signs if bound is not None)
        written = f" such as {example}, or a number in {self.unit}" if self.unit else ""
        return " ".join(filter(None, ("allowed:", what, bounds))) + written

    def validate(self, value: object) -> float:
        """`value` as an SI float within the bounds; ValueError says why not and what is allowed."""
        try:
            number = to_si(value, self.unit)
        except ValueError as problem:
            raise ValueError(f"{problem}; {self.allowed}") from problem
        inside = (
            (self.gt is None or number > self.gt)
            and (self.ge is None or number >= self.ge)
            and (self.lt is None or number < self.lt)
            and (self.le is None or number <= self.le)
        )
        if not inside:
            raise ValueError(self.allowed)
        return number

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.validate)
