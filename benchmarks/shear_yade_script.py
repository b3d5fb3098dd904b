"""What YADE runs for `shear_yade.py`: reads job.npz in FOLDER and leaves end.npz.

Units are um, us, pg.  Written for YADE's own Python; nothing of cmpcheck is imported.
"""

import os
import sys
import time

import numpy as np
from yade import (
    Bo1_Sphere_Aabb,
    ForceResetter,
    Ig2_Sphere_Sphere_ScGeom,
    InsertionSortCollider,
    InteractionLoop,
    Ip2_ViscElMat_ViscElMat_ViscElPhys,
    Law2_ScGeom_ViscElPhys_Basic,
    NewtonIntegrator,
    O,
    PyRunner,
    Vector3,
    ViscElMat,
    utils,
)

folder = sys.argv[-1]
job = dict(np.load(os.path.join(folder, "job.npz")))
dt, lid = float(job["time_step"]), float(job["lid"])
mass, radius, stokes = job["masses"], job["radii"], job["stokes"]

O.periodic = True
O.cell.setBox(Vector3(float(job["periods"][0]), float(job["periods"][1]), 3.0 * lid))
# Of two materials this release makes a contact in series, k1 k2/(k1 + k2): half of each where they are equal.
twice = {name: 2.0 * float(job[name]) for name in ("kn", "cn", "ks", "cs")}
material = ViscElMat(frictionAngle=float(job["friction"]), density=1.0, **twice)
O.materials.append(material)
for position, velocity, m, r in zip(job["positions"], job["velocities"], mass, radius, strict=True):
    body = utils.sphere(Vector3(*position), r, material=material)
    body.state.mass, body.state.vel, body.state.blockedDOFs = m, Vector3(*velocity), "XYZ"  # no spin
    O.bodies.append(body)
states = [body.state for body in O.bodies]
speed, add = float(job["wall_speed"]), O.forces.addF
heavier = 1.0 / (1.0 / stokes + 0.5 * dt / mass)  # the velocity seen is half a step old
columns = (radius, heavier, job["wall_spring"], job["wall_damping"])
rows = list(zip(range(len(states)), states, *(column.tolist() for column in columns), strict=True))


def act():
    """Drag, surface and lid, one force on each particle, in plain numbers: arrays of vectors take longer."""
    for k, state, r, drag, spring, damping in rows:
        z, velocity = state.pos[2], state.vel
        vx, vy, vz = velocity[0], velocity[1], velocity[2]
        w = -drag * vz
        if z < r:
            w += max(spring * (r - z) - damping * vz, 0.0)
        elif z + r > lid:
            w -= max(spring * (z + r - lid) + damping * vz, 0.0)
        add(k, Vector3(drag * (speed * z / lid - vx), -drag * vy, w))


O.engines = [
    ForceResetter(),
    InsertionSortCollider([Bo1_Sphere_Aabb()], verletDist=0.05),
    InteractionLoop(
        [Ig2_Sphere_Sphere_ScGeom()], [Ip2_ViscElMat_ViscElMat_ViscElPhys()], [Law2_ScGeom_ViscElPhys_Basic()]
    ),
    PyRunner(command="act()", iterPeriod=1),
    NewtonIntegrator(damping=0.0, gravity=(0.0, 0.0, 0.0)),
]
O.dt = dt
begin = time.perf_counter()
O.run(int(job["steps"]), True)
seconds = time.perf_counter() - begin
np.savez(
    os.path.join(folder, "end.npz"),
    seconds=seconds,
    position=np.array([state.pos for state in states]),
    velocity=np.array([state.vel for state in states]),
)
