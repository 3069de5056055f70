"""The lines of a judgement: what is right or wrong, what to write or mend, and then the evidence."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterator, Mapping

from dem_bridge.foundation.notebook import quantity as amount
from dem_bridge.foundation.wording import share
from dem_bridge.judging.diagnosis import RIGHT
from dem_bridge.judging.hypotheses import WALLS
from dem_bridge.judging.judgement import EXPLAINED, Judgement
from dem_bridge.judging.reference import FileErrors, QuantityErrors
from dem_bridge.observables.largest_step import ACCURACIES, accuracy_key, with_sources
from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.texts import Texts

TEXTS = Texts("judge", "dem_bridge.judging")
#: largest distance of an observed order from a whole number that counts as this order, beside its uncertainty
LARGEST_DISTANCE_FROM_WHOLE_ORDER = 0.15
#: width of a line, of the names before the texts, and the most lines of a short answer
COLUMNS, COLUMNS_OF_NAMES, MOST_LINES = 80, 14, 15
#: alternatives of a short answer, and the names that it leaves out first
MOST_ALTERNATIVES = 2
LESS_NEEDED = ("floor", "unseen", "cause", "divergence", "displacement", "contact force")
#: error, relative to the largest value, for which a step is told in the first lines
ACCURACY_ADVISED = 1e-3
#: part of an error from which its uncertainty is shown
LEAST_SHOWN_UNCERTAINTY = 0.02
#: where the evidence goes over from what is claimed to what is left of the difference
_LEAVES = re.compile(r"(?<=\.) (?=With (?:this fault|it|both faults) in the reference )")


def text_of(judgement: Judgement, *, every: bool = False) -> str:
    """Return a judgement as lines of 80 characters, the answer first; the most needed 15 of them, or ``every`` line."""
    blocks = {name: _block(name, text) for name, text in lines(judgement, every=every)}
    if not every:
        for name in LESS_NEEDED:
            if sum(map(len, blocks.values())) > MOST_LINES:
                blocks.pop(name, None)
    return "\n".join(line for block in blocks.values() for line in block)


def _block(name: str, text: str) -> list[str]:
    """Return a name and its text in lines whose words are whole."""
    wrapped = textwrap.wrap(text, COLUMNS - COLUMNS_OF_NAMES, break_long_words=False, break_on_hyphens=False) or [""]
    return [
        f"{head:{COLUMNS_OF_NAMES}}{line}"
        for head, line in zip([name, *[""] * (len(wrapped) - 1)], wrapped, strict=True)
    ]


def lines(judgement: Judgement, *, every: bool = True) -> Iterator[tuple[str, str]]:
    """Yield the lines of a judgement as pairs of name and text, in the order in which they are needed."""
    yield "outcome", _outcome(judgement)
    yield "next", " ".join(_advice(judgement))
    if judgement.alternatives:
        yield "alternatives", _alternatives(judgement, every)
    if judgement.step["dt"] is not None or judgement.step_curve is not None:
        yield "step", _step(judgement)
    for name, (file, part) in judgement.worst.items():
        text = _error_text(file, part)
        if len(judgement.judged) > 1:
            text = TEXTS("in_file", errors=text, name=file_name(file))
        yield f"{name.replace('_', ' ')}", text
    if judgement.first_divergence is not None and judgement.cause != "none":
        yield "divergence", _divergence(judgement)
    if len(judgement.files) > 1:
        yield "order", _order_text(judgement)
    if evidence := _evidence(judgement):
        yield "cause", evidence
    if judgement.needed and not judgement.alternatives:
        yield "unseen", judgement.needed
    yield "floor", _floor(judgement)
    yield from judgement.addition.lines


def notes_of(judgement: Judgement) -> list[str]:
    """Return what was assumed in reading and judging, one sentence for all files that share it."""
    by_text: dict[str, list[str]] = {}
    for file in judgement.files:
        for text in file.record.recognised:
            by_text.setdefault(text, []).append(file.record.name)
    several = len(judgement.files) > 1
    shared = [
        f"{text} ({'all files' if len(names) == len(judgement.files) else ', '.join(names)})" if several else text
        for text, names in by_text.items()
    ]
    return [*shared, *judgement.assumed]


def file_name(file: FileErrors) -> str:
    """Return the name of a file with its time step."""
    return file.record.name + (f" (dt = {amount(file.record.dt, 's')})" if file.record.dt is not None else "")


def two_digits(value: float) -> str:
    """Return a number with two digits, as a power of ten unless it is of ordinary size.

    >>> two_digits(3.4e-5), two_digits(0.1089), two_digits(88.2)
    ('3.4e-05', '0.11', '88')
    """
    return f"{value:.2g}" if 1e-3 <= value < 99.5 else f"{value:.1e}"


def _error_text(file: FileErrors, part: QuantityErrors) -> str:
    """Return the largest error of a quantity, where it is, and its uncertainty if that is felt."""
    uncertain = part.scale == 0.0 or part.uncertainty > LEAST_SHOWN_UNCERTAINTY * part.value
    numbers = {
        "error": f"{two_digits(part.value)} {part.unit}",
        "uncertainty": f" +- {part.uncertainty:.0e} {part.unit}" if uncertain else "",
    }
    if part.scale == 0.0:
        return TEXTS("error_without_scale", **numbers)
    time = amount(float(file.record.time[part.worst[0]]), "s", 4)
    scale = f"{part.scale:.3g} {part.unit}"
    return TEXTS(
        "error", **numbers, relative=share(part.relative(part.value)), scale=scale, place=part.place, time=time
    )


def _outcome(judgement: Judgement) -> str:
    """Return the outcome and the reason for it."""
    if judgement.tolerance is None:
        if judgement.cause == "none":
            return _right(judgement)
        if judgement.cause == "unknown":
            headline = judgement.diagnosis.headline
            return TEXTS("unseen") if not judgement.seen else TEXTS("part" if headline else "open", part=headline)
        return f"FAIL: {_named(judgement)}"
    if judgement.outcome == Outcome.PASS:
        return TEXTS("passes", tolerance=share(judgement.tolerance))
    deciding = {
        name: judgement.worst[name][1]
        for name, outcome in judgement.outcomes.items()
        if outcome.value == judgement.outcome
    }
    name, part = max(deciding.items(), key=lambda item: item[1].relative(item[1].value))
    values = {"quantity": name.replace("_", " "), "tolerance": share(judgement.tolerance)}
    if judgement.outcome == Outcome.FAIL:
        cause = f" Cause: {_named(judgement)}" if judgement.faults else ""
        return TEXTS("fails", **values, relative=share(part.relative(part.value))) + cause
    return TEXTS("straddles", **values, uncertainty=share(part.relative(part.uncertainty)))


def _right(judgement: Judgement) -> str:
    """Return the answer to a right file, with the error of its step and the step for errors of 1e-3."""
    dt, error, largest = (judgement.step[key] for key in ("dt", "error", "largest_for"))
    if dt is None or error is None:
        return TEXTS("explained")
    step = largest[accuracy_key(ACCURACY_ADVISED)]
    words = "right_finer" if error > ACCURACY_ADVISED and step is not None else "right"
    numbers = {
        "error": share(error),
        "enough": share(ACCURACY_ADVISED),
        "step": "" if step is None else amount(step, "s", 2),
    }
    return TEXTS(words, dt=amount(dt, "s"), **numbers)


def _named(judgement: Judgement) -> str:
    """Return the cause, or both of them, with what is claimed of them."""
    claim = _LEAVES.split(judgement.evidence)[0]
    names = " and ".join(dict.fromkeys(fault["cause"] for fault in judgement.faults))
    where = f" of {judgement.where}" if judgement.where and judgement.where not in claim.lower() else ""
    return f"{names}{where}. {claim}"


def _evidence(judgement: Judgement) -> str:
    """Return the cause with its evidence, without what the outcome has said."""
    parts = _LEAVES.split(judgement.evidence)
    if judgement.faults and judgement.outcome == Outcome.FAIL:
        return " ".join(parts[1:])
    if judgement.cause == "none":
        return "" if judgement.evidence in (RIGHT, EXPLAINED.evidence) else judgement.evidence
    where = f" ({judgement.where})" if judgement.where else ""
    return f"{judgement.cause}{where}. {judgement.evidence}"


def _alternatives(judgement: Judgement, every: bool) -> str:
    """Return what explains the files as well, and which files would tell."""
    sentences = judgement.alternatives
    shown = sentences if every else sentences[: MOST_ALTERNATIVES - (len(judgement.faults) > 1)]
    rest = [TEXTS("more", count=len(sentences) - len(shown))] if len(shown) < len(sentences) else []
    needed = [f". {judgement.needed}"] if judgement.needed else []
    return "; ".join([*shown, *rest]) + "".join(needed)


def _step(judgement: Judgement) -> str:
    """Return the error that the time step makes, and the largest steps for some accuracies."""
    dt, error = (judgement.step[key] for key in ("dt", "error"))
    curve = judgement.step_curve
    served = [(share(a), step) for a in ACCURACIES if curve is not None and (step := curve.largest_step(a)) is not None]
    steps = [(TEXTS("largest", step=_seconds(step.dt), accuracy=words), step) for words, step in served]
    name = next(iter(judgement.worst)).replace("_", " ")
    texts = []
    if dt is not None:
        found = "" if judgement.step_curve is None or judgement.step_curve.stated else TEXTS("found_step")
        words = "step_unresolved" if error is None else "step"
        relative = "" if error is None else share(error)
        texts.append(TEXTS(words, dt=amount(dt, "s"), found=found, relative=relative, quantity=name))
    if steps:
        texts.append(TEXTS("steps", steps=with_sources(steps, _seconds)))
    return "; ".join(texts)


def _seconds(step: float) -> str:
    """Return a step with two digits and its unit."""
    return amount(step, "s", 2)


def _divergence(judgement: Judgement) -> str:
    """Return the sentence on the first divergence, and on what explains the errors before it."""
    first, key = judgement.first_divergence or {}, "divergence" if judgement.by_step is None else "divergence_by_step"
    place = f"contact {first['contact']}" if "contact" in first else f"body {first['body']}"
    words = str(first["quantity"]).replace("_", " ")
    return TEXTS(key, quantity=words, place=place, time=amount(float(str(first["time"])), "s", 4))


def _order_text(judgement: Judgement) -> str:
    """Return the observed orders and what they mean."""
    orders = [(part.quantity, part.order) for part in judgement.convergence if part.order is not None]
    if not orders:
        return TEXTS("no_order")
    text = ", ".join(
        f"{name.replace('_', ' ')} {order.value:.2f} +- {max(order.uncertainty, 0.005):.2g}" for name, order in orders
    )
    steps = [step for _, order in orders for step in order.steps]
    ends = {"coarse": amount(max(steps), "s"), "fine": amount(min(steps), "s")}
    return f"{TEXTS('orders', orders=text, **ends)}. {TEXTS(_meaning(judgement.order))}"


def _meaning(orders: Mapping[str, Mapping[str, float]]) -> str:
    """Return the key of the sentence on what the observed orders mean."""

    def near(name: str, value: float) -> bool:
        order = orders.get(name)
        return order is not None and abs(order["value"] - value) <= max(
            LARGEST_DISTANCE_FROM_WHOLE_ORDER, order["uncertainty"]
        )

    if near("velocity", 1.0) and near("displacement", 2.0):
        return "half_step"
    values = [(name, order["value"]) for name, order in orders.items()]
    for value, key in ((0.0, "constant"), (1.0, "first"), (2.0, "second")):
        if all(near(name, value) for name, _ in values):
            return key
    if all(value > 2.0 for _, value in values):
        return "high"
    return "growing" if all(value < 0.0 for _, value in values) else "other"


def _floor(judgement: Judgement) -> str:
    """Return the sentence on the floor."""
    name, (_, part) = next(iter(judgement.worst.items()))
    floor = math.nan if judgement.floor is None else judgement.floor
    flat = floor > part.relative(part.floor)
    return TEXTS("flat" if flat else "floor", floor=share(floor), quantity=name.replace("_", " "))


def _advice(judgement: Judgement) -> Iterator[str]:
    """Yield what to do next."""
    if judgement.cause == "unknown" and not judgement.seen:
        yield TEXTS("see_more")
        return
    tolerance, fails = judgement.tolerance, judgement.outcome == Outcome.FAIL
    if judgement.cause != "none":
        yield TEXTS(_advised(judgement), "advice")
    elif fails:
        yield TEXTS("reduce")
    elif tolerance is not None or judgement.step["error"] is None or judgement.step["error"] <= ACCURACY_ADVISED:
        yield TEXTS("none", "advice")
    if judgement.cause == "none" and not fails and tolerance is None:
        yield from _step_advice(judgement)
    for fault in judgement.diagnosis.faults:
        if fault.cause != judgement.cause:
            yield TEXTS(fault.cause, "advice")
    if tolerance is not None and fails and not math.isnan(step := _step_for(judgement, tolerance)):
        step = min(step, next(iter(judgement.worst.values()))[0].record.dt or step)
        yield TEXTS("step_for_tolerance" if judgement.order else "step_by_method", dt=amount(step, "s", 2))
    if len(judgement.files) == 1 and judgement.cause == "unknown":
        yield TEXTS("more_files")


def _advised(judgement: Judgement) -> str:
    """Return the key of the advice on the cause: a wall that never acts may be missing."""
    missed = judgement.cause == "missed-contact" and judgement.where in WALLS
    return "missed-wall" if missed else judgement.cause


def _step_advice(judgement: Judgement) -> Iterator[str]:
    """Yield the step that is enough for errors of 1e-3, or that would be."""
    dt, error, largest = (judgement.step[key] for key in ("dt", "error", "largest_for"))
    step = largest[accuracy_key(ACCURACY_ADVISED)]
    if dt is not None and error is not None and step is not None:
        words = "enough" if error <= ACCURACY_ADVISED else "finer"
        yield TEXTS(words, dt=amount(step, "s", 2), error=share(ACCURACY_ADVISED))


def _step_for(judgement: Judgement, error: float) -> float:
    """Return the largest time step for errors relative to the scale, s, by the observed orders or by the method."""
    steps = []
    for name, (file, part) in judgement.worst.items():
        order = judgement.order.get(name, {}).get("value", 0.0)
        if file.record.dt is not None and order > 0.5 and part.value > 0.0:
            steps.append(file.record.dt * (error / part.relative(part.value)) ** (1.0 / order))
    if not steps and judgement.cause == "none" and judgement.diagnosis.step is not None:
        return judgement.diagnosis.step.largest_for(error)
    return min(steps, default=math.nan)
