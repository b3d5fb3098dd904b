"""A report from its request to its folder: run the suite, keep what it finds, write the files, publish them.

Options and exit codes are `cli.py`; what is run is `suite.py`; which folder may be written is `outputs.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from cmpcheck import outputs
from cmpcheck.finished import SETTINGS, Finished
from cmpcheck.optimise.links import designs_beside
from cmpcheck.report import write_report
from cmpcheck.request import Request
from cmpcheck.results import COMPONENTS, SuiteResult
from cmpcheck.sensitivity.page import section_beside
from cmpcheck.shell import INTERRUPTED, progress_bars, sentence_of
from cmpcheck.suite import run_suite

RUNS = Path("runs")  # run folders that outlive a report


class Stopped(RuntimeError):
    """A comparison that was interrupted, or met a full disk, in one line: what is left, and how to go on."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code  # of the command's end


def make_report(
    request: Request,
    out: Path,
    jobs: int,
    force: bool = False,
    resume: bool = False,
    beside: Callable[[SuiteResult, Path], None] | None = None,
) -> SuiteResult:
    """Run what is asked for, or go on with it, and put the report into `out`.

    Every result is kept as it comes, one variant of a case at a time, so that an interrupted or killed
    comparison loses what was in flight.  `beside` may write more files into the folder, before it is shown.
    Raises OutputError for a folder that may not be written or holds nothing to go on with, CaseError for a
    case that cannot be compared, and Stopped.
    """
    staging = outputs.stage_report(out, force, resume)
    try:
        result = _find(request, staging, jobs, resume)
        if not (staging / outputs.PUBLISHING).exists():
            request.keep_inputs(staging / "data")
            write_report(result, staging, designs_beside(out), section_beside(out), jobs)
            if beside is not None:
                beside(result, staging)
        outputs.publish_report(staging, out)
    except (KeyboardInterrupt, OSError) as problem:
        outputs.release_report(staging)
        kept = f"{out} is as it was"
        if staging.exists():
            kept += "; the comparisons that are finished are kept; to go on: the same command with --resume"
        if isinstance(problem, OSError):
            raise Stopped(f"{sentence_of(problem)}; {kept}", 1) from None
        raise Stopped(f"interrupted: {kept}", INTERRUPTED) from None
    except BaseException:
        outputs.release_report(staging)
        raise
    return result


def _find(request: Request, staging: Path, jobs: int, resume: bool) -> SuiteResult:
    """What the suite finds, with bars on a terminal."""
    settings = request.settings()
    goes_on = resume and (staging / outputs.FINISHED / SETTINGS).exists()
    finished = (Finished.go_on if goes_on else Finished.begin)(staging, settings)
    variants = request.variants
    totals = {name: len(found) for name, found in variants.items()}
    totals |= dict.fromkeys([*([COMPONENTS] if request.components else []), *request.studies], 1)
    with progress_bars() as bars:
        tasks = {name: bars.add_task(name, total=total) for name, total in totals.items()}
        result = run_suite(
            list(request.cases),
            None if request.engines is None else list(request.engines),
            request.profile,
            staging,
            jobs,
            dict(request.decks),
            lambda name, done, total: bars.update(tasks[name], completed=done, total=total),
            request.studies,
            RUNS,
            request.trajectories,
            request.components,
            finished,
        )
    result.provenance["request"] = request.plain()
    return result
