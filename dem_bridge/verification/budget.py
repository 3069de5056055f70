"""The error budget of a LAMMPS run: each part of its error, measured by other runs than the run that it explains.

==============  =================================================================================================
time step       twin - reference: the same algorithm at the same step, in overlap variables
table           twin with the deck's tables - twin; zero with ``pair_style granular``, which evaluates the law itself
round-off       positional twin - twin (both with the same tables, if any)
sampling        error of peaks and crossing times, which are read between time steps: every second dense sample - all
reference       uncertainty of the reference
==============  =================================================================================================

The first three parts are differences of trajectories, so the *unexplained* part is a trajectory, too: LAMMPS minus the
positional twin. An unexplained part that is larger than the uncertainty of the explanation indicates a fault.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from dem_bridge.observables.differences import Readings
from dem_bridge.observables.verdict import plain
from dem_bridge.trajectory.trajectory import QUANTITIES, Trajectory
from dem_bridge.verification.tolerances import twin_tolerance


@dataclass(frozen=True, kw_only=True)
class Budget:
    """Error of one quantity of a run and its parts, relative to the scale ``scale_name``."""

    quantity: str
    found: float
    """Run minus reference."""
    parts: Mapping[str, float]
    unexplained: float
    allowed: float
    """Largest unexplained part that another realisation of the round-off can cause."""
    scale_name: str

    @property
    def total(self) -> float:
        """Sum of the parts; it is at least ``found``, except for the unexplained part."""
        return sum(self.parts.values())

    @property
    def is_finding(self) -> bool:
        """Return whether the unexplained part is larger than round-off allows, which indicates a fault."""
        return not self.unexplained <= self.allowed

    def as_json(self) -> dict[str, Any]:
        """Return the budget as JSON values."""
        numbers = {name: plain(getattr(self, name)) for name in ("found", "total", "unexplained", "allowed")}
        parts = {name: plain(value) for name, value in self.parts.items()}
        return {"quantity": self.quantity, "scale_name": self.scale_name, **numbers, "parts": parts}


def budgets(
    readings: Readings,
    engine: Trajectory,
    twin: Trajectory,
    positional: Trajectory,
    reference: Trajectory,
    tabled: Trajectory | None = None,
) -> tuple[Budget, ...]:
    """Return the budgets of all quantities.

    ``readings`` are those of the runs. ``twin`` has the engine's steps, ``tabled`` its tables as well (None: the engine
    has none), and ``positional`` keeps absolute positions in addition.
    """
    budgets, same = [], tabled or twin
    for quantity in QUANTITIES:
        error, step = readings.difference(quantity, engine, reference), readings.difference(quantity, twin, reference)
        budgets.append(
            Budget(
                quantity=quantity,
                found=error.value,
                parts={
                    "time step": step.value,
                    "table": readings.difference(quantity, same, twin).value,
                    "round-off": readings.difference(quantity, positional, same).value,
                    "sampling": twin.uncertainty.sampling[quantity],
                    "reference": error.reference_uncertainty,
                },
                unexplained=readings.difference(quantity, engine, positional).value,
                allowed=twin_tolerance(readings, quantity, twin, positional, tabled),
                scale_name=error.scale_name,
            )
        )
    return tuple(budgets)
