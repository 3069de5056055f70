"""Plain numbers in, plain numbers out: the observed order, extrapolation where it is earned, and what is left.

Knows nothing of scenes or backends, and not of arrays: callers flatten those. The order is fitted on log(dt), with its
sign and its residual, because a mean of log2 ratios hides both (Roache 1998, *Verification and Validation in
Computational Science and Engineering*, ch. 5). Values and bars are treated differently where the resolutions show no
clean order: an extrapolated value is refused (:class:`NotAsymptotic`, with the reason), a bar is inf, never small.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from dem_bridge.errors import NotAsymptotic, UsageError

#: an observed order this far from the formal one still counts as clean
ORDER_WINDOW = 0.1
#: no scheme has more: values that seem to converge faster agree by chance
MOST_ORDER = 8.0
#: errors within this factor (minus one) of their line still count as a line
MOST_SCATTER = 0.1


@dataclass(frozen=True)
class ObservedOrder:
    """Result of :func:`observed_order`."""

    order: float
    """Slope of log(error) on log(dt); negative where refinement makes things worse."""
    residual: float
    """Largest distance of a point from the line, as a factor minus one (0.05 = 5 %)."""
    points: int
    """Points used: those above the round-off floor."""
    steps: tuple[float, ...]
    """s: the dt of the points used, coarse to fine."""
    left_out: int
    """Points not used: no finite number, or at or below the floor."""
    floor: float
    """The round-off floor that was applied, in the unit of the errors."""
    turning_step: float
    """s: of the points used, the dt of the smallest error where finer ones are larger: below it round-off has taken
    over, or refinement never helped. nan where the errors fall down to the finest step."""

    @property
    def sign(self) -> int:
        """1: errors fall under refinement, -1: they grow, 0: neither, or no order at all."""
        return (self.order > 0.0) - (self.order < 0.0)


def observed_order(dt: Sequence[float], error: Sequence[float], *, floor: float = 0.0) -> ObservedOrder:
    """Least-squares order of ``error ~ dt**order`` over the points with ``error > floor``.

    Parameters: ``dt`` in s, all > 0; ``error`` in any one unit; ``floor``: errors at or below it are round-off
    and left out. Fewer than two usable points give ``nan``: an order that cannot be had is not invented.

    >>> fit = observed_order([4e-8, 2e-8, 1e-8], [1.6e-5, 4e-6, 1e-6])
    >>> round(fit.order, 12), fit.sign, fit.points, fit.left_out, fit.turning_step
    (2.0, 1, 3, 0, nan)
    >>> worse = observed_order([9e-8, 3e-8, 1e-8], [1.0, 9.0, 81.0])
    >>> round(worse.order, 12), worse.sign, worse.turning_step
    (-2.0, -1, 9e-08)
    """
    used = sorted(((h, e) for h, e in zip(dt, error, strict=True) if math.isfinite(e) and e > floor), reverse=True)
    n, steps = len(used), tuple(h for h, _ in used)
    best = min(used, key=lambda point: (point[1], point[0]), default=(math.nan, math.nan))[0]
    turning = best if n and best != steps[-1] else math.nan
    slope = residual = math.nan
    if n >= 2 and steps[0] > steps[-1]:
        pairs = [(math.log(h), math.log(e)) for h, e in used]
        mean_x = sum(x for x, _ in pairs) / n
        mean_y = sum(y for _, y in pairs) / n
        spread = sum((x - mean_x) ** 2 for x, _ in pairs)
        slope = sum((x - mean_x) * (y - mean_y) for x, y in pairs) / spread
        residual = math.expm1(max(abs(y - mean_y - slope * (x - mean_x)) for x, y in pairs))
    return ObservedOrder(slope, residual, n, steps, len(dt) - n, floor, turning)


@dataclass(frozen=True, kw_only=True)
class Extrapolation:
    """Result of :func:`richardson`."""

    value: tuple[float, ...]
    """Extrapolated to dt = 0, one number per element."""
    uncertainty: float
    """Largest over the elements. From three resolutions: the distance to the extrapolation from the two coarser ones.
    From two: the correction itself, for nothing else is known."""
    order: float
    """The order observed: from the three resolutions, or that of the fit."""


def richardson(
    dt: Sequence[float],
    values: Sequence[float] | Sequence[Sequence[float]],
    *,
    order: float,
    shown: ObservedOrder | None = None,
    window: float = ORDER_WINDOW,
    floor: float = 0.0,
) -> Extrapolation:
    """``f1 + (f1 - f2)/((h2/h1)^order - 1)``, elementwise, from the two finest of two or three resolutions.

    ``dt``: two or three step sizes in s, in any sequence; ``values``: for each a number or a row of numbers, in one
    unit; ``order``: the formal order, by which is extrapolated. Done only where the order is clean (Richardson 1911,
    *Phil. Trans. R. Soc. A* 210, 307, and its conditions in Roache 1998, ch. 5), else NotAsymptotic with the reason:

    * differences are above ``floor`` (round-off) and keep their sign under refinement;
    * the order observed in the largest differences of three resolutions (their ratios need not be equal) is within
      ``window`` of the formal one, and the extrapolations from the finer and the coarser pair differ by less than the
      correction that they make: elements that do not follow the order are found by this;
    * with two resolutions: a fit ``shown`` of at least three points is within ``window`` of the formal order,
      scatters by at most 10 % and covers both steps.

    An element that is nan in every row stays nan. UsageError for steps and rows that do not fit together.

    >>> found = richardson([4e-8, 2e-8, 1e-8], [1.16, 1.04, 1.01], order=2)
    >>> round(found.value[0], 12), round(found.order, 12), found.uncertainty < 1e-15
    (1.0, 2.0, True)
    >>> richardson([4e-8, 2e-8, 1e-8], [1.16, 1.08, 1.04], order=2)
    Traceback (most recent call last):
    dem_bridge.errors.NotAsymptotic: no extrapolation: observed order 1.000 at dt = 1e-08 .. 4e-08 s; allowed: 2 +- 0.1;
    refine dt
    """
    if not 0.0 < order < math.inf:
        raise UsageError(f"order = {order!r}; allowed: the method's formal order, a number > 0")
    steps, rows = _sorted_rows(dt, values)
    real = [all(not math.isnan(row[i]) for row in rows) for i in range(len(rows[0]))]
    if any(not math.isfinite(row[i]) and (ok or not math.isnan(row[i])) for i, ok in enumerate(real) for row in rows):
        raise NotAsymptotic(
            "no extrapolation: a value is infinite; allowed: finite numbers, or nan in every resolution"
        )
    if any(not ok and any(not math.isnan(row[i]) for row in rows) for i, ok in enumerate(real)):
        raise NotAsymptotic("no extrapolation: a value is nan in some resolutions only; refine dt until all agree")
    kept = [[x for x, ok in zip(row, real, strict=True) if ok] for row in rows]
    fine = [a - b for a, b in zip(kept[0], kept[1], strict=True)]
    size = max(map(abs, fine), default=0.0)
    where = f"at dt = {steps[0]:.3g} .. {steps[-1]:.3g} s"
    if not size > floor:
        raise NotAsymptotic(
            f"no extrapolation: the finest results differ by {size:.3g} {where};"
            f" allowed: more than the floor, {floor:.3g}"
        )
    factor = math.expm1(order * math.log(steps[1] / steps[0]))
    if len(steps) == 3:
        coarse = [a - b for a, b in zip(kept[1], kept[2], strict=True)]
        found = _order_of_three(steps, size, max(map(abs, coarse)))
        if sum(a * b for a, b in zip(fine, coarse, strict=True)) < 0.0:
            raise NotAsymptotic(f"no extrapolation: the results go back and forth {where}; refine dt")
        outer = math.expm1(order * math.log(steps[2] / steps[1]))
        # f1 + d21/(r21^p - 1) less f2 + d32/(r32^p - 1)
        apart = max(abs(a + a / factor - b / outer) for a, b in zip(fine, coarse, strict=True))
    else:
        found, apart = _shown_order(shown, steps), size / factor
    if not abs(found - order) <= window:
        raise NotAsymptotic(
            f"no extrapolation: observed order {found:.3f} {where}; allowed: {order:g} +- {window:g}; refine dt"
        )
    if len(steps) == 3 and not apart < size / factor:
        raise NotAsymptotic(
            f"no extrapolation: those of the finer and the coarser pair differ by {apart:.3g} {where};"
            f" allowed: less than their correction, {size / factor:.3g}; refine dt"
        )
    correction = iter(fine)
    return Extrapolation(
        value=tuple(x + next(correction) / factor if ok else math.nan for x, ok in zip(rows[0], real, strict=True)),
        uncertainty=apart,
        order=found,
    )


@dataclass(frozen=True, kw_only=True)
class GridConvergence:
    """Result of :func:`grid_convergence_index`."""

    order: float
    """Observed, with its sign; nan where there is none."""
    fine: float
    """GCI of the finest value, relative to it (0.01 = 1 %); inf where nothing can be said."""
    coarse: float
    """GCI of the middle value, relative to it."""
    uncertainty: float
    """The finest value's GCI times its magnitude: a bar in its unit."""
    extrapolated: float
    """Richardson's value by the order used; nan where there is none."""
    asymptotic_ratio: float
    """GCI23 / (r^p GCI12): 1 in the asymptotic range (Roache 1994). Where p comes from the same three values it tells
    little; with a formal order that caps p it does."""
    asymptotic: bool
    """The ratio is near 1 and the observed order near the formal one, if that was given."""
    reason: str
    """Why nothing can be said; empty where something can."""


