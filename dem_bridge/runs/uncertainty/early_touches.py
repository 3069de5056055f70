"""Jumps of a force at a touch in the first step, which all runs of a family place within it alike.

Adhesion and a dashpot set in at touch. A run with a fixed step has their force from the end of that step, and is wrong
by an impulse of the force times part of a step. Later touches fall on other parts of the steps of the other runs, whose
differences show it. In the first step all runs miss the force times the time until the touch alike, and the part of
their error that is proportional to the step may cancel that of other forces.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dem_bridge.runs.uncertainty.family import TwinFamily


def early_touch_part(family: TwinFamily) -> dict[str, Any]:
    """Return the uncertainty by touches in the first step of the coarsest run of a family, by quantity.

    The impulse, relative to that of the bodies that meet, is a part of their closing rate: forces change by twice that
    part at most (they go as its power ``2 (n - 1) / n``), and the time of a crossing by that part.
    """
    c, mobility = family.scene.contacts, np.append(1.0 / np.array(family.scene.mass), 0.0)
    velocity, first = np.append(family.scene.velocity, 0.0), max(1.0, *family.others) * family.plan.step
    left, right = mobility[c.left], mobility[c.right]
    rate = velocity[c.left] - velocity[c.right]
    early = (c.gap > 0.0) & (c.gap < first * rate)
    jump = c.pull_off + np.where(c.damping_power == 0.0, c.damping * np.maximum(rate, 0.0), 0.0)
    impulse = np.where(early, jump * c.gap / np.where(early, rate, 1.0), 0.0)
    share = float(np.sum(impulse * (left + right) / np.where(early, rate, 1.0)))
    kick = float(np.sum(impulse * np.maximum(left, right)))
    return {
        "velocity": kick,
        "displacement": kick * family.scene.duration,
        "peak_force": 2.0 * share * (family.main.peak_force + jump),
        "crossing_time": share * np.nan_to_num(family.main.crossing_time),
    }
