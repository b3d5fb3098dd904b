"""Bad input on purpose: targets, seeds, mutations, and the two ways in which they are driven.

`targets.py` says what may happen to an input and raises `Finding` for anything else; `seeds.py` holds good
inputs to start from; `mutations.py` spoils them; `guided.py` lets atheris look for new paths through the
code, `plain.py` draws from a seed without it.  `benchmarks/reliability_inputs.py` runs all of it and counts.
"""
