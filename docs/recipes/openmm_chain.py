"""OpenMM (PyPI ``openmm``): contacts as bonds with a formula, VerletIntegrator.

The VerletIntegrator is a leapfrog: its velocities belong to the middle of the step before. With a fourth argument
``custom`` a CustomIntegrator does velocity Verlet. The Reference platform computes in double precision. OpenMM has nm,
ps and u, which are consistent: here 1 nm stands for 1 m, 1 ps for 1 s and 1 u for 1 kg.
"""

import sys

import openmm
from chain import arguments, write_csv

chain, out = arguments()
bodies = len(chain.mass)
system = openmm.System()
bonds = openmm.CustomBondForce("0.4*K*max(0,r0-r)^2.5")
bonds.addPerBondParameter("K")
bonds.addPerBondParameter("r0")
diameter = 2.0 * chain.radius()
for mass in chain.mass:
    system.addParticle(mass)
for k, stiffness in enumerate(chain.stiffness):
    bonds.addBond(k, k + 1, [stiffness, diameter])
system.addForce(bonds)
if sys.argv[4:] == ["custom"]:
    integrator = openmm.CustomIntegrator(chain.dt)
    integrator.addUpdateContextState()
    integrator.addComputePerDof("v", "v+0.5*dt*f/m")
    integrator.addComputePerDof("x", "x+dt*v")
    integrator.addComputePerDof("v", "v+0.5*dt*f/m")
else:
    integrator = openmm.VerletIntegrator(chain.dt)
context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName("Reference"))
context.setPositions([openmm.Vec3(k * diameter, 0.0, 0.0) for k in range(bodies)])
context.setVelocities([openmm.Vec3(v, 0.0, 0.0) for v in chain.velocity])
time, displacement, velocity = [], [], []
for sample in range(chain.samples + 1):
    integrator.step(chain.every if sample else 0)
    state = context.getState(getPositions=True, getVelocities=True)
    positions, velocities = state.getPositions(asNumpy=True)._value, state.getVelocities(asNumpy=True)._value
    time.append(sample * chain.every * chain.dt)
    displacement.append([positions[k][0] - k * diameter for k in range(bodies)])
    velocity.append([velocities[k][0] for k in range(bodies)])
write_csv(out, time, displacement, velocity)
