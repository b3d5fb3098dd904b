"""The paper's figures on the page of a report: which runs they are drawn from, and as what they are kept."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path

from cmpcheck.figures import EXAMPLE, draw_figures, simulate_samples
from cmpcheck.figures.canvas import paper_style, small_png
from cmpcheck.results import Illustration
from reference.case import Case, load_case
from reference.recording import Run

EXAMPLE_SAMPLES = 4  # of the paper's example, some ten seconds each


def report_illustrations(cases: Sequence[Case], profile: str, folder: Path, jobs: int) -> list[Illustration]:
    """Figs. 2 to 6 for a report that compares polishing; none where no case can be drawn.

    The full profile simulates samples of the paper's example.  The quick one draws the first polishing case
    among `cases`, from the reference's samples in `folder`/CASE/VARIANT/reference; it runs nothing.
    Raises CaseError or SimulationError.
    """
    variants = [variant for case in cases for variant in case.variants() if _drawable(variant)]
    if not variants:
        return []
    if profile == "full":
        (example,) = load_case(EXAMPLE).variants()
        runs = simulate_samples(example, EXAMPLE_SAMPLES, jobs)
        for k, run in enumerate(runs):
            run.save(folder / EXAMPLE / "reference" / str(k))
        return illustrate(runs)
    for case in variants:
        samples = folder / case.name / case.variant / "reference"
        names = sorted((path.name for path in samples.glob("[0-9]*")), key=int)
        if names:
            return illustrate([Run.load(samples / name) for name in names])
    return []


def illustrate(runs: Sequence[Run]) -> list[Illustration]:
    """Figs. 2 to 6 from runs of one case."""
    with paper_style():
        return [
            Illustration(picture.title, picture.caption, base64.b64encode(small_png(picture)).decode())
            for picture in draw_figures(runs)
        ]


def _drawable(case: Case) -> bool:
    """Whether it is polishing of a rough surface by particles under a pad, which the figures show."""
    rough = case.surface.kind == "asperities" and case.surface.asperity_density is not None
    return rough and None not in (case.pad, case.particles, case.removal)
