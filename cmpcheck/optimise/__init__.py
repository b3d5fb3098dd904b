"""Designing a process: the cost of parameter sets over ensembles, and the search for the best of them.

Paper: Sections 3.2 and 4.1.  `problem.py` says what a string of genes is worth, `evaluation.py` runs samples
on `workers.py` and keeps them in `store.py`, `search.py` is the paper's genetic algorithm, `methods.py` and
`front.py` are others; `results.py`, `findings.py`, `figures.py` and `page.py` show what came out.
"""
