"""Items on what contacts conserve: momentum, and energy without damping. Neither needs a reference or a contact law."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from dem_bridge.judging.conformance import numerics
from dem_bridge.judging.conformance.behaviour import Behaviour
from dem_bridge.judging.conformance.explain import Explanation, Failure
from dem_bridge.judging.conformance.items import Item, failed_item, failure_item, not_run_item, passed_item
from dem_bridge.observables.verdict import Outcome

#: change of the momentum, relative to the sum of magnitudes, that round-off of a right code makes at most
LARGEST_ROUNDOFF_OF_MOMENTUM = 1e-9
#: the same in single precision: 6e-8 for each of 1e4 additions at random, with a margin of 2
LARGEST_SINGLE_NOISE_OF_MOMENTUM = 1e-5
#: change of the kinetic energy that is a fault, in addition to what the uncertainty of the limit explains
LEAST_ENERGY_CHANGE = 1e-5
#: relative change of the energy for one of the largest velocity: it goes as the square, and two bodies move at most
#: at once in the collisions that end with open contacts; the margin of 2 is that of the differences from the reference
ENERGY_OF_VELOCITY = 8.0


def conserved_items(
    used: Sequence[Behaviour], explanations: Mapping[str, Explanation], failures: Sequence[Failure], order: Item
) -> tuple[Item, Item]:
    """Return the items on momentum and energy.

    That on momentum has the number "noise" where the momentum changes as by rounding to single precision. ``order`` is
    the item on the order: without one there is no limit for a vanishing step whose energy could be told.
    """
    momentum = _momentum(used, explanations, failures)
    return momentum, _energy(used, failures, next((item for item in (momentum, order) if _fails(item)), None))


def _fails(item: Item) -> bool:
    """Return True if an item failed."""
    return item.outcome is Outcome.FAIL


def _momentum(used: Sequence[Behaviour], explanations: Mapping[str, Explanation], failures: Sequence[Failure]) -> Item:
    """Return the item on the conservation of momentum."""
    if item := failure_item("momentum", failures):
        return item
    having = [behaviour for behaviour in used if "velocity" in behaviour.limits]
    if not having:
        return not_run_item("momentum", "the files have no velocities")
    worst = max(having, key=numerics.momentum_drift)
    drift, scene = numerics.momentum_drift(worst), worst.probe.scene.name
    roundoff = LARGEST_ROUNDOFF_OF_MOMENTUM + max(map(numerics.momentum_by_digits, having))
    words = f"The momentum changes by {drift:.1e} of the sum of magnitudes"
    if drift <= roundoff:
        return passed_item("momentum", scene, f"{words}.", {"change": drift})
    if drift <= LARGEST_SINGLE_NOISE_OF_MOMENTUM:
        return passed_item("momentum", scene, f"{words}: that is the item digits.", {"change": drift, "noise": drift})
    scenes = [behaviour.probe.scene.name for behaviour in used]
    named = [failure for failure in failures if failure.scene in scenes]
    unexplained = [name for name in scenes if not explanations[name].right and explanations[name].fault is None]
    if named and (not unexplained or any(failure.fault.of_body for failure in named)):
        sentence = f"{words}; the fault of the item {named[0].item} explains it."
        return passed_item("momentum", scene, sentence, {"change": drift})
    apart = max(map(numerics.momentum_drift_apart, having))
    if apart > max(roundoff, LARGEST_SINGLE_NOISE_OF_MOMENTUM):
        sentence = f"{words}, and by {apart:.1e} while no bodies touch: a force acts that is none of a contact."
        return failed_item("momentum", scene, sentence, "outer-force", {"change": drift, "change_apart": apart})
    sentence = f"{words}: the forces of a contact on its two bodies are not equal and opposite."
    return failed_item("momentum", scene, sentence, "momentum", {"change": drift})


def _energy(used: Sequence[Behaviour], failures: Sequence[Failure], hiding: Item | None) -> Item:
    """Return the item on the conservation of energy; the fault of the item ``hiding`` changes it, too."""
    if item := failure_item("energy", failures):
        return item
    changes = {
        behaviour.probe.scene.name: (change, behaviour.uncertainty)
        for behaviour in used
        if (change := numerics.energy_change(behaviour)) is not None
    }
    if not changes:
        return not_run_item("energy", "no scene ends with open contacts, or files lack velocities or displacements")
    scene = max(changes, key=lambda name: abs(changes[name][0]))
    change, uncertainty = changes[scene]
    words = f"The kinetic energy changes by {change:+.1e} over a collision without damping"
    allowed = LEAST_ENERGY_CHANGE + ENERGY_OF_VELOCITY * uncertainty
    if abs(change) <= allowed:
        return passed_item("energy", scene, f"{words}.", {"change": change})
    named = [failure.item for failure in failures if failure.scene in changes]
    if hiding is not None:
        named = [hiding.name]
    if not named:
        return failed_item("energy", scene, f"{words}; steps explain {allowed:.1e}.", "energy", {"change": change})
    if hiding is not None and hiding.name == "momentum":
        sentence = f"{words}, and a momentum that is not conserved changes it: what contacts lose cannot be told."
        return replace(passed_item("energy", scene, sentence, {"change": change}), outcome=Outcome.UNDECIDED)
    sentence = f"{words}; the fault of the item {named[0]} explains it."
    return passed_item("energy", scene, sentence, {"change": change})
