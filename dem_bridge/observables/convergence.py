"""Observed order of convergence, Richardson extrapolation and grid convergence index, on plain numbers.

The functions take lists of numbers, not scenes or arrays. The order is fitted on log(dt) and reported with its sign and
its residual, because a mean of log2 ratios hides both (Roache 1998, *Verification and Validation in Computational
Science and Engineering*, ch. 5). Where the resolutions show no clean order, an extrapolated value is refused
(:class:`NotAsymptotic` gives the reason), and an uncertainty is inf, never small.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from dem_bridge.errors import NotAsymptotic, UsageError
from dem_bridge.foundation.arguments import check_arguments
from dem_bridge.foundation.numbers import check_number

#: largest difference between the observed and the formal order that counts as clean
ORDER_WINDOW = 0.1
#: smallest accuracy that is looked for, relative: ten times the distance of numbers in double precision
FINEST_ACCURACY = 10.0 * sys.float_info.epsilon
#: largest plausible order: values that seem to converge faster agree by chance
MOST_ORDER = 8.0


@dataclass(frozen=True)
class ObservedOrder:
    """Order of convergence fitted to errors.

    :func:`observed_order` computes it.
    """

    order: float
    """Slope of log(error) against log(dt); negative if refinement makes the errors larger."""
    residual: float
    """Largest distance of a point from the line, as a factor minus one (0.05 = 5 %)."""
    points: int
    """Number of points used: those above the round-off floor."""
    steps: tuple[float, ...]
    """dt of the points used, s, coarse to fine."""
    left_out: int
    """Number of points not used: not finite, or at or below the floor."""
    floor: float
    """Round-off floor that was applied, in the unit of the errors."""
    turning_step: float
    """dt of the smallest error if errors at finer steps are larger, s; nan if the errors fall down to the finest step.

    Below this step round-off dominates, or refinement never helped.
    """

    @property
    def sign(self) -> int:
        """Sign of the order: 1 if errors fall under refinement, -1 if they grow, 0 if neither or without an order."""
        return (self.order > 0.0) - (self.order < 0.0)


def observed_order(dt: Sequence[float], error: Sequence[float], *, floor: float = 0.0) -> ObservedOrder:
    """Return the least-squares order of ``error ~ dt**order`` over the points with ``error > floor``.

    Parameters
    ----------
    dt : sequence of float
        Time steps, s, all > 0.
    error : sequence of float
        Errors, in any one unit.
    floor : float
        Round-off floor; errors at or below it are left out.

    Returns
    -------
    ObservedOrder
        Its order is nan if fewer than two points are usable.

    Examples
    --------
    >>> fit = observed_order([4e-8, 2e-8, 1e-8], [1.6e-5, 4e-6, 1e-6])
    >>> round(fit.order, 12), fit.sign, fit.points, fit.left_out, fit.turning_step
    (2.0, 1, 3, 0, nan)
    >>> worse = observed_order([9e-8, 3e-8, 1e-8], [1.0, 9.0, 81.0])
    >>> round(worse.order, 12), worse.sign, worse.turning_step
    (-2.0, -1, 9e-08)
    """
    check_arguments(observed_order, locals())
    if len(dt) != len(error) or not all(0.0 < step < math.inf for step in dt):
        raise UsageError(f"{len(dt)} steps and {len(error)} errors; allowed: as many finite steps > 0 (s) as errors")
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
    """Values extrapolated to dt = 0.

    :func:`richardson` computes it.
    """

    value: tuple[float, ...]
    """Values extrapolated to dt = 0, one number per element."""
    uncertainty: float
    """Largest uncertainty of the elements: the distance to the extrapolation from the two coarser resolutions."""
    order: float
    """Observed order."""


def richardson(
    dt: Sequence[float],
    values: Sequence[float] | Sequence[Sequence[float]],
    *,
    order: float,
    floor: float = 0.0,
) -> Extrapolation:
    """Extrapolate to dt = 0 elementwise, ``f1 + (f1 - f2)/((h2/h1)^order - 1)``, from the two finest of three runs.

    The extrapolation is made only if the order is clean:

    * differences are above ``floor`` (round-off) and keep their sign under refinement;
    * the order observed in the largest differences (the ratios of the steps need not be equal) is within 0.1 of the
      formal one, and the extrapolations from the finer and the coarser pair differ by less than the correction that
      they make, which detects elements that do not follow the order.

    Parameters
    ----------
    dt : sequence of float
        Three time steps, s, in any sequence.
    values : sequence
        For each step a number or a row of numbers, in one unit. An element that is nan in every row remains nan.
    order : float
        Formal order, which the extrapolation uses.
    floor : float
        Round-off floor of the differences.

    Raises
    ------
    NotAsymptotic
        If the order is not clean; the message gives the reason.
    UsageError
        If steps and rows do not match.

    References
    ----------
    Richardson (1911), *Phil. Trans. R. Soc. A* 210, 307; conditions: Roache (1998), ch. 5.

    Examples
    --------
    >>> result = richardson([4e-8, 2e-8, 1e-8], [1.16, 1.04, 1.01], order=2)
    >>> round(result.value[0], 12), round(result.order, 12), result.uncertainty < 1e-15
    (1.0, 2.0, True)
    >>> richardson([4e-8, 2e-8, 1e-8], [1.16, 1.08, 1.04], order=2)
    Traceback (most recent call last):
    dem_bridge.errors.NotAsymptotic: no extrapolation: observed order 1.000 at dt = 1e-08 .. 4e-08 s; allowed: 2 +- 0.1;
    refine dt
    """
    if not 0.0 < order < math.inf:
        raise UsageError(f"order = {order!r}; allowed: the method's formal order, a number > 0")
    import numpy as np

    steps, lists = _sorted_rows(dt, values)
    rows = np.array(lists)
    undefined = np.isnan(rows)
    if np.isinf(rows).any():
        raise NotAsymptotic(
            "no extrapolation: a value is infinite; allowed: finite numbers, or nan in every resolution"
        )
    if (undefined.any(axis=0) != undefined.all(axis=0)).any():
        raise NotAsymptotic("no extrapolation: a value is nan in some resolutions only; refine dt until all agree")
    # differences of each resolution and the next coarser one
    fine, coarse = -np.diff(rows[:, ~undefined[0]], axis=0)
    size = float(np.max(np.abs(fine), initial=0.0))
    steps_text = f"at dt = {steps[0]:.3g} .. {steps[-1]:.3g} s"
    if not size > floor:
        raise NotAsymptotic(
            f"no extrapolation: the finest results differ by {size:.3g} {steps_text};"
            f" allowed: more than the floor, {floor:.3g}"
        )
    factor, outer = (math.expm1(order * math.log(steps[i + 1] / steps[i])) for i in (0, 1))
    observed = _order_of_three(steps, size, float(np.max(np.abs(coarse))))
    if fine @ coarse < 0.0:
        raise NotAsymptotic(f"no extrapolation: the results oscillate under refinement {steps_text}; refine dt")
    # f1 + d21/(r21^p - 1) less f2 + d32/(r32^p - 1)
    spread = float(np.max(np.abs(fine + fine / factor - coarse / outer)))
    if not abs(observed - order) <= ORDER_WINDOW:
        allowed = f"{order:g} +- {ORDER_WINDOW:g}"
        raise NotAsymptotic(
            f"no extrapolation: observed order {observed:.3f} {steps_text}; allowed: {allowed}; refine dt"
        )
    if not spread < size / factor:
        raise NotAsymptotic(
            f"no extrapolation: the results of the finer and the coarser pair differ by {spread:.3g} {steps_text};"
            f" allowed: less than their correction, {size / factor:.3g}; refine dt"
        )
    finest = rows[0]
    finest[~undefined[0]] += fine / factor
    return Extrapolation(value=tuple(finest.tolist()), uncertainty=spread, order=observed)


@dataclass(frozen=True, kw_only=True)
class GridConvergence:
    """Grid convergence index (GCI) of three values.

    :func:`grid_convergence_index` computes it.
    """

    order: float
    """Observed order with its sign; nan if there is none."""
    fine: float
    """GCI of the finest value, relative to it (0.01 = 1 %); inf if it cannot be computed."""
    coarse: float
    """GCI of the middle value, relative to it."""
    uncertainty: float
    """GCI of the finest value times its magnitude: an uncertainty in its unit."""
    extrapolated: float
    """Richardson extrapolation by the order used; nan if there is none."""
    asymptotic_ratio: float
    """GCI23 / (r^p GCI12), 1 in the asymptotic range (Roache 1994).

    It is a weak test if p comes from the same three values, and a real one if a formal order caps p.
    """
    asymptotic: bool
    """True if the ratio is near 1 and the observed order is near the formal one, if that is given."""
    reason: str
    """Reason why there is no index; empty if there is one."""


def grid_convergence_index(
    spacing: Sequence[float],
    values: Sequence[float],
    *,
    safety: float = 1.25,
    formal_order: float | None = None,
    window: float = ORDER_WINDOW,
) -> GridConvergence:
    """Return the grid convergence index of three values, with the order observed in them.

    The order solves ``(h3^p - h2^p)/(h2^p - h1^p) = (f3 - f2)/(f2 - f1)`` by iteration, which is eq. 3 of Celik et al.
    (2008) with its sign. If it exceeds ``formal_order`` by chance, the formal order is used, and the uncertainty is the
    larger of the estimates from the finer and the coarser pair. The index is inf for values that are equal, oscillate
    or diverge, and, without a formal order, for two values so close that the order would exceed 8.

    Parameters
    ----------
    spacing : sequence of float
        Three step or cell sizes, in one unit, in any sequence and ratio.
    values : sequence of float
        One value for each.
    safety : float
        Safety factor; 1.25 for three grids.
    formal_order : float, optional
        Formal order of the scheme.
    window : float
        Largest difference between observed and formal order, and of the asymptotic ratio from 1.

    Raises
    ------
    UsageError
        If there are not three spacings with one value each.

    References
    ----------
    Roache (1994), *J. Fluids Eng.* 116, 405; Roache (1998), ch. 5; Celik et al. (2008), *J. Fluids Eng.* 130, 078001.

    Examples
    --------
    >>> nasa = grid_convergence_index([1.0, 2.0, 4.0], [0.97050, 0.96854, 0.96178])
    >>> f"p = {nasa.order:.6f}, GCI12 = {100 * nasa.fine:.6f} %, GCI23 = {100 * nasa.coarse:.6f} %"
    'p = 1.786170, GCI12 = 0.103083 %, GCI23 = 0.356249 %'
    >>> f"{nasa.extrapolated:.5f}", f"{nasa.asymptotic_ratio:.6f}", nasa.asymptotic
    ('0.97130', '1.002024', True)
    """
    steps, rows = _sorted_rows(spacing, [float(value) for value in values])
    check_number("safety", safety, "a number >= 1, such as 1.25", at_least=1.0)
    f1, f2, f3 = (row[0] for row in rows)
    fine, coarse = f1 - f2, f2 - f3
    reason, order = "", math.nan
    if not all(map(math.isfinite, (f1, f2, f3))):
        reason = "a value is not a finite number"
    elif fine == 0.0 or coarse == 0.0:
        reason = "two values are equal"
    elif (fine > 0.0) != (coarse > 0.0):
        reason = "the values oscillate under refinement"
    else:
        order = _order_of_three(steps, abs(fine), abs(coarse))
        if not order > 0.0:
            reason = f"the values diverge under refinement (observed order {order:.3f})"
        elif formal_order is None and order > MOST_ORDER:
            reason = f"observed order {order:.3f}: the finest two agree by chance; give formal_order to limit it"
    if reason:
        unknown = dict.fromkeys(("fine", "coarse", "uncertainty"), math.inf)
        unknown |= dict.fromkeys(("extrapolated", "asymptotic_ratio"), math.nan)
        return GridConvergence(order=order, asymptotic=False, reason=reason, **unknown)
    applied = order if formal_order is None else min(order, formal_order)
    inner, outer = (math.expm1(applied * math.log(steps[i + 1] / steps[i])) for i in (0, 1))
    finer, coarser = safety * abs(fine) / inner, safety * abs(coarse) / outer
    uncertainty = max(finer, coarser / (inner + 1.0)) if applied < order else finer  # chance must not make it small
    ratio = coarser * abs(f1) / ((inner + 1.0) * finer * abs(f2)) if f2 != 0.0 else math.nan
    near = formal_order is None or abs(order - formal_order) <= window
    return GridConvergence(
        order=order,
        fine=uncertainty / abs(f1) if f1 != 0.0 else math.inf,
        coarse=coarser / abs(f2) if f2 != 0.0 else math.inf,
        uncertainty=uncertainty,
        extrapolated=f1 + fine / inner,
        asymptotic_ratio=ratio,
        asymptotic=near and abs(ratio - 1.0) <= window,
        reason="",
    )


def checked_accuracy(accuracy: object) -> float:
    """Return ``accuracy`` as a float.

    Raises
    ------
    UsageError
        If it is not a number between 0 and 1, or below :data:`FINEST_ACCURACY`.

    Examples
    --------
    >>> checked_accuracy(1e-6)
    1e-06
    """
    number = float(check_number("accuracy", accuracy, "a number between 0 and 1, such as 1e-6", above=0.0, below=1.0))
    if number < FINEST_ACCURACY:
        raise UsageError(
            f"accuracy = {number:g} cannot be reached: double precision rounds every velocity to 1.1e-16 of its size,"
            f" at every step; allowed: at least {FINEST_ACCURACY:.1g}; ask for less"
        )
    return number


def _sorted_rows(
    dt: Sequence[float], values: Sequence[float] | Sequence[Sequence[float]]
) -> tuple[list[float], list[list[float]]]:
    """Return steps and rows from fine to coarse, or raise UsageError if they do not match."""
    rows = [[float(x) for x in v] if isinstance(v, Iterable) else [float(v)] for v in values]
    if len(dt) != 3 or len(rows) != 3:
        raise UsageError(f"{len(dt)} resolutions with {len(rows)} results; allowed: three, with one result each")
    if len({len(row) for row in rows}) != 1:
        raise UsageError(
            f"results of {[len(row) for row in rows]} numbers; allowed: the same number in every resolution"
        )
    steps = [float(h) for h in dt]
    if not all(0.0 < h < math.inf for h in steps) or len(set(steps)) != len(steps):
        raise UsageError(f"resolutions {steps}; allowed: distinct numbers > 0")
    pairs = sorted(zip(steps, rows, strict=True), key=lambda pair: pair[0])
    return [h for h, _ in pairs], [row for _, row in pairs]


def _order_of_three(steps: Sequence[float], fine: float, coarse: float) -> float:
    """Return p of ``(h3^p - h2^p)/(h2^p - h1^p) = coarse/fine`` with its sign, for differences > 0, by bisection.

    The left side grows with p from 0 to infinity, so the solution is unique; |p| = 64 stands for infinity.
    """
    if not 0.0 < fine < math.inf or not 0.0 < coarse < math.inf:
        return math.nan
    inner, outer, target = math.log(steps[1] / steps[0]), math.log(steps[2] / steps[1]), math.log(coarse / fine)

    def log_expm1(x: float) -> float:  # log |exp(x) - 1|, without overflow
        return max(x, 0.0) + math.log(-math.expm1(-abs(x)))

    def excess(p: float) -> float:
        quotient = log_expm1(p * outer) - log_expm1(p * inner) if p != 0.0 else math.log(outer / inner)
        return p * inner + quotient - target

    low, high = -64.0, 64.0
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) < 0.0 else (low, middle)
    return high
