"""Atom types that determine the law of each contact by the types of its two bodies, with as few types as possible.

LAMMPS stores one model per pair of types, and its memory grows with their square: one type per body takes 4.7 GB at
10,000 bodies. But only *neighbouring* bodies meet, and a law can be shared by contacts of equal stiffness.

* All laws differ: an Eulerian circuit of the complete graph with loops on T types (T odd) visits all T(T+1)/2 unordered
  pairs once. Bodies that take the types along the circuit have a different pair at each contact, so N contacts need
  about sqrt(2N) types (Hierholzer 1873).
* D laws recur: with D types and law ``(a + b) mod D`` for the pair (a, b), one type gives the required law at each next
  contact (a symmetric Latin square).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Types = NDArray[np.int64]


def body_types(laws: NDArray[np.integer], how: str) -> Types:
    """Return types 1..T of ``len(laws) + 1`` bodies in a row, such that equal pairs of types have equal laws.

    Parameters
    ----------
    laws : ndarray of int
        Law of each contact, 0..D-1.
    how : {"euler", "per-body"}
        "euler" uses the better of the two ways above, "per-body" one type for each body.

    Examples
    --------
    >>> body_types(np.array([0, 1, 1, 0, 1]), "euler").tolist()
    [1, 1, 2, 1, 1, 2]
    >>> [int(max(body_types(np.arange(n), "euler"))) for n in (1, 40, 10_000)]
    [1, 9, 141]
    """
    contacts = len(laws)
    if how == "per-body":
        return np.arange(1, contacts + 2)
    distinct = int(np.max(laws, initial=-1)) + 1
    return latin_types(laws, distinct) if distinct < _types_needed(contacts) else euler_types(contacts)


def latin_types(laws: NDArray[np.integer], distinct: int) -> Types:
    """Return types 1..``distinct`` such that the pair (a, b), counted from 0, has the law ``(a + b) mod distinct``."""
    # t_k = s_k - t_(k-1): an alternating sum
    sign = np.where(np.arange(len(laws) + 1) % 2 == 0, 1, -1)
    steps = np.concatenate([[0], np.asarray(laws, dtype=np.int64)])
    return np.asarray(sign * np.cumsum(sign * steps) % max(distinct, 1) + 1)


def _types_needed(contacts: int) -> int:
    """Return the smallest odd number of types with enough pairs."""
    types = math.isqrt(2 * contacts)
    while types % 2 == 0 or types * (types + 1) // 2 < contacts:
        types += 1
    return types


def euler_types(contacts: int) -> Types:
    """Return types 1..T of ``contacts + 1`` bodies in a row, such that no unordered pair of neighbours occurs twice.

    Examples
    --------
    >>> euler_types(5).tolist()
    [1, 1, 2, 2, 3, 3]
    """
    if contacts < 0:
        raise ValueError(f"contacts = {contacts}; allowed: >= 0")
    types = _types_needed(contacts)
    # Hierholzer: `upto[a]` runs over the partners of a; each pair is used once, from either end
    used = bytearray(types * types)
    upto = [0] * types
    stack, circuit = [0], []
    while stack:
        here = stack[-1]
        while upto[here] < types and used[here * types + upto[here]]:
            upto[here] += 1
        if upto[here] == types:
            circuit.append(stack.pop() + 1)
            continue
        other = upto[here]
        used[here * types + other] = used[other * types + here] = 1
        stack.append(other)
    circuit.reverse()
    return np.array(circuit[: contacts + 1], dtype=np.int64)
