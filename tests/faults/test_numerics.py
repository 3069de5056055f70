"""Faults in the numerics of an engine, committed by a plain code that stands in for LAMMPS at every step size.

No deck makes LAMMPS commit these. The stand-in is sound without a fault: then all verdicts pass.
"""

from __future__ import annotations

from collections.abc import Callable

import pytest

from dem_bridge.verification.reference_choice import REFERENCE
from dem_bridge.verification.roles import POSITIONAL
from tests.helpers.fault_judging import BENCH, ENERGY, IMPLEMENTATION, MOMENTUM, ORDER, USER, Fault, minus
from tests.helpers.fault_stand_in import Code, Net, State, runs_of


class StaleForceOnOneBody(Code):
    """Body 2 is moved by the net force of the step before; its partners by that of the step."""

    def net_force(self, force: list[float]) -> list[float]:
        now = super().net_force(force)
        old, self.before = self.before or now, now
        return [*now[:2], old[2], *now[3:]]


class StaleContact(Code):
    """Contact 1 answers, on both sides, with the force of the step before."""

    def contact_force(self, overlap: list[float], stiffness: tuple[float, ...]) -> list[float]:
        now = super().contact_force(overlap, stiffness)
        old, self.before = self.before or now, now
        return [now[0], old[1], now[2]]


class Leapfrog(Code):
    """One whole kick per step: positions are those of velocity-Verlet, velocities half a step off."""

    def stepped(self, state: State, net: Net, mass: tuple[float, ...], dt: float) -> State:
        x, v, f = state
        first, self.before = not self.before, [dt]
        v = self.kicked(v, f, mass, 0.5 * dt if first else dt)
        x = [place + dt * speed for place, speed in zip(x, v, strict=True)]
        return x, v, net(x)


class WeakReaction(Code):
    """Contact 1 pushes back a billionth less than it pushes."""

    def net_force(self, force: list[float]) -> list[float]:
        now = super().net_force(force)
        return [now[0], now[1] + 1e-9 * force[1], *now[2:]]


FAULTS: dict[str, Fault[Callable[[], Code]]] = {
    # a lag of dt is first order; between two bodies whose forces are not of one moment momentum is lost
    "force on one body a step stale": Fault(
        plant=StaleForceOnOneBody, shows=IMPLEMENTATION | USER | ORDER | ENERGY | MOMENTUM, begins=15e-6
    ),
    "force of one contact a step stale": Fault(
        plant=StaleContact, shows=IMPLEMENTATION | USER | ORDER | ENERGY, begins=15e-6
    ),
    # positions are right, so displacements are; contacts turn where the closing rate does, so crossings are late
    "half-step velocities": Fault(
        plant=Leapfrog,
        shows=(IMPLEMENTATION | USER | ORDER | ENERGY)
        - minus(POSITIONAL, "displacement", "contact_force")
        - minus(REFERENCE, "displacement"),
        begins=0.0,
    ),
    "a reaction weaker by 1e-9": Fault(plant=WeakReaction, shows=IMPLEMENTATION | MOMENTUM),
}


def test_the_sound_stand_in_fails_nothing() -> None:
    BENCH.check(runs_of(Code))


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
def test_a_fault_in_the_numerics_is_named(fault: Fault[Callable[[], Code]]) -> None:
    BENCH.check_fault(runs_of(fault.plant), fault)
