"""Rules of a case that join several keys: what is required together, excluded together, or impossible.

Dimensions and ranges of single keys are in `case_sections.py`.  Whether a particle touches an asperity
is known only to the true surface, and checked by `process.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from reference.toml_source import MISSING, Key, Refusal, nearest

if TYPE_CHECKING:
    from reference.case import Case

ROUNDING = 1e-12  # relative: 4000 units in the last place, for a gap that is meant to be exactly zero


def check(case: Case) -> None:
    """Refuse a case that breaks a rule; raises Refusal with the key, its value and what is allowed."""
    _check_variants(case)
    _check_surface(case)
    _check_materials(case)
    _check_contact(case)
    _check_flow(case)
    _check_pad(case)
    _check_numerics(case)
    _check_particles(case)
    _check_places(case)
    _check_overlaps(case)


def _require(section: Any, table: str, keys: tuple[str, ...], reason: str) -> None:
    for key in keys:
        if getattr(section, key) is None:
            raise Refusal((table, key), MISSING, f"required {reason}, but missing")


def _exclude(section: Any, table: str, keys: tuple[str, ...], reason: str) -> None:
    for key in keys:
        value = getattr(section, key)
        if value is not None:
            raise Refusal((table, key), value, f"has no meaning {reason}; allowed: leave it out")


def _check_variants(case: Case) -> None:
    seen: set[str] = set()
    for k, entry in enumerate(case.declared_variants):
        if entry.name.casefold() in seen:  # folders of two variants must differ on every file system
            raise Refusal(("variant", k, "name"), entry.name, "used twice; allowed: a name of its own")
        seen.add(entry.name.casefold())
        if "variant" in entry.overrides:
            raise Refusal(("variant", k, "overrides", "variant"), MISSING, "a variant has no variants")


def _check_surface(case: Case) -> None:
    surface = case.surface
    reason = f"with surface.kind = {surface.kind!r}"
    asperities = ("asperity_height", "asperity_density", "raised")
    if surface.kind == "none":
        _exclude(surface, "surface", ("nodes", "material", *asperities), reason)
    else:
        _require(surface, "surface", ("nodes", "material"), reason)
        _exclude(surface, "surface", ("height",), reason)
    if surface.kind == "flat":
        _exclude(surface, "surface", asperities, reason)
    if surface.kind == "asperities":
        _require(surface, "surface", ("asperity_height",), reason)
        if (surface.asperity_density is None) == (surface.raised is None):
            raise Refusal(("surface",), MISSING, f"{reason}, allowed: either asperity_density or raised")
    for k, square in enumerate(surface.raised or ()):
        assert surface.nodes is not None
        if max(square) >= surface.nodes:
            raise Refusal(("surface", "raised", k), list(square), f"allowed: 0 to {surface.nodes - 1}")
    if case.removal is not None:
        if surface.kind == "none":
            raise Refusal(("removal",), MISSING, "needs a surface; allowed: surface.kind flat or asperities")
        material = case.material.get(surface.material or "")
        if material is not None and material.yield_stress is None:
            raise Refusal(
                ("material", str(surface.material), "yield_stress"),
                MISSING,
                "required for the surface of a case with removal, but missing",
            )


def _check_materials(case: Case) -> None:
    uses: list[tuple[Key, str | None]] = [(("surface", "material"), case.surface.material)]
    uses += [(("particle", k, "material"), entry.material) for k, entry in enumerate(case.particle)]
    if case.particles is not None:
        uses.append((("particles", "material"), case.particles.material))
    for key, name in uses:
        if name is not None and name not in case.material:
            raise Refusal(key, name, f"unknown material; {nearest(name, case.material)}")


def _check_contact(case: Case) -> None:
    mu_s, mu_d = case.contact.static_friction, case.contact.dynamic_friction
    if mu_d > mu_s:
        raise Refusal(("contact", "dynamic_friction"), mu_d, f"allowed: <= static_friction, {mu_s:g}")


def _check_flow(case: Case) -> None:
    fluid = case.fluid
    if fluid is None:
        return
    shear = ("wall_speed", "gap")
    if fluid.gap is not None:
        _check_asperities(case, fluid.gap, "fluid.gap")
    if fluid.flow == "uniform":
        _require(fluid, "fluid", ("velocity",), "with flow = 'uniform'")
        _exclude(fluid, "fluid", shear, "with flow = 'uniform'")
        return
    _exclude(fluid, "fluid", ("velocity",), "with flow = 'couette'")
    if case.pad is None:
        _require(fluid, "fluid", shear, "with flow = 'couette' and no pad")
    else:
        _exclude(fluid, "fluid", shear, "with a pad, whose speed and height drive the flow")


def _check_pad(case: Case) -> None:
    if case.pad is None:
        return
    if case.surface.kind == "none":
        raise Refusal(("pad",), MISSING, "needs a surface; allowed: surface.kind flat or asperities")
    _check_asperities(case, case.pad.initial_height, "pad.initial_height")
    lowest, highest = case.pad.minimum_height, case.pad.initial_height
    if lowest is not None and lowest > highest:
        raise Refusal(("pad", "minimum_height"), lowest, f"allowed: <= initial_height, {highest:g} m")


def _check_asperities(case: Case, gap: float, what: str) -> None:
    """Asperities end below what bounds the fluid above."""
    height = case.surface.asperity_height
    if height is not None and height >= gap:
        raise Refusal(("surface", "asperity_height"), height, f"allowed: below {what}, {gap:g} m")


def _check_numerics(case: Case) -> None:
    if case.pad is None:
        _require(case.numerics, "numerics", ("time_step",), "without a pad")
    step = case.numerics.time_step
    if step is not None and step > case.case.duration:
        raise Refusal(("numerics", "time_step"), step, f"allowed: <= case.duration, {case.case.duration:g} s")
    if case.numerics.stepper == "fast" and case.numerics.scheme == "fixed_point":
        raise Refusal(
            ("numerics", "stepper"), "fast", "takes steps of scheme = 'point_implicit'; allowed: 'plain'"
        )
    if case.removal is not None and case.removal.new_contacts_only and case.numerics.scheme == "fixed_point":
        raise Refusal(
            ("removal", "new_contacts_only"),
            True,
            "looks back by one step, and those of numerics.scheme = 'fixed_point' differ; allowed: false, or "
            "scheme = 'point_implicit'",
        )


def _check_particles(case: Case) -> None:
    random = case.particles
    if (random is None) == (not case.particle):
        raise Refusal((), MISSING, "allowed: either [particles], placed at random, or [[particle]] entries")
    if random is None:
        return
    if (random.velocity_min is None) != (random.velocity_max is None):
        absent = "velocity_min" if random.velocity_min is None else "velocity_max"
        raise Refusal(("particles", absent), MISSING, "required with its counterpart, but missing")
    slowest, fastest = random.velocity_min or (), random.velocity_max or ()
    for axis, (least, most) in enumerate(zip(slowest, fastest, strict=True)):
        if least > most:
            raise Refusal(
                ("particles", "velocity_min", axis), least, f"allowed: <= velocity_max, {most:g} m/s"
            )
    if random.z_min is not None and random.z_max is not None and random.z_min > random.z_max:
        raise Refusal(("particles", "z_min"), random.z_min, f"allowed: <= z_max, {random.z_max:g} m")


def _check_places(case: Case) -> None:
    size, height = case.surface.size, case.surface.height
    largest = min(size, height or size) / 2
    fits = f"allowed: <= {largest:g} m, half the period of the box, so that two particles meet in one place"
    random = case.particles
    if random is not None and random.mean_diameter * (1 + random.diameter_spread) > largest:
        raise Refusal(("particles", "mean_diameter"), random.mean_diameter, fits + ", with its spread")
    for k, entry in enumerate(case.particle):
        if entry.diameter > largest:
            raise Refusal(("particle", k, "diameter"), entry.diameter, fits)
        for axis, period in enumerate((size, size, height)):
            if period is not None and not 0 <= entry.position[axis] < period:
                raise Refusal(
                    ("particle", k, "position", axis),
                    entry.position[axis],
                    f"outside the box; allowed: from 0 to below {period:g} m",
                )
        radius, z = entry.diameter / 2, entry.position[2]
        if case.surface.kind != "none" and z < radius * (1 - ROUNDING):
            raise Refusal(
                ("particle", k, "position", 2),
                z,
                f"below or in the surface; allowed: >= the radius, {radius:g} m",
            )
        if case.pad is not None and z + radius > case.pad.initial_height * (1 + ROUNDING):
            raise Refusal(
                ("particle", k, "position", 2),
                z,
                f"in the pad; allowed: <= {case.pad.initial_height - radius:g} m",
            )


def _check_overlaps(case: Case) -> None:
    """Every pair at its nearest periodic images, and as near as the jitter may bring it."""
    if len(case.particle) < 2:
        return
    position = np.array([entry.position for entry in case.particle])
    radius = np.array([entry.diameter / 2 for entry in case.particle])
    jitter = np.sqrt(2) * np.array([entry.position_jitter for entry in case.particle])
    period = np.array([case.surface.size, case.surface.size, case.surface.height or np.inf])
    for j in range(1, len(radius)):
        offset = np.abs(position[:j] - position[j])
        offset = np.minimum(offset, period - offset)
        aside = np.maximum(np.hypot(offset[:, 0], offset[:, 1]) - jitter[:j] - jitter[j], 0)
        apart = np.hypot(aside, offset[:, 2])
        touching = np.flatnonzero(apart < (radius[:j] + radius[j]) * (1 - ROUNDING))
        if touching.size:
            i = int(touching[0])
            least = float(radius[i] + radius[j])
            raise Refusal(
                ("particle", j, "position"),
                list(case.particle[j].position),
                f"overlaps particle[{i}]: centres {apart[i]:g} m apart; allowed: >= {least:g} m",
            )
