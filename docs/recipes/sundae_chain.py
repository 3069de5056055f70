"""CVODE of SUNDIALS (PyPI ``scikit-sundae``): a right-hand side in numpy, Adams method.

CVODE chooses its steps by a tolerance, which is not its error; {dt} is the largest step that it may take.
"""

import numpy as np
from chain import arguments, write_csv
from sksundae.cvode import CVODE

chain, out = arguments()
mass, stiffness = np.array(chain.mass), np.array(chain.stiffness)
bodies = len(mass)


def right_hand_side(_, state, rate):
    """Set the velocities and accelerations of all bodies."""
    force = stiffness * np.maximum(state[: bodies - 1] - state[1:bodies], 0.0) ** 1.5
    rate[:bodies] = state[bodies:]
    rate[bodies:] = (np.append(0.0, force) - np.append(force, 0.0)) / mass


start = np.append(np.zeros(bodies), chain.velocity)
times = np.arange(chain.samples + 1) * (chain.every * chain.dt)
solver = CVODE(right_hand_side, method="Adams", rtol=1e-13, atol=1e-16, max_step=chain.dt, max_num_steps=10**7)
solution = solver.solve(times, start)
if not solution.success:
    raise SystemExit(f"CVODE: {solution.message}")
write_csv(out, solution.t, solution.y[:, :bodies], solution.y[:, bodies:])
