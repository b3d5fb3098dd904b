"""The second stepper, `stepper = "fast"`: the steps of `timestep.py`, without what can be left out.

`timestep.py` is the answer key: it looks at every particle at every step.  Here particles are kept as one
array per component, so that drag and motion are short loops that the compiler turns into vector instructions
(`swarm.py`, `sweep.py`), and contacts are looked for only where and when there can be any: `watch.py` for the
surface, `near.py` for pairs.  Nothing is approximated: both steppers differ by round-off.
"""
