"""The recorded states of a unit test of LAMMPS as samples of a run: a sample at the end of each of its segments."""

from __future__ import annotations

import numpy as np

from dem_bridge.errors import DemBridgeError, UsageError
from dem_bridge.formats.readers.record import Draft
from dem_bridge.lmp.reader.to_scene import read_deck
from dem_bridge.lmp.unit_test import UnitTest, recorded_states


def draft_of_unit_test(name: str, test: UnitTest) -> Draft:
    """Return velocities and displacements of the bodies of a test, whose script must be one chain with one time step.

    Raises
    ------
    UsageError
        If the script cannot be read as a chain, has several time steps, or no states were recorded.
    """
    try:
        read = read_deck(test.script, file=f"{name} as a script", opened=_no_file)
    except DemBridgeError as error:
        raise UsageError(f"the commands of the unit test cannot be read as a chain: {error}") from error
    states = recorded_states(test, read)
    if states is None or len(read.time_steps) != 1:
        raise UsageError(
            "the unit test has no recorded positions and velocities, or several time steps; allowed: run_pos and"
            " run_vel after at least one step, with one time step; record them with the test program (-g FILE)"
        )
    dt = read.time_steps[0]
    time = dt * np.array(states.steps, dtype=np.float64)
    draft = Draft(name=name, time=time, time_rounding=np.spacing(time), dt=dt)
    bodies = range(read.scene.n_body)
    draft.add("velocity", states.velocity, np.spacing(np.abs(states.velocity)), bodies)
    rounding = np.spacing(np.abs(states.place + states.displacement)) + np.spacing(np.abs(states.place))
    draft.add("displacement", states.displacement, rounding, bodies)
    draft.notes.append(f"the samples are the states that {test.recorder} recorded at the ends of the segments")
    return draft


def _no_file(name: str) -> str:
    """Raise OSError: a unit test is one file."""
    raise FileNotFoundError(2, "a unit test is one file", name)