def grid_convergence_index(
    spacing: Sequence[float],
    values: Sequence[float],
    *,
    safety: float = 1.25,
    formal_order: float | None = None,
    window: float = ORDER_WINDOW,
) -> GridConvergence:
    """Grid convergence index of three values, with the order observed in them.

    ``spacing``: three step or cell sizes in one unit, in any sequence and ratio; ``values``: one number for each;
    ``safety``: 1.25 for three grids (Roache 1994, *J. Fluids Eng.* 116, 405; 1998, ch. 5). The order solves
    ``(h3^p - h2^p)/(h2^p - h1^p) = (f3 - f2)/(f2 - f1)`` by iteration, which is eq. 3 of Celik et al. (2008, *J. Fluids
    Eng.* 130, 078001) with its sign. An order above ``formal_order`` is luck: the formal one is used, and the bar is
    the larger of those that the finer and the coarser pair give. Values that are equal, oscillate or move apart have no
    index: inf. Nor have, without a formal order, two values so close that the order would be above 8. UsageError for
    anything that is not three and three.

    >>> nasa = grid_convergence_index([1.0, 2.0, 4.0], [0.97050, 0.96854, 0.96178])
    >>> f"p = {nasa.order:.6f}, GCI12 = {100 * nasa.fine:.6f} %, GCI23 = {100 * nasa.coarse:.6f} %"
    'p = 1.786170, GCI12 = 0.103083 %, GCI23 = 0.356249 %'
    >>> f"{nasa.extrapolated:.5f}", f"{nasa.asymptotic_ratio:.6f}", nasa.asymptotic
    ('0.97130', '1.002024', True)
    """
    steps, rows = _sorted_rows(spacing, values)
    if len(steps) != 3 or len(rows[0]) != 1:
        raise UsageError(f"{len(steps)} spacings with {len(rows[0])} values each; allowed: three, with one value each")
    if not safety >= 1.0:
        raise UsageError(f"safety = {safety!r}; allowed: a number >= 1, as 1.25")
    f1, f2, f3 = (row[0] for row in rows)
    fine, coarse = f1 - f2, f2 - f3
    reason, order = "", math.nan
    if not all(map(math.isfinite, (f1, f2, f3))):
        reason = "a value is no finite number"
    elif fine == 0.0 or coarse == 0.0:
        reason = "two values are equal"
    elif (fine > 0.0) != (coarse > 0.0):
        reason = "the values oscillate under refinement"
    else:
        order = _order_of_three(steps, abs(fine), abs(coarse))
        if not order > 0.0:
            reason = f"the values move apart under refinement (observed order {order:.3f})"
        elif formal_order is None and order > MOST_ORDER:
            reason = f"observed order {order:.3f}: the finest two agree by chance; a formal order would cap it"
    if reason:
        return GridConvergence(
            order=order, fine=math.inf, coarse=math.inf, uncertainty=math.inf,
            extrapolated=math.nan, asymptotic_ratio=math.nan, asymptotic=False, reason=reason,
        )  # fmt: skip
    used = order if formal_order is None else min(order, formal_order)
    inner, outer = (math.expm1(used * math.log(steps[i + 1] / steps[i])) for i in (0, 1))
    finer, coarser = safety * abs(fine) / inner, safety * abs(coarse) / outer
    bar = max(finer, coarser / (inner + 1.0)) if used < order else finer  # luck does not make a bar small
    ratio = coarser * abs(f1) / ((inner + 1.0) * finer * abs(f2)) if f2 != 0.0 else math.nan
    near = formal_order is None or abs(order - formal_order) <= window
    return GridConvergence(
        order=order,
        fine=bar / abs(f1) if f1 != 0.0 else math.inf,
        coarse=coarser / abs(f2) if f2 != 0.0 else math.inf,
        uncertainty=bar,
        extrapolated=f1 + fine / inner,
        asymptotic_ratio=ratio,
        asymptotic=near and abs(ratio - 1.0) <= window,
        reason="",
    )


