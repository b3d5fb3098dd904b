"""The custom Python fix that brings surface, drag and removal into LAMMPS (start with `slurry.py`)."""
