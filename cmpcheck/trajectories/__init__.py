"""Trajectories that somebody else's code has written: files, their units, and the verdict on them."""

from __future__ import annotations

from cmpcheck.trajectories.judged import ENGINE, compare_file
from cmpcheck.trajectories.request import Trajectories, requested
from cmpcheck.trajectories.starts import Options, trajectory_run

__all__ = ["ENGINE", "Options", "Trajectories", "compare_file", "requested", "trajectory_run"]
