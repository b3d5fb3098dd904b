"""Bad cases: each gives one line that names file, line, key, value and what is allowed."""

import pytest

from reference.case import CaseError, load_case

GOOD = """\
[case]
name = "good"
title = "Two spheres above a wall"
description = "Eq (9)."
duration = "1 us"

[[particle]]
diameter = "0.9 um"
position = ["0.5 um", "2 um", "1 um"]
velocity = [0, 0, -1]
material = "alumina"

[[particle]]
diameter = "0.8 um"
position = ["2.5 um", "2 um", "1 um"]
velocity = [0, 0, -1]
material = "alumina"

[material.alumina]
density = "3950 kg/m^3"
youngs_modulus = "370 GPa"
poisson_ratio = 0.22

[material.copper]
density = "8960 kg/m^3"
youngs_modulus = "120 GPa"
poisson_ratio = 0.34
yield_stress = "0.3 GPa"

[fluid]
density = 1000
viscosity = "1 mPa s"
flow = "couette"
wall_speed = "1 m/s"
gap = "4 um"

[surface]
kind = "flat"
size = "4 um"
nodes = 8
material = "copper"

[contact]
restitution = 0.5
static_friction = 0.3
dynamic_friction = 0.2

[removal]
deposit = "volume"

[numerics]
time_step = "2 ns"

[engine.lammps]
contact_duration = "4 ns"

[[variant]]
name = "a"
overrides.contact.restitution = 0.8

[[variant]]
name = "b"
"""

# text of GOOD (its first occurrence), what replaces it; then of the message: key, value, what is allowed
REFUSED = {
    "unknown key": (
        "restitution =",
        "restituton =",
        "contact.restituton",
        "0.5",
        "did you mean 'restitution'",
    ),
    "unknown section": ("[removal]", "[remove]", "remove", "volume", "unknown key"),
    "wrong dimension": ('"0.9 um"', '"0.9 kg"', "particle[0].diameter", "'0.9 kg'", "a length > 0"),
    "unknown unit": ('"0.9 um"', '"0.9 umm"', "particle[0].diameter", "'0.9 umm'", "a length > 0"),
    "no unit": ('"0.9 um"', '"0.9"', "particle[0].diameter", "'0.9'", "a length > 0"),
    "no number": ('"0.9 um"', '"um"', "particle[0].diameter", "'um'", "a length > 0"),
    "arithmetic": ('"0.9 um"', '"9**9**9 um"', "particle[0].diameter", "'9**9**9 um'", "a length > 0"),
    "truth value": ("= 0.22", "= true", "material.alumina.poisson_ratio", "True", "a number >= 0 and <= 0.5"),
    "diameter zero": ('"0.9 um"', '"0 um"', "particle[0].diameter", "'0 um'", "> 0"),
    "diameter negative": ('"0.9 um"', '"-0.9 um"', "particle[0].diameter", "'-0.9 um'", "> 0"),
    "density negative": ("= 1000", "= -1000", "fluid.density", "-1000", "a density > 0"),
    "e above 1": ("= 0.5", "= 1.2", "contact.restitution", "1.2", ">= 0 and <= 1"),
    "e below 0": ("= 0.5", "= -0.1", "contact.restitution", "-0.1", ">= 0 and <= 1"),
    "mu_d > mu_s": ("= 0.2\n", "= 0.4\n", "contact.dynamic_friction", "0.4", "<= static_friction, 0.3"),
    "nu above 0.5": ("= 0.22", "= 0.6", "material.alumina.poisson_ratio", "0.6", ">= 0 and <= 0.5"),
    "nan": ("= 0.22", "= nan", "material.alumina.poisson_ratio", "nan", "finite"),
    "inf": ("= 1000", "= inf", "fluid.density", "inf", "finite"),
    "inf in an engine": ('"4 ns"', "inf", "engine.lammps.contact_duration", "inf", "finite"),
    "overflow": ("= 1000", "= 1" + 400 * "0", "fluid.density", "1000", "a density > 0"),
    "duration zero": ('"1 us"', '"0 us"', "case.duration", "'0 us'", "a time > 0"),
    "step too long": ('"2 ns"', '"2 us"', "numerics.time_step", "'2 us'", "<= case.duration"),
    "no step": ('time_step = "2 ns"', "", "numerics.time_step", "missing", "required without a pad"),
    "nodes": ("nodes = 8", "nodes = 1", "surface.nodes", "1", "greater than or equal to 2"),
    "nodes not whole": ("nodes = 8", "nodes = 8.5", "surface.nodes", "8.5", "a valid integer"),
    "surface without nodes": (
        "nodes = 8",
        "",
        "surface.nodes",
        "missing",
        "required with surface.kind = 'flat'",
    ),
    "unknown kind": ('"flat"', '"flatt"', "surface.kind", "'flatt'", "'none', 'flat' or 'asperities'"),
    "height over a wall": ("nodes = 8", "nodes = 8\nheight = 1", "surface.height", "1", "leave it out"),
    "unknown material": ('"copper"', '"coper"', "surface.material", "'coper'", "did you mean 'copper'"),
    "overlap": ('["2.5 um"', '["1 um"', "particle[1].position", "'1 um'", "overlaps particle[0]"),
    "overlap of images": (
        '["2.5 um"',
        '["3.8 um"',
        "particle[1].position",
        "'3.8 um'",
        "overlaps particle[0]",
    ),
    "overlap by jitter": (
        '["0.5 um", "2 um", "1 um"]',
        '["1.6 um", "2 um", "1 um"]\nposition_jitter = "40 nm"',  # 0.9 um - 57 nm < 0.85 um
        "particle[1].position",
        "'2.5 um'",
        "overlaps particle[0]",
    ),
    "outside the box": (
        '["0.5 um"',
        '["4 um"',
        "particle[0].position[0]",
        "'4 um'",
        "from 0 to below 4e-06 m",
    ),
    "below the surface": ('"1 um"]', '"0.44 um"]', "particle[0].position[2]", "'0.44 um'", ">= the radius"),
    "larger than the box": ('"0.9 um"', '"2.1 um"', "particle[0].diameter", "'2.1 um'", "half the period"),
    "two components": ("[0, 0, -1]", "[0, 0]", "particle[0].velocity[2]", "missing", "required"),
    "particles twice": (
        "[surface]",
        "[particles]\ncount = 2\nmean_diameter = 1e-6\nmaterial = 'copper'\n[surface]",
        "",
        "",
        "either [particles], placed at random, or [[particle]]",
    ),
    "no yield stress": ('yield_stress = "0.3 GPa"', "", "material.copper.yield_stress", "missing", "removal"),
    "couette without gap": ('gap = "4 um"', "", "fluid.gap", "missing", "required with flow = 'couette'"),
    "couette and velocity": (
        'gap = "4 um"',
        'gap = "4 um"\nvelocity = [0, 0, 0]',
        "fluid.velocity",
        "[0, 0, 0]",
        "leave it out",
    ),
    "name of a folder": ('"good"', '"go/od"', "case.name", "'go/od'", "letters, digits"),
    "name of the parent": ('name = "a"', 'name = ".."', "variant[0].name", "'..'", "letters, digits"),
    "variant twice": ('name = "b"', 'name = "A"', "variant[1].name", "'A'", "a name of its own"),
    "variant out of range": ("= 0.8", "= 8", "variant 'a': contact.restitution", "8", ">= 0 and <= 1"),
    "variant unknown key": (
        "overrides.contact.restitution",
        "overrides.contact.e",
        "variant 'a': contact.e",
        "0.8",
        "unknown key",
    ),
}