def checked_accuracy(accuracy: object) -> float:
    """``accuracy`` as a float; UsageError, in one line, where it is none.

    >>> checked_accuracy(1e-6)
    1e-06
    """
    if isinstance(accuracy, bool) or not isinstance(accuracy, int | float) or not 0.0 < accuracy < 1.0:
        raise UsageError(f"accuracy = {accuracy!r}; allowed: a number between 0 and 1, as 1e-6")
    return float(accuracy)


def _sorted_rows(
    dt: Sequence[float], values: Sequence[float] | Sequence[Sequence[float]]
) -> tuple[list[float], list[list[float]]]:
    """Steps and rows from fine to coarse; UsageError where they do not fit together."""
    rows = [[float(x) for x in v] if isinstance(v, Iterable) else [float(v)] for v in values]
    if len(dt) not in (2, 3) or len(rows) != len(dt):
        raise UsageError(f"{len(dt)} resolutions with {len(rows)} results; allowed: two or three, with a result each")
    if len({len(row) for row in rows}) != 1:
        raise UsageError(f"results of {[len(row) for row in rows]} numbers; allowed: as many in every resolution")
    steps = [float(h) for h in dt]
    if not all(0.0 < h < math.inf for h in steps) or len(set(steps)) != len(steps):
        raise UsageError(f"resolutions {steps}; allowed: numbers > 0, no two equal")
    pairs = sorted(zip(steps, rows, strict=True), key=lambda pair: pair[0])
    return [h for h, _ in pairs], [row for _, row in pairs]


