"""Atom types: every contact has a pair of its own, with about sqrt(2 N) types."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.lmp.encoding import euler_types


@given(contacts=st.integers(0, 3000))
def test_every_contact_has_its_own_unordered_pair_of_types(contacts: int) -> None:
    types = euler_types(contacts)
    assert len(types) == contacts + 1
    pairs = {(min(pair), max(pair)) for pair in pairwise(types)}
    assert len(pairs) == contacts


@pytest.mark.parametrize("contacts", range(60))
def test_short_chains_all_work_one_by_one(contacts: int) -> None:
    types = euler_types(contacts)
    assert len({frozenset(pair) for pair in pairwise(types)}) == contacts


@given(contacts=st.integers(1, 3000))
def test_types_are_the_least_odd_number_that_has_enough_pairs(contacts: int) -> None:
    types = max(euler_types(contacts))
    assert types * (types + 1) // 2 >= contacts
    # the odd number below has too few pairs (fewer types than that may be in use: the walk is cut short)
    assert (types - 2) * (types - 1) // 2 < contacts
    assert types <= math.isqrt(2 * contacts) + 2


@given(contacts=st.integers(0, 500))
def test_types_are_numbered_from_1_without_holes(contacts: int) -> None:
    types = euler_types(contacts)
    assert set(types) == set(range(1, max(types) + 1))


def test_the_papers_40_contacts_need_9_types() -> None:
    assert max(euler_types(40)) == 9


def test_the_same_length_gives_the_same_types() -> None:
    assert euler_types(123) == euler_types(123)


def test_ten_thousand_contacts_need_141_types() -> None:
    assert max(euler_types(10_000)) == 141


def test_a_negative_number_of_contacts_is_refused() -> None:
    with pytest.raises(ValueError, match="contacts = -1"):
        euler_types(-1)
