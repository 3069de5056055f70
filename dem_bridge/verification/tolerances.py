"""How far runs may differ in each check of a verification: the tolerances of its verdicts.

====================  ==============================================================================================
twin                  the round-off of absolute positions that the twins predict for the run of LAMMPS
positional twin       :func:`twin_tolerance`: two realisations of the round-off, each as large as the known one
tables                :func:`table_tolerance`: the predicted interpolation error and the round-off of its measurement
second reference      :func:`references_tolerance`: the sum of both uncertainties
accuracy              :func:`accuracy_tolerance`: the accuracy that is asked for, of velocities
order                 :data:`ORDER_TOLERANCE`
momentum              :func:`momentum_tolerance`: each step rounds each velocity
energy                the accuracy that is asked for
====================  ==============================================================================================
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dem_bridge.observables.differences import Difference, Readings
from dem_bridge.runs.uncertainty.fixed_step import REALISATIONS
from dem_bridge.trajectory.relative import relative_size
from dem_bridge.trajectory.trajectory import Trajectory

#: permissible deviation of the observed order from 2, and from 1 where forces depend on velocities
ORDER_TOLERANCE = {2: 0.05, 1: 0.1}
#: permissible ratio of measured to predicted errors of tables: both errors of forces are sampled, and neither samples
#: the exact maximum
TABLE_FACTOR = {"error": 1.1, "energy_error": 1.0}


def twin_tolerance(
    readings: Readings, quantity: str, twin: Trajectory, positional: Trajectory, tabled: Trajectory | None = None
) -> float:
    """Return how much LAMMPS may differ from the positional twin in a quantity, relative.

    Both round in the same way, but not each operation in the same order; the errors of step and sampling are the same.
    """
    # two realisations of the round-off, each as large as the known one
    rounding = readings.difference(quantity, positional, tabled or twin).value
    allowed = 2.0 * rounding + REALISATIONS * twin.uncertainty.parts["last_digit"]
    if quantity == "displacement":
        # a body that drifts adds the same increment at every step, which may fall on either side of a tie each time
        farthest = 2.0 * float(positional.provenance["settings"]["surrogate_radius"]) * twin.velocity.shape[1]
        largest = float(np.max(np.abs(twin.displacement), initial=0.0))
        allowed += relative_size(twin.cost.steps * float(np.spacing(farthest + largest)), largest)
    return allowed


def table_tolerance(errors: Mapping[str, float], kind: str) -> float:
    """Return how far forces ("error") or energies ("energy_error") from tables may be off the contact laws, relative.

    Parameters
    ----------
    errors : mapping of str to float
        Of the provenance of a run with tables.
    kind : str
        One of :data:`TABLE_FACTOR`.

    """
    return TABLE_FACTOR[kind] * errors[f"predicted_{kind}"] + errors["round_off"]


def references_tolerance(compared: Difference) -> float:
    """Return how far two references may differ: each must be right within the uncertainty that it states."""
    return compared.uncertainty + compared.reference_uncertainty


def accuracy_tolerance(compared: Difference, accuracy: float) -> float:
    """Return how far a run may be off the reference.

    The accuracy is that of velocities; other quantities may err by the uncertainty at this step.
    """
    return accuracy if compared.quantity == "velocity" else max(accuracy, compared.uncertainty)


def momentum_tolerance(run: Trajectory) -> float:
    """Return how far momentum may drift: each step rounds each velocity by at most half a unit in its last place."""
    return run.cost.steps * float(np.finfo(float).eps)
