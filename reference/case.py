"""The case: the physics of one simulation as a user writes it, validated, frozen and in SI.

Here stand the case as a whole, loading, saving and variants.  Its sections are `case_sections.py`, the
rules that join several keys `case_rules.py`, units `units.py`, lines and wording of errors
`toml_source.py`; arrays are built from a case by `process.py`.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import Field, PrivateAttr, ValidationError, model_validator

from reference.case_optimise import Optimise, resolve
from reference.case_rules import check
from reference.case_sections import (
    Contact,
    Cost,
    Fluid,
    Header,
    Material,
    Numerics,
    Pad,
    Particle,
    Particles,
    Removal,
    Section,
    Surface,
    Variant,
)
from reference.toml_source import CaseError, Key, TomlSource, nearest
from reference.units import Quantity

__all__ = ["CASES", "Case", "CaseError", "available_cases", "load_case"]

CASES = Path(__file__).parent / "cases"


class Case(Section):
    """One case file in SI, with attributes named as its sections; `load_case` makes it.

    A case with `[[variant]]` entries stands for several runs, one for each of `variants()`.
    """

    case: Header
    particles: Particles | None = None
    particle: tuple[Particle, ...] = ()
    fluid: Fluid | None = None
    material: dict[str, Material]
    surface: Surface
    contact: Contact
    removal: Removal | None = None
    pad: Pad | None = None
    numerics: Numerics = Numerics()
    cost: Cost = Cost()
    optimise: Optimise | None = None
    engine: dict[str, dict[str, Any]] = Field(default_factory=dict)
    declared_variants: tuple[Variant, ...] = Field((), alias="variant")
    _source: TomlSource = PrivateAttr(default_factory=lambda: TomlSource(None))

    @model_validator(mode="after")
    def _obey_rules(self) -> Case:
        check(self)
        return resolve(self)

    def __eq__(self, other: object) -> bool:
        """Same physics and settings, wherever the files lie."""
        return isinstance(other, Case) and self.model_dump() == other.model_dump()

    @property
    def name(self) -> str:
        """Name of the case, shared by its variants."""
        return self.case.name

    @property
    def variant(self) -> str:
        """Name of the variant that this case is; "" if it is none."""
        return self.case.variant

    @property
    def path(self) -> Path | None:
        """The file this case was loaded from."""
        return self._source.path

    def variants(self) -> list[Case]:
        """The runs this case asks for: one case per `[[variant]]`, or the case itself without any.

        Raises CaseError if an override makes the case invalid.
        """
        base = self.model_dump(by_alias=True, exclude_unset=True, exclude={"declared_variants"})
        return [self._variant(base, k) for k in range(len(self.declared_variants))] or [self]

    def _variant(self, base: dict[str, Any], k: int) -> Case:
        entry = self.declared_variants[k]
        raw = _merge(_merge(base, entry.overrides), {"case": {"variant": entry.name}})
        return _validated(raw, self._source, variant=k)

    def replaced(self, values: Mapping[str, object]) -> Case:
        """The case with other values of keys such as `pad.speed`, without variants and [optimise].

        Raises CaseError, naming key, value and what is allowed, if that makes no valid case.
        """
        raw = self.model_dump(by_alias=True, exclude_unset=True, exclude={"declared_variants", "optimise"})
        for key, value in values.items():
            nested = value
            for part in reversed(key.split(".")):
                nested = {part: nested}
            raw = _merge(raw, nested)  # type: ignore[arg-type]
        return _validated(raw, TomlSource(None))

    def quantity(self, value: object, unit: str, key: str) -> float:
        """SI value of an entry that only an engine understands, such as `engine.lammps.contact_duration`.

        `unit` is an SI unit; raises CaseError, naming `key`, if `value` has another dimension.
        """
        try:
            return Quantity(unit).validate(value)
        except ValueError as problem:
            raise self.error(key, value, str(problem)) from None

    def error(self, key: str, value: object, allowed: str) -> CaseError:
        """The error to raise for an entry found wrong later; `key` is such as `particle.0.position`."""
        path = tuple(int(part) if part.isdigit() else part for part in key.split("."))
        return self._source.error(path, value, allowed)

    def toml(self) -> str:
        """The case as TOML in SI numbers, defaults included: equal text for equal cases."""
        data = self.model_dump(by_alias=True, exclude_none=True)
        return tomli_w.dumps({key: value for key, value in data.items() if value})

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the case as `toml()`; it loads back equal."""
        Path(path).write_text(self.toml(), "utf-8")


def available_cases() -> list[str]:
    """Names of the cases that ship."""
    return sorted(path.stem for path in CASES.glob("*.toml"))


def load_case(path_or_name: str | os.PathLike[str]) -> Case:
    """The validated case of a TOML file, or of the name of a case that ships.

    Raises CaseError, one line naming file, key, value and what is allowed.
    """
    source = TomlSource(_locate(path_or_name))
    case = _validated(source.data, source)
    case.variants()  # an override that is not valid is refused now, not at its run
    return case


def _locate(path_or_name: str | os.PathLike[str]) -> Path:
    path = Path(path_or_name)
    if str(path_or_name) in available_cases():
        return CASES / f"{path_or_name}.toml"
    if path.suffix == ".toml" or path.exists() or len(path.parts) > 1:
        return path
    raise CaseError(
        f"unknown case {str(path_or_name)!r}: {nearest(path_or_name, available_cases())} "
        "(or the path of a .toml file)"
    )


def _validated(raw: dict[str, Any], source: TomlSource, variant: int | None = None) -> Case:
    for key, value in _leaves(raw):
        if isinstance(value, float) and not math.isfinite(value):
            raise source.error(key, value, "not finite; allowed: finite numbers", variant)
    try:
        case = Case.model_validate(raw)
    except ValidationError as problem:
        raise source.translate(problem, variant) from None
    case._source = source
    return case


def _leaves(data: Any, key: Key = ()) -> Iterator[tuple[Key, Any]]:
    if isinstance(data, Mapping):
        for name, value in data.items():
            yield from _leaves(value, (*key, name))
    elif isinstance(data, list | tuple):
        for index, value in enumerate(data):
            yield from _leaves(value, (*key, index))
    else:
        yield key, data


def _merge(base: Mapping[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """`base` with the keys of `overrides` replaced, table by table."""
    merged = dict(base)
    for key, value in overrides.items():
        both = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
        merged[key] = _merge(merged[key], value) if both else value
    return merged
