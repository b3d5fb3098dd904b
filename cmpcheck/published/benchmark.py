"""What a publication states: the set-up, the sweep and the points, read from a TOML file and checked."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError, model_validator

from reference.case_sections import Fraction, Length, NotNegative, Positive, Pressure, Section, Speed
from reference.toml_source import CaseError, Refusal, TomlSource, nearest
from reference.units import Quantity

DATA = Path(__file__).with_name("data")
Text = Annotated[str, Field(min_length=1)]
Number = Annotated[float, Quantity()]
Poisson = Annotated[float, Quantity(ge=0, le=0.5)]
Density = Annotated[float, Quantity("kg/m^3", gt=0)]
Stiffness = Annotated[float, Quantity("N/m", gt=0)]

QUANTITIES = ("tangential_restitution", "spin", "normalised_spin", "rebound_angle")
UNITS = {"spin": "rad/s", "rebound_angle": "°"}  # others have none
# What is swept, with its unit: the head of an axis, and how a value of it is named in a row.
SWEPT = {
    "normal": ("", ""),
    "restitution": ("restitution asked for", ""),
    "angle": ("angle of incidence", "°"),
    "tangential_speed": ("tangential speed", "m/s"),
    "spin": ("spin before", "rad/s"),
}


class Sweep(Section):
    """[sweep]: what is varied, at which speed of approach (of each of two spheres; `angle`: whole speed)."""

    kind: Literal["normal", "restitution", "angle", "tangential_speed", "spin"]
    speed: Speed
    values: tuple[NotNegative, ...] = (0.0,)  # `angle`: degrees to the normal; others SI

    @model_validator(mode="after")
    def _join(self) -> Sweep:
        if list(self.values) != sorted(set(self.values)) or not self.values:
            raise Refusal(("values",), list(self.values), "allowed: one or more, each larger than the last")
        highest = {"restitution": 1.0, "angle": 89.0}.get(self.kind)
        if highest is not None and self.values[-1] > highest:
            raise Refusal(("values",), self.values[-1], f"allowed: <= {highest:g}")
        return self


class Material(Section):
    """[[material]]: of the spheres; without values for the wall it is rigid."""

    name: Text
    youngs_modulus: Pressure
    poisson_ratio: Poisson
    density: Density
    wall_youngs_modulus: Pressure | None = None
    wall_poisson_ratio: Poisson | None = None

    @model_validator(mode="after")
    def _join(self) -> Material:
        if (self.wall_youngs_modulus is None) != (self.wall_poisson_ratio is None):
            raise Refusal((), self.name, "allowed: both constants of the wall or neither")
        return self


class Springs(Section):
    """[springs]: of the spring-dashpot contact, where the publication has them."""

    normal: Stiffness
    shear: Stiffness


class Points(Section):
    """[[points]]: one published curve, digitised."""

    material: Text
    quantity: Literal["tangential_restitution", "spin", "normalised_spin", "rebound_angle"]
    at: tuple[Number, ...]  # values of the sweep
    values: tuple[Number, ...]
    floor: Positive  # of the digitisation, in the quantity's unit
    reach: NotNegative = 0.0  # of the reading along the sweep, in its unit; 0: contained in the floor
    source: Text

    @model_validator(mode="after")
    def _join(self) -> Points:
        if len(self.at) != len(self.values):
            raise Refusal(("values",), len(self.values), f"allowed: as many as `at` has, {len(self.at)}")
        return self

    def uncertainty(self, index: int) -> float:
        """What a point is known to: the floor, and the reach times the steeper slope to its neighbours."""
        pairs = [(k, k + 1) for k in (index - 1, index) if 0 <= k < len(self.at) - 1]
        slopes = [abs((self.values[b] - self.values[a]) / (self.at[b] - self.at[a])) for a, b in pairs]
        return self.floor + self.reach * max(slopes, default=0.0)


class Benchmark(Section):
    """A whole file; `name` is the file's."""

    name: Text
    title: Text
    sentence: Text
    publication: Text
    against: Literal["plane", "sphere"]
    radius: Length
    friction: NotNegative = 0.0
    restitution: Fraction = 1.0
    rebound: Literal["contact", "centre"] = "contact"  # of which point the rebound angle is
    measured: bool = False  # the points are an experiment's, not another code's
    sweep: Sweep
    material: Annotated[tuple[Material, ...], Field(min_length=1)]
    springs: Springs | None = None
    points: tuple[Points, ...] = ()

    @model_validator(mode="after")
    def _join(self) -> Benchmark:
        names = [material.name for material in self.material]
        for k, series in enumerate(self.points):
            if series.material not in names:
                raise Refusal(("points", k, "material"), series.material, nearest(series.material, names))
            for value in series.at:
                if value not in self.sweep.values:
                    raise Refusal(("points", k, "at"), value, "allowed: values of the sweep")
        return self

    @property
    def digest(self) -> str:
        """SHA-256 of the content, whatever the file's spelling."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()


def benchmark_names() -> list[str]:
    """The benchmarks that ship, in order."""
    return sorted(path.stem for path in DATA.glob("*.toml"))


@cache
def load_benchmark(name: str, folder: Path = DATA) -> Benchmark:
    """A benchmark that ships.  Raises CaseError, one line naming file, key, value and what is allowed."""
    path = folder / f"{name}.toml"
    if not path.is_file():
        raise CaseError(f"unknown benchmark {name!r}: {nearest(name, benchmark_names())}")
    source = TomlSource(path)
    try:
        return Benchmark.model_validate({"name": name, **source.data})
    except ValidationError as problem:
        raise source.translate(problem) from None
