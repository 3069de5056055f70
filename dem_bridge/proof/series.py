"""Taylor series of a chain in balls: one expansion about an exact time, compiled.

The coefficients belong to a start in the present balls: for every start in them the true coefficients are in the balls
of the series. With time in units of ``2^e`` s the recurrences are, for closed contacts with overlap s, w = sqrt(s),
and force ``F = beta s^(n-1) = beta w^m``, m = 2 (n - 1) a whole number::

    v' = 2^e a    x' = 2^e v    s = x_left - x_right - gap    w w = s    w^(q+2) = s w^q    m_i a_i = sum of forces

Contacts that do not count as closed have no force here; :mod:`.bounds` encloses what they do.
"""

from __future__ import annotations

from typing import NamedTuple

from dem_bridge.foundation.compiled import Bools, Floats, Ints, kernel
from dem_bridge.proof.balls import (
    SIZE,
    add,
    copy,
    div,
    divide_by,
    dot,
    double,
    lower,
    magnitude,
    mul,
    negate,
    radius,
    root,
    scale,
    sub,
    upper,
    zero,
)  # fmt: skip


class Chain(NamedTuple):
    """A chain for kernels: doubles for bounds, and the addresses of balls of the same numbers.

    Body ``n_body`` is the wall, at rest. Bounds of stiffness and inverse mass are rounded upwards.
    """

    left: Ints
    right: Ints
    doubled: Ints
    """Twice the exponent of the force, m."""
    stiffness: Floats
    mobility: Floats
    """Upper bounds of 1/mass, 0 for the wall, ``(n_body + 1,)``."""
    stiffness_balls: int
    gap_balls: int
    mobility_balls: int
    acceleration_balls: int
    """Constant acceleration of each body."""


class Space(NamedTuple):
    """Addresses of the coefficients of a step, each quantity with ``stride`` balls a body or contact."""

    stride: int
    levels: int
    """Room for the powers of w of a contact, beside w itself."""
    v: int
    x: int
    s: int
    w: int
    powers: int
    spare: int
    """Balls for intermediate results: accelerations of all bodies, then eight."""


@kernel()
def power_of(chain: Chain, space: Space, k: int, level: int) -> int:
    """Return the address of the series of a power of w: level 0 is w or s, each further one is s times it."""
    if level == 0:
        return (space.w if chain.doubled[k] % 2 == 1 else space.s) + SIZE * space.stride * k
    return space.powers + SIZE * space.stride * (space.levels * k + level - 1)


@kernel()
def last_level(doubled: int) -> int:
    """Return the level of the power w^m of the force."""
    return (doubled - 1) // 2


@kernel()
def set_overlaps(chain: Chain, space: Space, o: int, precision: int) -> None:
    """Set the coefficients of order ``o`` of all overlaps to the differences of those of the bodies."""
    n, row = len(chain.mobility) - 1, SIZE * space.stride
    for k in range(len(chain.left)):
        s, left, right = space.s + row * k + SIZE * o, chain.left[k], chain.right[k]
        if left == n:
            copy(s, space.x + row * right + SIZE * o, precision)
            negate(s, s)
        elif right == n:
            copy(s, space.x + row * left + SIZE * o, precision)
        else:
            sub(s, space.x + row * left + SIZE * o, space.x + row * right + SIZE * o, precision)
        if o == 0:
            sub(s, s, chain.gap_balls + SIZE * k, precision)


