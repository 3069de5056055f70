"""Atom types such that every contact finds its own law by the types of its two bodies, with as few types as can be.

LAMMPS holds one model per pair of types and its memory grows with their square: one type per body costs 4.7 GB at
10,000 bodies. But only *neighbouring* bodies meet, and laws repeat where stiffnesses do.

* All laws differ: an Eulerian circuit of the complete graph with loops on T types (T odd) walks through all T(T+1)/2
  unordered pairs once each; bodies that take the types along the circuit have a different pair at each contact, so
  N contacts need about sqrt(2N) types (Hierholzer 1873).
* D laws, again and again: with D types, law ``(a + b) mod D`` for the pair (a, b), whatever the law wanted next there
  is one type that gives it (a symmetric Latin square).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Types = NDArray[np.int64]


def body_types(laws: NDArray[np.integer], how: str) -> Types:
    """Types 1..T of ``len(laws) + 1`` bodies in a row; equal pairs of types are at equal ``laws`` (0..D-1) only.

    ``how``: "euler", the fewest of the two ways above, or "per-body", one each.

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
    """Types 1..``distinct`` such that the pair (a, b), counted from 0, stands for law ``(a + b) mod distinct``."""
    # t_k = s_k - t_(k-1): an alternating sum
    sign = np.where(np.arange(len(laws) + 1) % 2 == 0, 1, -1)
    steps = np.concatenate([[0], np.asarray(laws, dtype=np.int64)])
    return np.asarray(sign * np.cumsum(sign * steps) % max(distinct, 1) + 1)


def _types_needed(contacts: int) -> int:
    types = math.isqrt(2 * contacts)
    while types % 2 == 0 or types * (types + 1) // 2 < contacts:
        types += 1
    return types


def euler_types(contacts: int) -> Types:
    """Types 1..T of ``contacts + 1`` bodies in a row; no unordered pair of neighbours occurs twice.

    >>> euler_types(5).tolist()
    [1, 1, 2, 2, 3, 3]
    """
    if contacts < 0:
        raise ValueError(f"contacts = {contacts}; allowed: >= 0")
    types = _types_needed(contacts)
    # Hierholzer: `upto[a]` runs over the partners of a; a pair is used up from whichever end sees it first
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
