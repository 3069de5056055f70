"""The item on scenes that were drawn from a seed: a code that is right on the frozen ones alone fails it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from dem_bridge.foundation.wording import relative_number
from dem_bridge.judging.conformance.behaviour import LARGEST_UNCERTAINTY, Behaviour
from dem_bridge.judging.conformance.explain import Explanation, Failure
from dem_bridge.judging.conformance.items import Item, failed_item
from dem_bridge.judging.conformance.sequence import apart_words
from dem_bridge.observables.verdict import Outcome


def unseen_item(
    names: Sequence[str],
    behaviours: Mapping[str, Behaviour],
    problems: Mapping[str, str],
    explanations: Mapping[str, Explanation],
    failures: Sequence[Failure],
    wrong_frozen: str,
) -> Item:
    """Return the item on the unseen scenes of these names.

    ``wrong_frozen`` is an item on frozen scenes that fails and may explain a difference; '' if there is none.
    """
    item = Item(name="unseen", scene="", outcome=Outcome.NOT_RUN, sentence="No unseen scenes were asked for.")
    if not names:
        return item
    if broken := [name for name in names if name in problems]:
        sentence = f"{len(broken)} of {len(names)} scenes have no files; {broken[0]}: {problems[broken[0]]}"
        return replace(item, scene=broken[0], outcome=Outcome.BROKEN, sentence=sentence)
    seen = [name for name in names if name in explanations]
    if not seen:
        return replace(item, sentence="Not run: scenes before them did not end.")
    clear = [name for name in seen if behaviours[name].uncertainty <= LARGEST_UNCERTAINTY]
    wrong = [name for name in clear if not explanations[name].right]
    item = replace(item, numbers={"scenes": float(len(seen)), "wrong": float(len(wrong))})
    if not wrong:
        return _right(item, [explanations[name] for name in clear], len(seen))
    item = replace(item, scene=wrong[0], cause="unknown")
    head = f"{len(wrong)} of {len(seen)} scenes are wrong"
    new = [failure for failure in failures if failure.scene in wrong]
    if wrong_frozen:
        sentence = f"{head}; the fault of the item {wrong_frozen} may explain it."
        return replace(item, outcome=Outcome.UNDECIDED, sentence=sentence)
    if new and new[0].item != "unseen":
        sentence = f"{head}; the fault of the item {new[0].item} explains it."
        return replace(item, outcome=Outcome.PASS, sentence=sentence, cause="none")
    head += ", although the frozen ones are right"
    if new:
        sentence = f"{head}; {new[0].scene}: {new[0].fault.sentence}"
        return failed_item("unseen", new[0].scene, sentence, new[0].fault.cause, item.numbers)
    found = explanations[wrong[0]]
    off, allowed = relative_number(found.difference), relative_number(found.allowed)
    sentence = f"{head}; {wrong[0]} differs by {off} of the largest value, steps explain {allowed}."
    return replace(item, outcome=Outcome.FAIL, sentence=sentence)


def _right(item: Item, found: Sequence[Explanation], count: int) -> Item:
    """Return the item of scenes that are right, as far as they can be told."""
    vague = count - len(found)
    apart = apart_words(list(dict.fromkeys(name for explanation in found for name in explanation.apart)))
    words = f"; {vague} more cannot be told" if vague else ""
    most = relative_number(max((explanation.difference for explanation in found), default=0.0))
    sentence = f"{len(found)} of {count} scenes are right{apart}, within {most} of the largest value{words}."
    return replace(item, outcome=Outcome.UNDECIDED if vague else Outcome.PASS, sentence=sentence)