@kernel()
def _extend_root(s: int, w: int, o: int, spare: int, precision: int) -> None:
    """Set the coefficient of order ``o`` of w = sqrt(s)."""
    target = w + SIZE * o
    if o == 0:
        root(target, s, precision)
        return
    half = (o - 1) // 2
    dot(spare, 0, 0, w + SIZE, 1, w + SIZE * (o - 1), -1, half, precision)
    scale(spare, spare, 1)
    if o % 2 == 0:
        mul(target, w + SIZE * (o // 2), w + SIZE * (o // 2), precision)
        add(spare, spare, target, precision)
    sub(spare, s + SIZE * o, spare, precision)
    scale(spare, spare, -1)
    div(target, spare, w, precision)


@kernel()
def _extend_force(force: int, chain: Chain, space: Space, k: int, o: int, precision: int) -> None:
    """Set the coefficient of order ``o`` of the powers of w of a closed contact, and ``force`` to that of its force."""
    row, m = SIZE * space.stride, chain.doubled[k]
    if m % 2 == 1:
        _extend_root(space.s + row * k, space.w + row * k, o, force, precision)
    for level in range(1, last_level(m) + 1):
        lower_power = power_of(chain, space, k, level - 1) + SIZE * o
        power = power_of(chain, space, k, level) + SIZE * o
        dot(power, 0, 0, space.s + row * k, 1, lower_power, -1, o + 1, precision)
    mul(force, power_of(chain, space, k, last_level(m)) + SIZE * o, chain.stiffness_balls + SIZE * k, precision)


@kernel()
def expand(chain: Chain, space: Space, closed: Bools, moved: Bools, order: int, exponent: int, precision: int) -> None:
    """Make all series up to ``order`` from the coefficients of order 0 of displacements and velocities.

    ``moved``: bodies at a closed contact; all others fly with their constant acceleration.
    """
    n, row = len(chain.mobility) - 1, SIZE * space.stride
    force, part = space.spare + SIZE * n, space.spare + SIZE * (n + 1)
    set_overlaps(chain, space, 0, precision)
    for o in range(order):
        for i in range(n):
            if o == 0:
                copy(space.spare + SIZE * i, chain.acceleration_balls + SIZE * i, precision)
            else:
                zero(space.spare + SIZE * i)
        for k in range(len(chain.left)):
            if not closed[k]:
                continue
            _extend_force(force, chain, space, k, o, precision)
            left, right = chain.left[k], chain.right[k]
            if left != n:
                mul(part, force, chain.mobility_balls + SIZE * left, precision)
                sub(space.spare + SIZE * left, space.spare + SIZE * left, part, precision)
            if right != n:
                mul(part, force, chain.mobility_balls + SIZE * right, precision)
                add(space.spare + SIZE * right, space.spare + SIZE * right, part, precision)
        for i in range(n):
            v, x = space.v + row * i + SIZE * (o + 1), space.x + row * i + SIZE * (o + 1)
            if moved[i] or o < 2:
                scale(v, space.spare + SIZE * i, exponent)
                divide_by(v, v, o + 1, precision)
                scale(x, v - SIZE, exponent)
                divide_by(x, x, o + 1, precision)
            else:
                zero(v)
                zero(x)
        set_overlaps(chain, space, o + 1, precision)


@kernel()
def evaluate(target: int, series: int, powers: int, order: int, precision: int) -> None:
    """Set ``target`` to a series whose variable has the ``powers`` 0 to ``order``."""
    dot(target, 0, 0, series, 1, powers, 1, order + 1, precision)


@kernel()
def evaluate_all(target: int, space: Space, bodies: int, powers: int, time: int, order: int, precision: int) -> None:
    """Set ``target`` to displacements and then velocities at a ``time``, a ball of which it makes the powers."""
    double(powers, 1.0)
    for o in range(1, order + 1):
        mul(powers + SIZE * o, powers + SIZE * (o - 1), time, precision)
    for i in range(bodies):
        evaluate(target + SIZE * i, space.x + SIZE * space.stride * i, powers, order, precision)
        evaluate(target + SIZE * (bodies + i), space.v + SIZE * space.stride * i, powers, order, precision)


@kernel()
def place(space: Space, bodies: int, state: int, precision: int) -> None:
    """Set the coefficients of order 0 to a state: all displacements, then all velocities."""
    for i in range(bodies):
        copy(space.x + SIZE * space.stride * i, state + SIZE * i, precision)
        copy(space.v + SIZE * space.stride * i, state + SIZE * (bodies + i), precision)


@kernel()
def _difference(target: int, balls: int, bodies: int, left: int, right: int, precision: int) -> None:
    """Set ``target`` to the difference of two numbers of bodies; that of a wall is 0."""
    zero(target)
    if left != bodies:
        add(target, target, balls + SIZE * left, precision)
    if right != bodies:
        sub(target, target, balls + SIZE * right, precision)


@kernel()
def survey(chain: Chain, space: Space, state: int, precision: int, bounds: Floats) -> tuple[float, float, float]:
    """Write lower and upper bounds of overlaps, then of their rates, into ``bounds (4, n_contact)``.

    Returns the largest radii of displacements and of velocities, and the largest speed.
    """
    n = len(chain.mobility) - 1
    found, x_radius, v_radius, speed = space.spare + SIZE * n, 0.0, 0.0, 0.0
    for i in range(n):
        x_radius, v_radius = max(x_radius, radius(state + SIZE * i)), max(v_radius, radius(state + SIZE * (n + i)))
        speed = max(speed, magnitude(state + SIZE * (n + i)))
    for k in range(len(chain.left)):
        _difference(found, state, n, chain.left[k], chain.right[k], precision)
        sub(found, found, chain.gap_balls + SIZE * k, precision)
        bounds[0, k], bounds[1, k] = lower(found), upper(found)
        _difference(found, state + SIZE * n, n, chain.left[k], chain.right[k], precision)
        bounds[2, k], bounds[3, k] = lower(found), upper(found)
    return x_radius, v_radius, speed
