"""Case files: units, variants, saving, and what every shipped case must keep.

What bad input says is `test_bad_input_cases.py`.
"""

import math
import re
import subprocess
import sys
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from reference.case import CASES, available_cases, load_case
from reference.case_sections import Material, Particle
from reference.units import to_si

ISSUED = {
    "asperity_bounce": (
        "plateau",
        "edge",
        "corner",
        "flank",
        "valley",
        "on_edge",
        "on_corner",
        "node_depth",
    ),
    "bounce_train": ("",),
    "couette_drift": ("",),
    "drag_regimes": ("",),
    "drag_relaxation": ("",),
    "pad_strike": ("",),
    "pair_drag": ("",),
    "pair_head_on": ("e0.2", "e0.5", "e0.8", "e1"),
    "pair_slip": ("",),
    "pair_stick": ("",),
    "swarm": ("",),
    "wall_bounce": ("pickup", "no_pickup"),
    "wall_oblique": ("30deg", "60deg"),
}
PREFIXES = {"G": 9, "M": 6, "k": 3, "": 0, "m": -3, "u": -6, "n": -9}
NUMBERS = st.decimals(min_value="1e-6", max_value="1e6", allow_nan=False, allow_infinity=False, places=6)


@pytest.mark.parametrize("name, variants", ISSUED.items())
def test_shipped_case_has_its_variants_and_name(name, variants):
    case = load_case(name)
    assert case.name == name
    assert case.path == CASES / f"{name}.toml"
    assert tuple(run.variant for run in case.variants()) == variants
    assert "Eq" in case.case.description


@pytest.mark.parametrize("name", available_cases())
def test_saved_case_loads_back_equal(name, tmp_path):
    case = load_case(name)
    for k, run in enumerate([case, *case.variants()]):
        path = tmp_path / f"{k}.toml"
        run.save(path)
        again = load_case(path)
        assert again == run
        assert again.variant == run.variant
        again.save(tmp_path / "twice.toml")
        assert (tmp_path / "twice.toml").read_bytes() == path.read_bytes()


def test_cases_that_differ_in_one_number_are_not_equal():
    low, high, *_ = load_case("pair_head_on").variants()
    assert low != high
    assert low != low.name


@pytest.mark.parametrize("name", available_cases())
def test_shipped_file_is_plain_to_read(name):
    text = (CASES / f"{name}.toml").read_text(encoding="utf-8")
    code = [re.sub(r'"[^"]*"', '""', line).split("#")[0].strip() for line in text.splitlines()]
    for line in filter(None, code):
        assert "{" not in line  # no inline tables
        assert re.fullmatch(r"\[\[?[\w.]+\]?\]|[\w.]+ = [^=]+", line), line  # one key on each line
        assert not re.search(r"\b(nan|inf)\b", line)


@given(number=NUMBERS, prefix=st.sampled_from(sorted(PREFIXES)), gap=st.sampled_from(["", " ", "  "]))
@pytest.mark.parametrize("unit", ["m", "s", "Pa", "m/s", "Pa s"])
def test_text_with_a_unit_is_the_same_float_as_its_si_literal(unit, number, prefix, gap):
    # to the bit: the product is formed in decimal and rounded once
    assert to_si(f"{number}{gap}{prefix}{unit}", unit) == float(number.scaleb(PREFIXES[prefix]))
    assert to_si(float(number), unit) == float(number)


@pytest.mark.parametrize(
    "text, unit, value",
    [
        ("0.9 um", "m", 9e-7),
        ("0.9 µm", "m", 9e-7),
        ("0.3 GPa", "Pa", 3e8),
        ("1 mPa s", "Pa s", 1e-3),
        ("3.95 g/cm**3", "kg/m^3", 3950.0),
        ("-40 um/s", "m/s", -4e-5),
        ("50 %", "", 0.5),
    ],
)
def test_units_of_the_field_are_understood(text, unit, value):
    assert to_si(text, unit) == value


