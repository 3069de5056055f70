"""Sobol' indices: the part of the variance of each observable that each varied number explains.

The first-order index of a number is the part of the variance that goes when that number alone is known; its total index
is the part that stays while all others are known (Sobol' 2001, *Math. Comput. Simul.* 55, 271). They are estimated from
``n (2 d + 2)`` chains for d numbers: two samples, and each of them with one column of the other. Both estimators are
products of differences that vanish with the index, so that a small index has a small error (Owen 2013, *ACM Trans.
Model. Comput. Simul.* 23, 11; Jansen 1999, *Comput. Phys. Commun.* 117, 35). Intervals are by bootstrap of the rows of
both samples together.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dem_bridge.ensembles.draw import BLOCK, Variation
from dem_bridge.ensembles.run import PILOT, pool_of
from dem_bridge.ensembles.solve import check_solvable, solve_chains, steps_for
from dem_bridge.errors import UsageError
from dem_bridge.foundation.numbers import check_number
from dem_bridge.runs.campaign import Progress, for_workers
from dem_bridge.trajectory.trajectory import Floats

#: part of an index's interval, and least probability that the leading numbers contain the one of the largest index
CONFIDENCE = 0.95
#: resamplings of the bootstrap
_RESAMPLES = 1000
#: reads the measures of many chains from their observables: ``(n_measure, n_chain)``
Measures = Callable[[dict[str, Floats]], Floats]


@dataclass(frozen=True, kw_only=True, eq=False)
class Indices:
    """Sobol' indices ``(n_measure, n_column)`` of the measures for the varied numbers, with their intervals."""

    columns: tuple[tuple[str, int], ...]
    """The varied numbers: key and index."""
    first: Floats
    first_interval: Floats
    """``(2, n_measure, n_column)``: lower and upper end, 95 %."""
    total: Floats
    total_interval: Floats
    leading: NDArray[np.bool_]
    """Whether each number may have the largest first-order index: see :func:`may_be_largest`."""
    sum_interval: Floats
    """``(2, n_measure)``: lower and upper end, 95 %, of the sum of the first-order indices."""
    mean: Floats
    """Mean of each measure over the chains, ``(n_measure,)``."""
    deviation: Floats
    """Standard deviation of each measure, ``(n_measure,)``."""
    chains: int
    """Number of chains that were solved."""