def _order_of_three(steps: Sequence[float], fine: float, coarse: float) -> float:
    """p of ``(h3^p - h2^p)/(h2^p - h1^p) = coarse/fine``, both differences > 0: by bisection, with its sign.

    The left side grows with p from 0 to infinity, so that there is one solution; 64 is as good as infinite.
    """
    if not 0.0 < fine < math.inf or not 0.0 < coarse < math.inf:
        return math.nan
    inner, outer, wanted = math.log(steps[1] / steps[0]), math.log(steps[2] / steps[1]), math.log(coarse / fine)

    def log_expm1(x: float) -> float:  # log |exp(x) - 1|, without overflow
        return max(x, 0.0) + math.log(-math.expm1(-abs(x)))

    def excess(p: float) -> float:
        quotient = log_expm1(p * outer) - log_expm1(p * inner) if p != 0.0 else math.log(outer / inner)
        return p * inner + quotient - wanted

    low, high = -64.0, 64.0
    for _ in range(200):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        low, high = (middle, high) if excess(middle) < 0.0 else (low, middle)
    return high


def _shown_order(shown: ObservedOrder | None, steps: Sequence[float]) -> float:
    """The order of a fit that says something of these steps; NotAsymptotic where it does not."""
    if shown is None:
        raise NotAsymptotic("no extrapolation: two resolutions show no order; give three, or a fit that shows it")
    if shown.points < 3 or not shown.residual <= MOST_SCATTER:
        raise NotAsymptotic(
            f"no extrapolation: the order shown rests on {shown.points} points that scatter by {shown.residual:.2g};"
            f" allowed: at least 3, by at most {MOST_SCATTER:g}"
        )
    # a step is seldom the number that was asked for: interval/ceil(interval/dt)
    if not (shown.steps[-1] <= 1.001 * steps[0] and steps[-1] <= 1.001 * shown.steps[0]):
        raise NotAsymptotic(
            f"no extrapolation: dt = {steps[0]:.3g} .. {steps[-1]:.3g} s, but the order was shown over"
            f" {shown.steps[-1]:.3g} .. {shown.steps[0]:.3g} s; allowed: steps within"
        )
    return shown.order
