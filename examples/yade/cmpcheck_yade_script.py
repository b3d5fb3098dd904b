"""What YADE runs: `yade -n -x cmpcheck_yade_script.py FOLDER` reads job.json there and leaves samples.npy.

Units are um, us, pg.  Written for YADE's own Python; nothing of cmpcheck is imported.
"""

import json
import math
import os
import sys

import numpy as np
from yade import (
    Bo1_Sphere_Aabb,
    Bo1_Wall_Aabb,
    ForceResetter,
    Ig2_Sphere_Sphere_ScGeom,
    Ig2_Wall_Sphere_ScGeom,
    InsertionSortCollider,
    InteractionLoop,
    Ip2_ViscElMat_ViscElMat_ViscElPhys,
    Law2_ScGeom_ViscElPhys_Basic,
    NewtonIntegrator,
    O,
    ViscElMat,
    utils,
)

folder = sys.argv[-1]
with open(os.path.join(folder, "job.json")) as file:
    job = json.load(file)

# of two equal materials YADE makes a contact with twice the product over the sum: the same numbers
material = ViscElMat(
    kn=job["kn"],
    cn=job["cn"],
    ks=job["ks"],
    cs=job["cs"],
    frictionAngle=math.atan(job["friction"]),
    density=1.0,
)
O.materials.append(material)
if job["wall"]:
    O.bodies.append(utils.wall(0.0, axis=2, sense=0, material=material))
ids = []
for position, velocity, mass, radius in zip(job["positions"], job["velocities"], job["masses"], job["radii"]):
    body = utils.sphere(position, radius, material=material)
    body.state.mass, body.state.vel, body.state.blockedDOFs = mass, velocity, "XYZ"  # they do not spin
    ids.append(O.bodies.append(body))
O.engines = [
    ForceResetter(),
    InsertionSortCollider([Bo1_Sphere_Aabb(), Bo1_Wall_Aabb()]),
    InteractionLoop(
        [Ig2_Sphere_Sphere_ScGeom(), Ig2_Wall_Sphere_ScGeom()],
        [Ip2_ViscElMat_ViscElMat_ViscElPhys()],
        [Law2_ScGeom_ViscElPhys_Basic()],
    ),
    NewtonIntegrator(damping=0.0, gravity=(0.0, 0.0, 0.0)),
]
O.dt = job["time_step"]


def sample():
    """Positions and velocities of all spheres; the latter are half a step older or newer in a contact."""
    states = [O.bodies[k].state for k in ids]
    return [[*state.pos, *state.vel] for state in states]


samples = [sample()]
for _ in range(job["outputs"] - 1):
    O.run(job["stride"], True)
    samples.append(sample())
np.save(os.path.join(folder, "samples.npy"), np.array(samples), allow_pickle=False)