def sobol_indices(
    variation: Variation,
    measures: Measures,
    *,
    base: int = 256,
    accuracy: float = 1e-4,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Indices:
    """Return the Sobol' indices of measures of a chain.

    Parameters
    ----------
    variation : Variation
        The chain, what varies and the seed.
    measures : callable
        Reads measures, ``(n_measure, n_chain)``, from the observables of chains, without nan.
    base : int
        Number n of base samples, a power of 2; ``n (2 d + 2)`` chains are solved for d numbers.
    accuracy : float
        Relative accuracy of the observables of each chain.
    executor : concurrent.futures.Executor, optional
        Where blocks of chains are solved. None: threads on all cores.
    progress : callable, optional
        Function that is called with (done, total, label).

    Raises
    ------
    UsageError
        If ``base`` is no power of 2 from 2 on, or a chain has no value of a measure.
    """
    from scipy.stats import qmc

    allowed = "a power of 2 from 2 on, such as 256"
    base = check_number("base", base, allowed, whole=True, at_least=2)
    if base & (base - 1):
        raise UsageError(f"base = {base!r}; allowed: {allowed}")
    check_solvable(variation.scene)
    count = len(variation.columns)
    steps = steps_for(variation.scene, variation.block(0, PILOT), accuracy)
    sample = qmc.Sobol(2 * count, scramble=True, rng=np.random.default_rng(variation.seed)).random(base)
    uniform = exchange_columns(sample[:, :count], sample[:, count:])
    values = _solved(variation, measures, uniform, steps, executor, progress)
    if np.any(np.isnan(values)):
        raise UsageError(
            f"{variation.scene.name}: {int(np.any(np.isnan(values), axis=0).sum())} of {values.shape[1]} chains lack a"
            " value of a measure, because the wave does not reach its place; give a longer duration or a smaller spread"
        )
    deviation, mean = values.std(axis=1), values.mean(axis=1)
    # what varies by less than the error of the runs has no variance that could be explained: its indices are nan
    scale = np.where(deviation > 1e-2 * accuracy * np.abs(mean), deviation, np.nan)
    scaled = ((values - mean[:, None]) / scale[:, None]).reshape(len(values), -1, base)
    weights = np.random.default_rng(variation.seed).multinomial(base, np.full(base, 1.0 / base), _RESAMPLES) / base
    quantiles = [0.5 - 0.5 * CONFIDENCE, 0.5 + 0.5 * CONFIDENCE]
    estimates, ends, leading, sums = [], [], [], []
    for blocks in scaled:
        estimate, resampled = (
            estimate_indices(blocks, np.full((1, base), 1.0 / base))[..., 0],
            estimate_indices(blocks, weights),
        )
        estimates.append(estimate)
        ends.append(np.quantile(resampled, quantiles, axis=-1))
        leading.append(may_be_largest(estimate[0], resampled[0]))
        sums.append(np.quantile(np.sum(resampled[0], axis=0), quantiles))
    (first, total), (first_interval, total_interval) = np.stack(estimates, 1), np.stack(ends, 2).swapaxes(0, 1)
    return Indices(
        columns=variation.columns,
        first=first,
        first_interval=first_interval,
        total=total,
        total_interval=total_interval,
        leading=np.array(leading),
        sum_interval=np.stack(sums, 1),
        mean=mean,
        deviation=deviation,
        chains=len(uniform),
    )


def exchange_columns(first: Floats, second: Floats) -> Floats:
    """Return two samples, the first with each column of the second, and the second with each column of the first."""
    count = first.shape[1]
    blocks = [first, second]
    for sample, other in ((first, second), (second, first)):
        mixed = np.repeat(sample[None], count, axis=0)
        mixed[np.arange(count), :, np.arange(count)] = other.T
        blocks += list(mixed)
    return np.concatenate(blocks)


def estimate_indices(blocks: Floats, weights: Floats) -> Floats:
    """Return first-order and total indices of a measure, ``(2, n_column, n_weight)``.

    ``blocks`` are the values of :func:`exchange_columns` without their mean, ``(2 n_column + 2, n_base)``; each of the
    ``weights``, ``(n_weight, n_base)``, weighs the rows of the samples.
    """
    first, second, (mixed, other) = blocks[0], blocks[1], np.split(blocks[2:], 2)
    terms = 0.5 * (first - mixed) * (other - second), 0.25 * ((first - mixed) ** 2 + (second - other) ** 2)
    return np.asarray(np.stack(terms) @ weights.T / (np.mean(blocks**2, axis=0) @ weights.T))


def may_be_largest(first: Floats, resampled: Floats) -> NDArray[np.bool_]:
    """Return which of several estimated indices may be the largest.

    For each index the hypothesis is tested that it is the largest: it is rejected where some other index exceeds it by
    more than 95 % of the resamplings deviate, of all differences from this index, in their standard deviations. The
    truly largest one is therefore among those that remain with a probability of 95 %, however many there are.

    Parameters
    ----------
    first : ndarray, shape (n_column,)
        The estimates.
    resampled : ndarray, shape (n_column, n_resample)
        Estimates from resampled data.

    Examples
    --------
    >>> random = np.random.default_rng(0)
    >>> first = np.array([0.50, 0.48, 0.02])
    >>> may_be_largest(first, first[:, None] + 0.03 * random.standard_normal((3, 1000))).tolist()
    [True, True, False]
    """
    remains = np.isfinite(first)
    for nth in np.flatnonzero(remains):
        excess = first - first[nth]
        deviates = resampled - resampled[nth] - excess[:, None]
        spread = np.std(deviates, axis=1)
        others = spread > 0.0
        if np.any(others):
            largest = np.max(deviates[others] / spread[others, None], axis=0)
            remains[nth] = np.max(excess[others] / spread[others]) <= np.quantile(largest, CONFIDENCE)
    return remains


def _solved(
    variation: Variation,
    measures: Measures,
    uniform: Floats,
    steps: int,
    executor: Executor | None,
    progress: Progress | None,
) -> Floats:
    """Return the measures of the chains of numbers between 0 and 1, ``(n_measure, n_chain)``."""
    block = partial(for_workers(_block), variation, measures, steps)
    blocks = [uniform[first : first + BLOCK] for first in range(0, len(uniform), BLOCK)]
    out = []
    with pool_of(executor) as pool:
        for done, values in enumerate(pool.map(block, blocks), start=1):
            out.append(values)
            if progress is not None:
                progress(done, len(blocks), f"{variation.scene.name}: {len(uniform)} chains")
    return np.concatenate(out, axis=1)


def _block(variation: Variation, measures: Measures, steps: int, uniform: Floats) -> Floats:
    """Return the measures of a block of chains; what a worker does."""
    return measures(solve_chains(variation.scene, variation.chains(uniform), steps))
