"""Benchmarks of the field: published impacts of single spheres, run in other engines than the reference.

The numbers of each publication are a TOML file in `data/`; `benchmark.py` reads them, `scene.py` lays the
spheres out, `run_lammps.py` and `run_liggghts.py` simulate them, `targets.py` knows what must come out,
`judge.py` makes the rows and `show.py` the figures.  The model of the paper has no spin: the reference takes
no part, and these cases test engines.
"""

from cmpcheck.published.benchmark import Benchmark, benchmark_names, load_benchmark

__all__ = ["Benchmark", "benchmark_names", "load_benchmark"]
