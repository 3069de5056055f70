"""Atom types: every contact finds its law by its pair; about sqrt(2 N) types where laws differ, D where D repeat."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.lmp.pair_coefficients import body_types, euler_types, latin_types


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


def test_the_circuit_is_the_one_of_the_committed_decks() -> None:
    # partners are tried in ascending order: any other order is a circuit, too, but changes every deck byte for byte
    assert euler_types(15).tolist() == [1, 1, 2, 2, 3, 1, 4, 2, 5, 3, 3, 4, 4, 5, 5, 1]


def test_ten_thousand_contacts_need_141_types() -> None:
    assert max(euler_types(10_000)) == 141


def test_a_negative_number_of_contacts_is_refused() -> None:
    with pytest.raises(ValueError, match="contacts = -1"):
        euler_types(-1)


# laws that repeat


def _laws_by_pair(types: list[int], laws: list[int]) -> dict[tuple[int, int], set[int]]:
    """Unordered pair of types -> the laws of the contacts where it stands."""
    found: dict[tuple[int, int], set[int]] = {}
    for pair, law in zip(pairwise(types), laws, strict=True):
        found.setdefault((min(pair), max(pair)), set()).add(law)
    return found


laws_in_a_row = st.integers(1, 12).flatmap(lambda d: st.lists(st.integers(0, d - 1), max_size=200))


@given(laws=laws_in_a_row)
def test_equal_pairs_of_types_are_at_equal_laws_only(laws: list[int]) -> None:
    distinct = max(laws, default=-1) + 1
    types = latin_types(np.array(laws, dtype=np.int64), distinct).tolist()
    assert len(types) == len(laws) + 1
    assert all(1 <= one <= max(distinct, 1) for one in types)
    assert all(len(found) == 1 for found in _laws_by_pair(types, laws).values())


@given(laws=laws_in_a_row, how=st.sampled_from(["euler", "per-body"]))
def test_whichever_way_is_taken_a_pair_of_types_has_one_law(laws: list[int], how: str) -> None:
    types = body_types(np.array(laws, dtype=np.int64), how).tolist()
    assert len(types) == len(laws) + 1
    assert min(types) >= 1
    assert all(len(found) == 1 for found in _laws_by_pair(types, laws).values())
    if how == "per-body":
        assert len(set(types)) == len(types)
    else:
        # never more than by either way alone
        odd = next(t for t in range(1, 99, 2) if t * (t + 1) // 2 >= len(laws))
        assert max(types) <= min(max(laws, default=0) + 1, odd)


def test_a_million_bodies_with_two_laws_need_two_types() -> None:
    # two stiffnesses, in an order that repeats nothing
    laws = np.random.default_rng(4).integers(0, 2, 999_999)
    types = body_types(laws, "euler")
    assert len(types) == 1_000_000
    assert np.unique(types).tolist() == [1, 2]
    # the pair says the law: equal types, or unequal ones
    unequal = types[:-1] != types[1:]
    one = laws[unequal]
    assert np.all(one == one[0])
    assert np.all(laws[~unequal] != one[0])
