"""REBOUND (PyPI ``rebound``): contact forces as additional forces, leapfrog integrator.

``gravity = "none"`` is required: with gravity, bodies on a line give nan. Positions are displacements, so that overlaps
have the digits of their own scale.
"""

import rebound
from chain import arguments, write_csv

chain, out = arguments()
simulation = rebound.Simulation()
simulation.gravity = "none"
simulation.integrator = "leapfrog"
simulation.dt = chain.dt
for mass, velocity in zip(chain.mass, chain.velocity, strict=True):
    simulation.add(m=mass, vx=velocity)
particles = simulation.particles


def contact_forces(_):
    """Add the accelerations by all contacts."""
    for k, stiffness in enumerate(chain.stiffness):
        overlap = particles[k].x - particles[k + 1].x
        if overlap > 0.0:
            force = stiffness * overlap**1.5
            particles[k].ax -= force / chain.mass[k]
            particles[k + 1].ax += force / chain.mass[k + 1]


simulation.additional_forces = contact_forces
time, displacement, velocity = [], [], []
for sample in range(chain.samples + 1):
    simulation.steps(chain.every if sample else 0)
    time.append(sample * chain.every * chain.dt)
    displacement.append([particle.x for particle in particles])
    velocity.append([particle.vx for particle in particles])
write_csv(out, time, displacement, velocity)
