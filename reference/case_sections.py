"""The sections of a case file: their keys, dimensions, ranges and defaults, frozen and in SI.

Nothing is read here (`case.py`), and no rule joins two keys (`case_rules.py`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StrictBool, StrictInt, model_validator

from reference.toml_source import Refusal, nearest
from reference.units import Quantity


def _file_name(name: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}", name):
        raise ValueError("allowed: up to 100 letters, digits, _ . -, and no . or - in front")
    return name


Name = Annotated[str, AfterValidator(_file_name)]
Length = Annotated[float, Quantity("m", gt=0)]
Coordinate = Annotated[float, Quantity("m")]
Time = Annotated[float, Quantity("s", gt=0)]
Speed = Annotated[float, Quantity("m/s", ge=0)]
Component = Annotated[float, Quantity("m/s")]
Velocity = tuple[Component, Component, Component]
Position = tuple[Coordinate, Coordinate, Coordinate]
Pressure = Annotated[float, Quantity("Pa", gt=0)]
Density = Annotated[float, Quantity("kg/m^3", gt=0)]
Fraction = Annotated[float, Quantity(ge=0, le=1)]
Positive = Annotated[float, Quantity(gt=0)]
NotNegative = Annotated[float, Quantity(ge=0)]
NodeIndices = tuple[Annotated[StrictInt, Field(ge=0)], Annotated[StrictInt, Field(ge=0)]]


class Section(BaseModel):
    """A table of the case file: frozen, and refusing keys that it does not know."""

    model_config = ConfigDict(frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, data: Any) -> Any:
        known = {field.alias or name for name, field in cls.model_fields.items()}
        for key in data if isinstance(data, Mapping) else ():
            if key not in known:
                raise Refusal((key,), data[key], f"unknown key; {nearest(key, known)}")
        return data


class Header(Section):
    """[case]: what is simulated, for how long, and what is recorded."""

    name: Name
    title: str
    description: str  # one sentence of physics, with equation numbers
    seed: Annotated[StrictInt, Field(ge=0)] = 0
    duration: Time
    outputs: Annotated[StrictInt, Field(ge=2, le=1_000_000)] = (
        50  # equally spaced times, with 0 and the duration
    )
    variant: Name | Literal[""] = ""  # the variant that this case is; written by `Case.save`


class Particles(Section):
    """[particles]: particles placed at random. Paper: Section 4."""

    count: Annotated[StrictInt, Field(ge=1, le=10_000_000)]  # 2 GB
    mean_diameter: Length
    diameter_spread: Annotated[float, Quantity(ge=0, lt=1)] = 0.0  # delta_d
    material: str
    velocity_min: Velocity | None = None  # without it: the local velocity of the fluid
    velocity_max: Velocity | None = None
    z_min: Coordinate | None = None  # limits of the centres
    z_max: Coordinate | None = None


class Particle(Section):
    """[[particle]]: one particle placed by hand."""

    diameter: Length
    position: Position
    velocity: Velocity
    material: str
    position_jitter: Annotated[float, Quantity("m", ge=0)] = 0.0  # uniform random offset in x and in y, +-


class Fluid(Section):
    """[fluid]: undisturbed flow that drags the particles. Paper: Eqs. (20)-(22)."""

    density: Density
    viscosity: Annotated[float, Quantity("Pa s", gt=0)]
    flow: Literal["uniform", "couette"]
    velocity: Velocity | None = None  # uniform
    wall_speed: Component | None = None  # couette without a pad: u = (V z/H, 0, 0)
    gap: Length | None = None


class Material(Section):
    """[material.NAME]: elastic constants, density and, for a surface that is removed, yield stress."""

    density: Density
    youngs_modulus: Pressure
    poisson_ratio: Annotated[float, Quantity(ge=0, le=0.5)]
    yield_stress: Pressure | None = None


class Surface(Section):
    """[surface]: the box's period and what bounds it below."""

    kind: Literal["none", "flat", "asperities"]
    size: Length  # D, the period along x and y
    height: Length | None = None  # kind none: the period along z too
    nodes: Annotated[StrictInt, Field(ge=2, le=10_000)] | None = None  # n, along x and along y
    asperity_height: Length | None = None
    asperity_density: Annotated[float, Quantity(gt=0, le=1)] | None = None  # random raised squares
    raised: tuple[NodeIndices, ...] | None = None  # or these: [i, j] of the lower left node of each
    material: str | None = None


class Contact(Section):
    """[contact]: restitution, friction and duration of impacts. Paper: Eqs. (5)-(18)."""

    restitution: Fraction
    static_friction: NotNegative = 0.0
    dynamic_friction: NotNegative = 0.0
    impact_duration: Time | None = None  # without it: Hertz's
    pairs: StrictBool = True  # false: particles pass through each other


class Removal(Section):
    """[removal]: what an impact takes off the surface. Paper: Eqs. (32)-(36).

    `new_contacts_only`: a particle that touched the surface one step before, at any of its facets, removes
    nothing; neither does a sphere that slides over a plateau into a flank.
    """

    deposit: Literal["volume", "node_depth"]
    acceleration: Positive = 1.0
    mass_pickup: StrictBool = True
    threshold_velocity: Speed | None = None  # without it: the yield velocity
    new_contacts_only: StrictBool = False  # a particle that stays in contact removes nothing more


class Pad(Section):
    """[pad]: the plane that drives the fluid and descends. Paper: Section 4."""

    speed: Annotated[float, Quantity("m/s", gt=0)]
    restitution: Fraction = 0.5
    initial_height: Length
    minimum_height: Length | None = None


class Numerics(Section):
    """[numerics]: the time integration. Paper: Eqs. (37)-(43)."""

    scheme: Literal["point_implicit", "fixed_point"] = "point_implicit"
    stepper: Literal["plain", "fast"] = "plain"  # the answer key, or the same steps in a fifth of the time
    time_step: Time | None = None  # with a pad it may be left to gamma
    gamma: Positive = 0.01
    tolerance: Positive = 1e-6
    iterations: Annotated[StrictInt, Field(ge=2)] = 8  # k_d
    norm: Literal["displacement", "printed"] = "displacement"
    contacts: Literal["frozen", "iterated"] = "frozen"
    ledger_speed: Speed = 0.0  # slower contacts that remove nothing are counted but not recorded


class Cost(Section):
    """[cost]: what flatness means. Paper: Eq. (44)."""

    exponent: Positive = 2.0  # q
    target_height: Coordinate = 0.0  # z_o


class Variant(Section):
    """[[variant]]: one run of a case; `overrides` replaces keys of the file, lists as a whole."""

    name: Name
    overrides: dict[str, Any] = Field(default_factory=dict)
