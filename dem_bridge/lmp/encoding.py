"""Atom types such that every contact has a pair of types of its own, with as few types as can be.

LAMMPS holds one model per pair of types and its memory grows with their square: one type per body costs 4.7 GB at
10,000 bodies. But only *neighbouring* bodies meet. An Eulerian circuit of the complete graph with loops on T
types (T odd) walks through all T(T+1)/2 unordered pairs once each; bodies that take the types along the circuit have
a different pair at each contact, so N contacts need about sqrt(2N) types (Hierholzer 1873).
"""

from __future__ import annotations

import math


def euler_types(contacts: int) -> tuple[int, ...]:
    """Types 1..T of ``contacts + 1`` bodies in a row; no unordered pair of neighbours occurs twice.

    >>> euler_types(5)
    (1, 1, 2, 2, 3, 3)
    >>> [max(euler_types(n)) for n in (1, 40, 10_000)]
    [1, 9, 141]
    """
    if contacts < 0:
        raise ValueError(f"contacts = {contacts}; allowed: >= 0")
    types = math.isqrt(2 * contacts)
    while types % 2 == 0 or types * (types + 1) // 2 < contacts:
        types += 1
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
    return tuple(circuit[: contacts + 1])