def message(path) -> str:
    with pytest.raises(CaseError) as refused:
        load_case(path)
    text = str(refused.value)
    assert "\n" not in text
    return text


def test_the_good_case_is_good(tmp_path):
    (tmp_path / "good.toml").write_text(GOOD)
    assert [run.contact.restitution for run in load_case(tmp_path / "good.toml").variants()] == [0.8, 0.5]


@pytest.mark.parametrize("old, new, key, value, allowed", REFUSED.values(), ids=REFUSED.keys())
def test_refusal_names_file_line_key_value_and_what_is_allowed(tmp_path, old, new, key, value, allowed):
    assert old in GOOD
    path = tmp_path / "bad.toml"
    path.write_text(GOOD.replace(old, new, 1))
    text = message(path)
    where, said = text.split(": ", 1)
    assert where.startswith(str(path))
    assert said.startswith(key)
    assert value in said
    assert allowed in said


@pytest.mark.parametrize(
    "old, new, line",
    [
        ('"0.9 um"', '"0 um"', 8),
        ('"0.8 um"', '"0 um"', 14),
        ("= 0.5", "= 2", 44),
        ("= 0.8\n", "= 8\n", 59),  # in a variant
        ("[0, 0, -1]", '[\n  0,\n  "0 um",\n  -1,\n]', 14),  # complete on the line of its bracket
        ("= 0.22", "0.22", 22),  # malformed
    ],
)
def test_refusal_names_the_line(tmp_path, old, new, line):
    path = tmp_path / "bad.toml"
    path.write_text(GOOD.replace(old, new, 1))
    assert message(path).startswith(f"{path}:{line}: ")


def test_removal_needs_a_surface(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text(
        GOOD.replace('"flat"', '"none"').replace("nodes = 8\n", "").replace('material = "copper"\n', "")
    )
    assert "removal: needs a surface; allowed: surface.kind flat or asperities" in message(path)


@pytest.mark.parametrize("cut", ["[case]", "[contact]", "[surface]", "[material.alumina]"])
def test_a_missing_section_is_named(tmp_path, cut):
    blocks = [block for block in GOOD.split("\n\n") if not block.startswith((cut, "[[variant]]"))]
    (tmp_path / "bad.toml").write_text("\n\n".join(blocks))
    text = message(tmp_path / "bad.toml")
    assert (
        ("unknown material" in text)
        if "material" in cut
        else text.endswith(f"{cut[1:-1]}: required, but missing")
    )


def test_missing_file_folder_and_binary_are_named(tmp_path):
    assert message(tmp_path / "none.toml") == f"{tmp_path / 'none.toml'}: no such file"
    assert "cannot be read" in message(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    assert "not UTF-8" in message(tmp_path / "binary.toml")
    (tmp_path / "empty.toml").write_text("")
    assert "case: required, but missing" in message(tmp_path / "empty.toml")


def test_unknown_case_lists_the_cases_and_the_nearest():
    text = message("swrm")
    assert "unknown case 'swrm'" in text
    assert "did you mean 'swarm'" in text
    assert "asperity_bounce, bounce_train" in text


def test_an_engine_s_entry_is_refused_by_its_key(tmp_path):
    for text in ("4 ns", "4 m"):
        (tmp_path / "case.toml").write_text(GOOD.replace('"4 ns"', f'"{text}"'))
        case = load_case(tmp_path / "case.toml")
        entry = case.engine["lammps"]["contact_duration"], "second", "engine.lammps.contact_duration"
        if text == "4 ns":
            assert case.quantity(*entry) == 4e-9
            continue
        said = r"case\.toml:55: engine\.lammps\.contact_duration = '4 m': wrong dimension"
        with pytest.raises(CaseError, match=said):
            case.quantity(*entry)
