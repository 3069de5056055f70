"""YADE (Debian ``yade``): spheres with Hertz-Mindlin contacts, whose stiffness is set as ``i.phys.kno``.

YADE's NewtonIntegrator is a leapfrog: the velocities that it shows belong to the middle of the step before. With a
fourth argument ``shifted`` the recipe adds a dt/2 with the acceleration at the positions that are written, so that both
belong to one time.
"""

import os
import sys

if "yade" not in sys.modules:  # started by an ordinary Python
    os.execvp("yade", ["yade", "-n", "-x", os.path.abspath(__file__), *sys.argv[1:]])

sys.path.insert(0, os.path.dirname(os.path.abspath(sys.argv[0])))
import yade.wrapper as yade
from chain import arguments, write_csv
from yade.utils import createInteraction, sphere

chain, out = arguments()
simulation, radius, bodies = yade.Omega(), chain.radius(), range(len(chain.mass))
material = yade.FrictMat(young=1e9, poisson=0.3, frictionAngle=0.0, density=1.0)
for k in bodies:
    body = sphere((2.0 * radius * k, 0.0, 0.0), radius, material=material)
    body.state.mass = chain.mass[k]
    body.state.vel = (chain.velocity[k], 0.0, 0.0)
    body.state.blockedDOFs = "yzXYZ"
    simulation.bodies.append(body)
simulation.engines = [
    yade.ForceResetter(),
    yade.InteractionLoop(
        [yade.Ig2_Sphere_Sphere_ScGeom()],
        [yade.Ip2_FrictMat_FrictMat_MindlinPhys()],
        [yade.Law2_ScGeom_MindlinPhys_Mindlin(neverErase=True)],
    ),
    yade.NewtonIntegrator(damping=0.0),
]
simulation.dt = chain.dt
for k, stiffness in enumerate(chain.stiffness):
    createInteraction(k, k + 1).phys.kno = stiffness
time, displacement, velocity = [], [], []
for sample in range(chain.samples + 1):
    if sample:
        simulation.run(chain.every, True)
    states = [simulation.bodies[k].state for k in bodies]
    time.append(simulation.iter * chain.dt)
    displacement.append([state.pos[0] - 2.0 * radius * k for k, state in enumerate(states)])
    velocity.append([state.vel[0] for state in states])
    if sys.argv[4:] == ["shifted"] and sample:
        for k, stiffness in enumerate(chain.stiffness):
            force = stiffness * max(displacement[-1][k] - displacement[-1][k + 1], 0.0) ** 1.5
            velocity[-1][k] -= 0.5 * chain.dt * force / chain.mass[k]
            velocity[-1][k + 1] += 0.5 * chain.dt * force / chain.mass[k + 1]
write_csv(out, time, displacement, velocity)
