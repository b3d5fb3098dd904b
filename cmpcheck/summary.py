"""A finished run in a few lines: how much was computed, how fast, and what became of the surface."""

from __future__ import annotations

import numpy as np

from reference.recording import Run


def summary(run: Run) -> list[str]:
    """Lines for the terminal: steps and speed, removals and flatness where there are any, notes."""
    provenance, history = run.provenance, run.history
    lines = [f"steps     {provenance['steps']:,}"]
    if "timing" in provenance:
        timing = provenance["timing"]
        sessions = f" and {timing['sessions']} sessions" if timing["sessions"] > 1 else ""
        speed = f"{timing['particle_steps_per_second']:,.0f} particle-steps/s"
        lines[0] += f" in {duration(timing['wall_time'])}{sessions}"
        lines[0] += f", {speed}" if timing["wall_time"] >= 1.0 else ""
    if run.case.removal is not None:
        lines.append(f"removals  {_removals(run):,}, {history['removed_volume'].iloc[-1]:.3g} m3")
    flatness = history["flatness"].to_numpy()
    if run.case.surface.kind == "asperities" and np.isfinite(flatness[0]):
        middle = np.interp(0.5 * run.times[-1], run.times, flatness)
        lines.append(
            f"flatness  {flatness[0]:.3g} at the start, {middle:.3g} half-way, {flatness[-1]:.3g} at the end"
        )
    return lines + [f"note      {note}" for note in provenance.get("notes", [])]


def _removals(run: Run) -> int:
    """How many impacts removed material: the reference counts them, so that its ledger need not be read."""
    if "removals" in run.history:
        return int(run.history["removals"].iloc[-1])
    return int((run.contacts["removed_volume"] > 0).sum())


def duration(seconds: float) -> str:
    """A time for people: 3.1 s, 18 min 40 s."""
    if seconds < 60.0:
        return f"{seconds:.2g} s" if seconds < 10.0 else f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"
