"""One variant of a case in one engine, at the resolution that the case file asks for.

Levels of resolution, copies and comparisons are `study.py`'s business.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

from cmpcheck.engines import make_engine
from cmpcheck.engines.protocol import Resolution
from cmpcheck.study import align_outputs, contact_settings
from reference.case import Case
from reference.process import build_setup
from reference.recording import Run, timing
from reference.simulation import simulate
from reference.state import Setup


def run_variant(
    case: Case, engine: str, folder: Path, progress: Callable[[float], None], resume: bool = False
) -> Run:
    """Simulate one of a case's `variants()`, write its run folder and return the run.

    Parameters: progress is called with the fraction done, by engines that can tell it; resume goes on from
    a checkpoint, which only the reference writes.
    Raises CaseError, SimulationError and EngineError as the engine does.
    """
    if engine == "reference":
        return simulate(case, folder, progress, resume)
    setup = align_outputs(build_setup(case))
    begin = perf_counter()
    run = make_engine(engine).run(setup, _resolution(setup, case, engine))
    run.provenance["timing"] = timing(perf_counter() - begin, run.provenance["steps"], len(run.diameters))
    run.save(folder)
    progress(1.0)
    return run


def _resolution(setup: Setup, case: Case, engine: str) -> Resolution:
    """Contact duration and steps of `[engine.NAME]`; the time step divides the interval between outputs."""
    duration, steps_per_contact = contact_settings(case, engine)
    interval = float(setup.output_times[1])
    time_step = interval / math.ceil(interval * steps_per_contact / duration)
    form = "impulse" if setup.model.has_pad else "soft" if setup.model.has_surface else "native"
    return Resolution(time_step, duration, form)
