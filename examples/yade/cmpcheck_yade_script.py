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

# Of two materials this release makes a contact in series, k1 k2/(k1 + k2): half of each where they are equal.
# (Its manual says twice that; a comparison of e = 0.5 then finds 0.60.)
twice = {name: 2.0 * job[name] for name in ("kn", "cn", "ks", "cs")}
material = ViscElMat(frictionAngle=math.atan(job["friction"]), density=1.0, **twice)
O.materials.append(material)
if job["wall"]:
    O.bodies.append(utils.wall(0.0, axis=2, sense=0, material=material))
ids = []
for position, velocity, mass, radius in zip(
    job["positions"], job["velocities"], job["masses"], job["radii"], strict=True
):
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
