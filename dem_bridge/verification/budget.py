"""The budget of a LAMMPS run: what its error consists of, each part measured by other runs than the one it explains.

==============  =================================================================================================
time step       twin minus reference: the same algorithm at the same step, in overlap variables
table           twin with the deck's tables minus twin; none with ``pair_style granular``, which has the law itself
round-off       twin in positions, with the deck's gauge radius, minus twin in overlaps, with the same tables if any
sampling        what is read between time steps: peaks and crossings from every second dense sample; samples are steps
reference       the bar of the reference
==============  =================================================================================================

Parts with a sign are differences of whole trajectories, so what they leave *unexplained* is a trajectory, too: LAMMPS
minus the twin in positions. It is a finding where it exceeds what is uncertain in the explanation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dem_bridge.backends.twin_bars import REALISATIONS
from dem_bridge.differences import difference
from dem_bridge.trajectory import QUANTITIES, Trajectory
from dem_bridge.verification.verdict import plain


@dataclass(frozen=True, kw_only=True)
class Budget:
    """Error of one quantity of a run, relative to ``scale_name``, and its parts."""

    quantity: str
    found: float
    """Run minus reference."""
    parts: Mapping[str, float]
    unexplained: float
    allowed: float
    """What may stay unexplained: one more realisation of the round-off."""
    scale_name: str

    @property
    def total(self) -> float:
        """Sum of the parts: never below ``found`` but for what is unexplained."""
        return sum(self.parts.values())

    @property
    def is_finding(self) -> bool:
        return not self.unexplained <= self.allowed

    def as_json(self) -> dict[str, Any]:
        """JSON-able, see :func:`dem_bridge.verification.verdict.plain`."""
        numbers = {name: plain(getattr(self, name)) for name in ("found", "total", "unexplained", "allowed")}
        parts = {name: plain(value) for name, value in self.parts.items()}
        return {"quantity": self.quantity, "scale_name": self.scale_name, **numbers, "parts": parts}


def budgets(
    engine: Trajectory,
    twin: Trajectory,
    positional: Trajectory,
    truth: Trajectory,
    tabled: Trajectory | None = None,
) -> tuple[Budget, ...]:
    """Budgets of all quantities. ``twin`` took the engine's steps, ``tabled`` its tables, too (None: it has none), and
    ``positional`` keeps positions beside that."""
    found, same = [], tabled or twin
    for quantity in QUANTITIES:
        error, step = difference(quantity, engine, truth), difference(quantity, twin, truth)
        rounding = difference(quantity, positional, same).value
        sampling = twin.uncertainty.sampling[quantity]
        found.append(
            Budget(
                quantity=quantity,
                found=error.value,
                parts={
                    "time step": step.value,
                    "table": difference(quantity, same, twin).value,
                    "round-off": rounding,
                    "sampling": sampling,
                    "reference": error.reference_uncertainty,
                },
                unexplained=difference(quantity, engine, positional).value,
                allowed=_allowed(quantity, rounding, twin, positional),
                scale_name=error.scale_name,
            )
        )
    return tuple(found)


def allowance(quantity: str, twin: Trajectory, positional: Trajectory, tabled: Trajectory | None = None) -> float:
    """What LAMMPS may differ by from the twin in positions, relative: both round alike, but not each operation in the
    same order. What the step and sampling cost is the same in both."""
    return _allowed(quantity, difference(quantity, positional, tabled or twin).value, twin, positional)


def _allowed(quantity: str, rounding: float, twin: Trajectory, positional: Trajectory) -> float:
    # two realisations of a round-off, each as far from none as the one that is known
    allowed = 2.0 * rounding + REALISATIONS * twin.uncertainty.parts["last_digit"]
    if quantity == "displacement":
        # a body that drifts adds the same increment at every step, which may fall on either side of a tie each time
        farthest = 2.0 * float(positional.provenance["settings"]["surrogate_radius"]) * twin.velocity.shape[1]
        largest = float(np.max(np.abs(twin.displacement), initial=0.0))
        allowed += twin.cost.steps * float(np.spacing(farthest + largest)) / max(largest, 1e-300)
    return allowed