def test_psi_is_a_pound_force_on_a_square_inch():
    # 0.45359237 kg and 0.0254 m by definition, standard gravity 9.80665 m/s2; rtol: two roundings
    pascal = 4 * 0.45359237 * 9.80665 / 0.0254**2
    assert to_si("4 psi", "Pa") == pytest.approx(pascal, rel=1e-15, abs=0.0)


@given(text=st.text(max_size=20))
def test_any_text_is_a_finite_length_or_refused(text):
    try:
        number = to_si(text, "m")
    except ValueError:  # no other exception may leave it
        return
    assert math.isfinite(number)


def test_overrides_replace_keys_and_leave_their_neighbours():
    case = load_case("pair_head_on")
    half = case.variants()[1]
    assert case.contact.restitution == 0.5
    assert [run.contact.restitution for run in case.variants()] == [0.2, 0.5, 0.8, 1.0]
    assert half.contact.static_friction == case.contact.static_friction
    assert half.particle == case.particle
    assert half.variants() == [half]


def test_overrides_replace_a_list_as_a_whole():
    steep = load_case("wall_oblique").variants()[1]
    assert len(steep.particle) == 1
    assert isinstance(steep.particle[0], Particle)
    assert steep.particle[0].velocity == (0.3, 0.4, -0.866025)


def test_material_of_the_example_is_the_paper_s():
    materials = load_case("bounce_train").material
    assert materials["alumina"] == Material(
        density=3950.0, youngs_modulus=370e9, poisson_ratio=0.22, yield_stress=None
    )
    assert materials["copper"].yield_stress == float(Decimal("0.3e9"))


def test_jitter_leaves_every_drop_above_the_surface_of_its_place():
    # touch heights, um, at the worst jitter; R = 0.25 um, square raised by 1 um over [2, 3] um
    r = 0.25
    touch = {
        "plateau": 1 + r,
        "node_depth": 1 + r,
        "edge": 1 + math.sqrt(r**2 - (0.08 - 0.02) ** 2),
        "corner": 1 + math.sqrt(r**2 - 2 * (0.05 - 0.02) ** 2),
        "flank": 4 - (3.627 - 0.02) + math.sqrt(2) * r,
        "valley": 4 - (4.0635 - 0.015) + math.sqrt(2) * r,
        "on_edge": 1 + r,
        "on_corner": 1 + r,
    }
    for run in load_case("asperity_bounce").variants():
        gap = run.particle[0].position[2] * 1e6 - touch[run.variant]
        assert 0.010 < gap < 0.020  # of 10 to 20 nm, nearest approach


def test_contact_is_at_fifteen_nanoseconds_in_every_pair_case():
    for name in ("pair_head_on", "pair_stick", "pair_slip"):
        case = load_case(name)
        first, second = case.particle
        period = (case.surface.size, case.surface.size, math.inf)
        apart = []
        for a, b, v, w, length in zip(
            first.position, second.position, first.velocity, second.velocity, period, strict=True
        ):
            nearest = math.remainder(b - a, length) if math.isfinite(length) else b - a
            apart.append(nearest + (w - v) * 15e-9)
        # positions are decimals of 4e-6 m: 4 roundings of 4e-6 m are 4e-21 m, 5e-15 of the distance
        reach = (first.diameter + second.diameter) / 2
        assert math.hypot(*apart) == pytest.approx(reach, rel=1e-14, abs=0.0)
        assert [x / reach for x in apart] == pytest.approx([0.6, 0.48, 0.64], rel=0.0, abs=1e-14)


def test_units_are_built_only_when_a_text_needs_them():
    code = "import sys, reference.case; sys.exit(any(m in sys.modules for m in ('pint', 'numba', 'pandas')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("name", [name for name in available_cases() if load_case(name).pad is None])
def test_outputs_fall_on_steps_so_that_halving_the_step_halves_every_step(name):
    for run in load_case(name).variants():
        steps = run.case.duration / (run.case.outputs - 1) / run.numerics.time_step
        assert steps == pytest.approx(round(steps), rel=1e-12, abs=0.0)  # four roundings, with room
        assert round(steps) >= 1
