"""Faults of a code that shares nothing with the package are named in the item that asks for them."""

from __future__ import annotations

import pytest

from tests.judging.conformance.faulty_code import FAULTS
from tests.judging.conformance.measure_faults import NO, failed_items

#: fault -> features of the few scenes on which it is looked for at every commit
QUICK = {
    "exponent-1.4": "hertz",
    "no-reaction": "hertz",
    "background-drag": "hertz",
    "contact-loss": "hertz",
    "rounded-times": "hertz",
    "pull-off": "hertz",
    "step-bounded-below": "hertz,hooke",
    "half-step-velocity": "hertz",
    "tsuji-without-sqrt2": "hertz,tsuji",
}


def _failed(found: dict[str, str]) -> set[str]:
    """Return the names of the items that failed."""
    return {item.split(" ")[0] for item, words in found.items() if words.startswith(NO)}


@pytest.mark.parametrize("fault", QUICK)
def test_a_fault_fails_its_item_and_no_other(fault: str) -> None:
    assert _failed(failed_items(fault, QUICK[fault])) == {FAULTS[fault][0]}


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_fails_its_item_and_no_other_among_all_scenes(fault: str) -> None:
    found = failed_items(fault)
    assert _failed(found) == {FAULTS[fault][0]}, found


@pytest.mark.slow
def test_a_right_code_fails_nowhere() -> None:
    assert failed_items("") == {}
