"""The paper's figures show what our equations and runs say, legibly, and are the same every time."""

from __future__ import annotations

import math
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.colors import to_rgb
from matplotlib.quiver import Quiver
from polish_example import small_polish
from rounding import close
from typer.testing import CliRunner

from cmpcheck import figures
from cmpcheck.cli import app
from cmpcheck.figures import canvas, polishing
from cmpcheck.figures.model import yield_distance
from cmpcheck.surfaces import surface_mesh, surfaces_over_time
from reference import exact
from reference.case import load_case
from reference.ensemble import sample_case
from reference.recording import Run
from reference.simulation import simulate

NAMES = [f"figure_{number}" for number in range(2, 7)]


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    return [simulate(sample_case(small_polish(), k)) for k in range(3)]


@pytest.fixture(scope="module")
def pictures(runs):
    with canvas.paper_style():
        return {picture.name: picture for picture in figures.draw_figures(runs)}


@pytest.fixture(scope="module")
def folder(runs, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("figures")
    figures.write_figures(runs, folder)
    return folder


def words(svg: Path) -> list[str]:
    """The texts of an SVG whose letters are outlines: the backend names each in a comment."""
    return [text.strip() for text in re.findall(r"<!--(.*?)-->", svg.read_text("utf-8"), re.DOTALL)]


@given(angle=st.floats(0.0, 0.499 * math.pi), nu=st.floats(0.0, 0.45))
def test_the_envelope_is_where_the_stress_reaches_the_yield_stress(angle, nu):
    load, sigma_y = 2.0, 3.0
    distance = yield_distance(angle, nu) * exact.yield_radius(load, nu, sigma_y)
    r, z = distance * math.sin(angle), distance * math.cos(angle)
    stress = exact.tensor_von_mises(exact.point_load_stress(load, r, z, nu))
    # the closed form differentiates by a complex step and finds x_p by bisection: some 1e-10
    np.testing.assert_allclose(stress, sigma_y, rtol=1e-8, atol=0.0)


@given(nu=st.floats(0.0, 0.49))
def test_the_envelope_ends_at_x_p_and_z_p(nu):
    close(yield_distance(0.5 * math.pi, nu), 1.0)
    close(yield_distance(0.0, nu) ** 2, (7 - 2 * nu) / (2 * math.sqrt(3) * (1 - 2 * nu)))


def test_figure_2_draws_that_envelope_and_figure_3_that_cap(pictures):
    curves = {line.get_linewidth(): line.get_xydata() for line in pictures["figure_2"].figure.axes[0].lines}
    outline = curves[1.6]  # the last of this width is the cap: in units of x_p, through (1, 0)
    close(outline[-1], [1.0, 0.0], scale=1.0)
    radius, depth = 1 / 0.6, outline[:, 1].max()
    close(depth, exact.cap_depth(1.0, radius), rtol=1e-4)  # 200 points miss the axis by 1/200
    assert "z_p = 2.39 x_p" in pictures["figure_2"].caption


def test_figure_4_draws_every_node_of_the_first_surface(pictures, runs):
    colours = pictures["figure_4"].figure.axes[0].collections[0].get_array()
    points, _ = surface_mesh(runs[0].surface_initial)
    close(colours, points[:, 2] / 1e-6)
    raised = int((runs[0].surface_initial.z > 0).sum())
    assert f"{raised} of 256 nodes stand high" in pictures["figure_4"].caption


def test_figure_5_draws_surfaces_particles_and_velocities_of_its_times(pictures, runs):
    run, surfaces = runs[0], surfaces_over_time(runs[0])
    assert surfaces is not None
    panels = pictures["figure_5"].figure.axes[: polishing.SNAPSHOTS]
    for k, panel in enumerate(panels):  # six outputs, six panels
        heights, circles, arrows = panel.collections
        close(heights.get_array(), surface_mesh(surfaces[k])[0][:, 2] / 1e-6)
        close(circles.get_offsets(), run.positions[k, :, :2] / 1e-6)
        close(circles.get_widths(), run.diameters / 1e-6)
        assert isinstance(arrows, Quiver)
        close(np.column_stack([arrows.U, arrows.V]), run.velocities[k, :, :2])
        assert arrows.scale == 1 / polishing.ARROW
        assert f"= {run.history['flatness'][k]:.2f}," in panel.get_title()
    assert len({panel.collections[0].norm.vmin for panel in panels}) == 1  # one scale of grey


def test_figure_6_is_the_mean_and_spread_of_the_samples(pictures, runs):
    axes = pictures["figure_6"].figure.axes[0]
    flatness = np.array([run.history["flatness"] for run in runs])  # q = 2 in the case
    mean, spread = flatness.mean(axis=0), flatness.std(axis=0, ddof=1)
    lines = {line.get_label(): line.get_ydata() for line in axes.lines}
    close(lines["mean of 3 samples, $q = 2$"], mean)
    band = axes.collections[0].get_paths()[0].vertices
    close([band[:, 1].min(), band[:, 1].max()], [(mean - spread).min(), (mean + spread).max()])
    assert (lines["mean, $q = 1$"][1:] > mean[1:]).all()  # heights below 1 h_a weigh more without the square
    close(axes.lines[0].get_xdata()[-1], runs[0].case.removal.acceleration * runs[0].times[-1])


def test_without_acceleration_the_axis_is_time():
    runs = [simulate(sample_case(small_polish(removal={"acceleration": 1.0}), k)) for k in range(2)]
    with canvas.paper_style():
        pad = polishing.flatness_picture(runs).figure.axes[1]
    assert pad.get_xlabel() == "time $t$ (s)"
    close(pad.lines[0].get_xdata(), runs[0].times)


@pytest.mark.parametrize("name", NAMES)
def test_both_files_of_a_figure_are_whole_and_titled(name, folder):
    root = ElementTree.parse(folder / f"{name}.svg").getroot()
    assert root.tag.endswith("svg")
    assert (folder / f"{name}.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    texts = words(folder / f"{name}.svg")
    assert any(
        text.startswith(f"Fig. {name[-1]}: ") and ("Eq" in text or "Section" in text) for text in texts
    )


def test_axes_name_their_units(folder):
    for name, labels in {
        "figure_4": ["$x$ (µm)", "$y$ (µm)", "height $z$ (µm)"],
        "figure_5": ["$x$ (µm)", "$y$ (µm)", "height $z$ (µm)", "1 m/s"],
        "figure_6": ["time × acceleration, $A\\,t$ (s)", "cost function $\\Pi$"],
    }.items():
        assert set(labels) <= set(words(folder / f"{name}.svg")), name


def test_captions_stand_beside_the_figures(folder, pictures):
    text = (folder / "README.md").read_text("utf-8")
    for name, picture in pictures.items():
        assert f"]({name}.svg)" in text
        assert f"**{picture.title}.** {picture.caption}" in text


def test_the_same_runs_give_the_same_bytes(folder, runs, tmp_path):
    written = figures.write_figures(runs, tmp_path)
    assert sorted(path.name for path in written) == sorted(path.name for path in folder.iterdir())
    for path in written:
        assert path.read_bytes() == (folder / path.name).read_bytes(), path.name


def luminance(colour) -> float:
    """Relative luminance of sRGB, as WCAG defines it."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(colour)]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))


def contrast(one, other) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_arrows_stand_out_in_grey_from_the_darkest_height():
    assert contrast(canvas.INK, canvas.greys()(1.0)) > 3.0  # WCAG 1.4.11, for graphics
    assert contrast(canvas.BLUE, canvas.PALE) > 3.0


def test_the_example_is_the_papers():
    case = load_case(figures.EXAMPLE)
    grains, wafer = case.particles, case.surface
    assert (grains.count, grains.mean_diameter, grains.diameter_spread) == (73, 0.9e-6, 0.1)
    assert (wafer.size, wafer.asperity_height, wafer.asperity_density) == (20e-6, 0.5e-6, 0.025)
    assert case.pad.speed == 1.0
    close(case.case.duration * case.removal.acceleration, 1.0)  # T = 1 s


def test_the_command_draws_all_figures(monkeypatch, tmp_path):
    small_polish().save(tmp_path / "small.toml")
    monkeypatch.setattr(figures, "EXAMPLE", tmp_path / "small.toml")
    out = tmp_path / "figures"
    result = CliRunner().invoke(app, ["figures", "--out", str(out), "--samples", "2", "--jobs", "1"])
    assert (result.exit_code, result.stderr) == (0, "")
    files = [f"{name}.{kind}" for name in NAMES for kind in ("svg", "png")]
    assert result.stdout.split() == [str(out / file) for file in [*files, "README.md"]]


def test_a_place_that_cannot_be_written_is_refused_before_anything_runs(monkeypatch, tmp_path):
    monkeypatch.setattr(figures, "simulate_samples", lambda *_: pytest.fail("simulated"))
    (tmp_path / "out").write_text("mine")
    result = CliRunner().invoke(app, ["figures", "--out", str(tmp_path / "out")])
    assert (result.exit_code, len(result.stderr.splitlines())) == (2, 1)
    assert "cannot be written" in result.stderr
