"""Items that follow from the files alone: order, phase, digits, units, and the largest step."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from dem_bridge.foundation.wording import relative_number
from dem_bridge.judging.conformance import numerics
from dem_bridge.judging.conformance.behaviour import Behaviour
from dem_bridge.judging.conformance.conserved import conserved_items
from dem_bridge.judging.conformance.explain import Explanation, Failure
from dem_bridge.judging.conformance.items import Item, failed_item, failure_item, not_run_item, passed_item
from dem_bridge.judging.conformance.limit import LEAST_DIFFERENCE_WITH_ORDER
from dem_bridge.observables.verdict import Outcome

#: significant digits of the largest value, below which differences between the steps are lost
LEAST_DIGITS = 8.0
#: order below which errors do not fall with the step
LEAST_FALL = 0.5
#: difference between the delays of velocities and displacements that is none, steps
SAME_DELAY = 0.25
#: steps in a contact time at which a usable method is stable, within 1 %: shares are not exact
STEPS_IN_CONTACT_OF_STABLE_METHOD = 16.0 * 1.01
#: errors for which the largest step is told
ACCURACIES = (1e-2, 1e-4)

Delays = Mapping[str, numerics.Delay | None]


@dataclass(frozen=True)
class LargeStep:
    """A run of the first scene at one step."""

    share: float
    """Time step over contact time."""
    error: float
    """Largest velocity error relative to the largest velocity; infinite if the run failed."""
    stable: bool
    """False if values are not finite or the kinetic energy more than doubles."""


def property_items(
    behaviours: Mapping[str, Behaviour],
    explanations: Mapping[str, Explanation],
    failures: Sequence[Failure],
    large_steps: Sequence[LargeStep],
) -> Iterator[Item]:
    """Yield the items on order, phase, digits, units, momentum, energy and the largest step."""
    base = [behaviour for behaviour in behaviours.values() if behaviour.probe.basic]
    used = base or list(behaviours.values())[:1]
    if not used:
        names = ("order", "phase", "digits", "units", "momentum", "energy", "largest-step")
        yield from (not_run_item(name, "no scene has files that can be read") for name in names)
        return
    delays: Delays = {name: _delay(used, name) for name in ("velocity", "displacement")}
    order = _order(used, explanations, failures, delays)
    momentum, energy = conserved_items(used, explanations, failures, order)
    yield from (order, momentum, energy, _phase(used, failures, delays))
    yield _digits(used, momentum.numbers.get("noise", 0.0))
    yield _units(list(behaviours.values()), failures)
    yield _largest_step(large_steps)


def _delay(used: Sequence[Behaviour], name: str) -> numerics.Delay | None:
    """Return the delay of a quantity in the first scene that shows one."""
    return next((delay for behaviour in used if (delay := numerics.delay_of(behaviour, name)) is not None), None)


def _order(
    used: Sequence[Behaviour],
    explanations: Mapping[str, Explanation],
    failures: Sequence[Failure],
    delays: Delays,
) -> Item:
    """Return the item on the order of convergence."""
    orders: dict[str, tuple[float, str, float]] = {}
    for behaviour in used:
        scene = behaviour.probe.scene.name
        found = explanations[scene]
        explained = found.right or (found.fault is not None and found.left <= found.allowed)
        if all(limit.same for limit in behaviour.limits.values()) and not explained:
            sentence = "The files at the two finest steps are the same, and their values not exact: {dt} is not obeyed."
            return failed_item("order", scene, sentence, "step-ignored")
        for name, limit in behaviour.limits.items():
            if not math.isnan(limit.order) and limit.order < orders.get(name, (math.inf, "", 0.0))[0]:
                orders[name] = (limit.order, scene, limit.difference)
    if not orders:
        most = max(limit.difference for behaviour in used for limit in behaviour.limits.values())
        sentence = (
            f"The step changes values by {relative_number(most)} of the largest at most, so that there is no order."
        )
        return passed_item("order", used[0].probe.scene.name, sentence, {"difference": most})
    numbers = {f"order_of_{name}": order for name, (order, _, _) in orders.items()}
    words = "The order is " + ", ".join(f"{order:.2f} in {name}" for name, (order, _, _) in orders.items())
    low = {name: entry for name, entry in orders.items() if entry[0] < numerics.LEAST_ORDER and delays[name] is None}
    if not low:
        late = [name for name in orders if delays[name] is not None]
        rest = f"; the order 1 of {' and '.join(late)} is the item phase" if late else ""
        return passed_item("order", "", f"{words}{rest}.", numbers)
    name, (order, scene, difference) = min(low.items(), key=lambda item: item[1][0])
    differ = f"the two finest steps differ by {relative_number(difference)} of the largest {name}"
    if difference <= 1e3 * LEAST_DIFFERENCE_WITH_ORDER:
        return passed_item("order", scene, f"{words}; {differ}, which round-off makes.", numbers)
    if jump := _jump(used, name, failures):
        sentence = f"{words}, {jump}; {differ}."
        return replace(failed_item("order", scene, sentence, "unknown", numbers), outcome=Outcome.UNDECIDED)
    if order > LEAST_FALL:
        return failed_item("order", scene, f"{words}; {differ}.", "first-order-integrator", numbers)
    sentence = f"Errors do not fall with the time step: {differ}, the two coarsest by no more."
    return failed_item("order", scene, sentence, "unknown", numbers)


def _jump(used: Sequence[Behaviour], name: str, failures: Sequence[Failure]) -> str:
    """Return the words for a force that jumps, which lowers the order of any method; '' if nothing shows one."""
    if jumping := [failure.item for failure in failures if failure.fault.jumps]:
        return f"as where a force jumps, which the fault of the item {jumping[0]} does"
    early = min(numerics.order_while_closing(behaviour, name) for behaviour in used if name in behaviour.limits)
    if early < numerics.LEAST_ORDER:
        return ""
    at = "more" if math.isinf(early) else f"{early:.2f}"
    return f"but {at} until the first contact begins to open: as where a force jumps"


def _phase(used: Sequence[Behaviour], failures: Sequence[Failure], delays: Delays) -> Item:
    """Return the item on the times of velocities and positions."""
    for behaviour in used:
        pace = max((file.pace for file in behaviour.files), key=lambda value: abs(value - 1.0))
        if pace != 1.0:
            sentence = f"The written times are {pace:.6g} times those of the samples of the scene."
            return failed_item("phase", behaviour.probe.scene.name, sentence, "time-scale", {"pace": pace})
        if delay := max((file.delay for file in behaviour.files), key=abs):
            sentence = f"The written times are {delay:.6g} s later than the samples of the scene."
            return failed_item("phase", behaviour.probe.scene.name, sentence, "time-shift", {"delay_s": delay})
    if item := failure_item("phase", failures):
        return item
    scene = used[0].probe.scene.name
    velocity, displacement = delays["velocity"], delays["displacement"]
    numbers = {f"late_steps_of_{name}": delay.steps for name, delay in delays.items() if delay is not None}
    if velocity is None and displacement is None:
        return passed_item("phase", scene, "Velocities and displacements belong to the written times.")
    if velocity is not None and displacement is not None and abs(velocity.steps - displacement.steps) < SAME_DELAY:
        words, cause, steps = "Velocities and displacements", "time-shift", displacement.steps
    elif velocity is not None:
        words, cause, steps = "Velocities", "half-step-velocity", velocity.steps
    else:
        assert displacement is not None  # one of the two is late
        words, cause, steps = "Displacements", "time-shift", displacement.steps
    sentence = (
        f"{words} are those of a time {abs(steps):.2f} dt {'earlier' if steps > 0.0 else 'later'} than is written."
    )
    return failed_item("phase", scene, sentence, cause, numbers)


def _digits(used: Sequence[Behaviour], noise: float) -> Item:
    """Return the item on digits that are computed and written; ``noise`` is that of the momentum."""
    digits = min(numerics.written_digits(behaviour) for behaviour in used)
    numbers = {"digits": digits}
    if all(file.single for behaviour in used for file in behaviour.files):
        sentence = "The code computes in single precision: all values are numbers of 24 bits."
        return failed_item("digits", "", sentence, "single-precision", numbers)
    if digits < LEAST_DIGITS:
        sentence = (
            f"{digits:.1f} digits of the largest values are written, which hide differences of the steps: write 17."
        )
        return failed_item("digits", "", sentence, "few-digits", numbers)
    if noise > 0.0:
        sentence = f"The code computes in single precision: the momentum changes by {noise:.1e}, as by rounding."
        return failed_item("digits", "", sentence, "single-precision", numbers)
    return passed_item("digits", "", f"Values have {digits:.1f} digits of the largest.", numbers)


def _units(behaviours: Sequence[Behaviour], failures: Sequence[Failure]) -> Item:
    """Return the item on units, signs and the order of bodies."""
    for behaviour in behaviours:
        for file in behaviour.files:
            if file.time_unit != 1.0:
                sentence = f"Times are {1.0 / file.time_unit:.4g} times those in s."
                return failed_item("units", behaviour.probe.scene.name, sentence, "units")
    right = "Times and values are in SI units, with the right sign and body."
    return failure_item("units", failures) or passed_item("units", "", right)


def _largest_step(steps: Sequence[LargeStep]) -> Item:
    """Return the item on the largest steps, from runs from fine to coarse."""
    if not steps:
        return not_run_item("largest-step", "the first scene has no files with velocities")
    numbers = {"stable": _largest(steps, math.inf)}
    for accuracy in ACCURACIES:
        numbers[f"error_{accuracy:g}"] = _largest(steps, accuracy)
    parts = [f"stable up to {_share(numbers['stable'], steps)}"]
    parts += [f"error {accuracy:g} up to {_share(numbers[f'error_{accuracy:g}'], steps)}" for accuracy in ACCURACIES]
    sentence = f"Of the contact time: {', '.join(parts)}."
    if numbers["stable"] * STEPS_IN_CONTACT_OF_STABLE_METHOD >= 1.0:
        return passed_item("largest-step", "pair", sentence, numbers)
    return failed_item("largest-step", "pair", sentence, "unstable", numbers)


def _largest(steps: Sequence[LargeStep], accuracy: float) -> float:
    """Return the largest step, as a share, up to which all steps are stable and have at most this error; nan: none."""
    last = math.nan
    for step in steps:
        if not step.stable or step.error > accuracy:
            break
        last = step.share
    return last


def _share(value: float, steps: Sequence[LargeStep]) -> str:
    """Return a share in words."""
    if math.isnan(value):
        return f"none of 1/{1.0 / steps[0].share:.0f} and larger"
    return f"1/{1.0 / value:.0f}" + " (the largest tried)" * (value == steps[-1].share)
