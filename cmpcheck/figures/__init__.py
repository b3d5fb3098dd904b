"""The paper's figures, redrawn from our own equations and runs, as SVG and PNG with captions.

Here stands which runs are made and what is written.  What the figures show is `model.py` (Figs. 2 and 3) and
`polishing.py` (Figs. 4 to 6); how they look, `canvas.py`; how they come into a report, `report.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from cmpcheck.figures.canvas import Picture, paper_style, save
from cmpcheck.figures.model import cap_picture, yield_picture
from cmpcheck.figures.polishing import flatness_picture, snapshot_picture, surface_picture
from cmpcheck.outputs import writable
from reference.case import Case
from reference.ensemble import sample_case
from reference.recording import Run
from reference.simulation import simulate

__all__ = ["EXAMPLE", "draw_figures", "simulate_samples", "write_figures"]

EXAMPLE = "polish"  # the case of Figs. 4 to 6


def simulate_samples(
    case: Case, samples: int, jobs: int, progress: Callable[[int], None] = lambda done: None
) -> list[Run]:
    """The first `samples` samples of a case, `jobs` at a time, in the reference.

    `progress` is called with the number of samples done.  Raises SimulationError.
    """
    runs = []
    with ThreadPoolExecutor(jobs) as pool:  # the kernel lets other threads run
        for run in pool.map(simulate, [sample_case(case, k) for k in range(samples)]):
            runs.append(run)
            progress(len(runs))
    return runs


def draw_figures(runs: Sequence[Run]) -> list[Picture]:
    """Figs. 2 to 6; the first of the runs of one case is that of Figs. 4 and 5.

    Call it, and use what it returns, within `canvas.paper_style()`.
    """
    case = runs[0].case
    return [
        yield_picture(case),
        cap_picture(case),
        surface_picture(runs[0]),
        snapshot_picture(runs[0]),
        flatness_picture(runs),
    ]


def write_figures(runs: Sequence[Run], folder: Path) -> list[Path]:
    """Write each figure as SVG and PNG, and README.md with the captions; replaces files of these names.

    Raises OutputError where nothing can be written.
    """
    writable(folder)
    files, text = [], ["# The paper's figures, redrawn", ""]
    with paper_style():
        for picture in draw_figures(runs):
            files += save(picture, folder)
            text += [
                f"![{picture.title}]({picture.name}.svg)",
                "",
                f"**{picture.title}.** {picture.caption}",
                "",
            ]
    captions = folder / "README.md"
    captions.write_text("\n".join(text), "utf-8", newline="\n")
    return [*files, captions]
