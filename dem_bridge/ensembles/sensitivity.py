"""Sobol' indices: the part of the variance of each observable that each varied number explains.

The first-order index of a number is the part of the variance that goes when that number alone is known; its total index
is the part that stays while all others are known (Sobol' 2001, *Math. Comput. Simul.* 55, 271). They are estimated from
``n (d + 2)`` chains for d numbers (Saltelli et al. 2010, *Comput. Phys. Commun.* 181, 259) by
:func:`scipy.stats.sobol_indices`, with intervals by its bootstrap.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dem_bridge.campaign import Progress, for_workers
from dem_bridge.ensembles.draw import BLOCK, Variation
from dem_bridge.ensembles.run import PILOT, pool_of
from dem_bridge.ensembles.solve import check_solvable, solve_chains, steps_for
from dem_bridge.errors import UsageError
from dem_bridge.trajectory import Floats

if TYPE_CHECKING:
    from scipy.stats._resampling import BootstrapResult

#: part of an index's interval
CONFIDENCE = 0.95
#: resamplings of the bootstrap
_RESAMPLES = 200
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
        Number n of base samples, a power of 2; ``n (d + 2)`` chains are solved for d numbers.
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
    from scipy.stats import sobol_indices as estimate

    if isinstance(base, bool) or not isinstance(base, int) or base < 2 or base & (base - 1):
        raise UsageError(f"base = {base!r}; allowed: a power of 2 from 2 on, such as 256")
    check_solvable(variation.scene)
    count = len(variation.columns)
    steps = steps_for(variation.scene, variation.block(0, PILOT), accuracy)
    sample = qmc.Sobol(2 * count, scramble=True, rng=np.random.default_rng(variation.seed)).random(base)
    first, second = sample[:, :count], sample[:, count:]
    mixed = np.repeat(first[None], count, axis=0)
    mixed[np.arange(count), :, np.arange(count)] = second.T
    uniform = np.concatenate([first, second, mixed.reshape(-1, count)])
    values = _solved(variation, measures, uniform, steps, executor, progress)
    if np.any(np.isnan(values)):
        raise UsageError(
            f"{variation.scene.name}: {int(np.any(np.isnan(values), axis=0).sum())} of {values.shape[1]} chains lack a"
            " value of a measure, because the wave does not reach its place; give a longer duration or a smaller spread"
        )
    rows = len(values)
    deviation = values[:, : 2 * base].std(axis=1)
    middle = values[:, : 2 * base].mean(axis=1)
    # what varies by less than the error of the runs has no variance that could be explained: its indices are nan
    varies = np.flatnonzero(deviation > 1e-2 * accuracy * np.abs(middle))
    scaled = (values[varies] - middle[varies, None]) / deviation[varies, None]
    samples = {
        "f_A": scaled[:, :base],
        "f_B": scaled[:, base : 2 * base],
        "f_AB": scaled[:, 2 * base :].reshape(len(varies), count, base).transpose(1, 0, 2),
    }
    result = estimate(func=samples, n=base, rng=np.random.default_rng(variation.seed))
    with np.errstate(invalid="ignore", divide="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an index that no resampling changes has no interval: nan
        interval = result.bootstrap(confidence_level=CONFIDENCE, n_resamples=_RESAMPLES)

    def filled(part: Floats) -> Floats:
        out = np.full((rows, count), np.nan)
        out[varies] = part
        return out

    def ends(part: BootstrapResult) -> Floats:
        return np.array([filled(part.confidence_interval.low), filled(part.confidence_interval.high)])

    return Indices(
        columns=variation.columns,
        first=filled(result.first_order),
        first_interval=ends(interval.first_order),
        total=filled(result.total_order),
        total_interval=ends(interval.total_order),
        mean=middle,
        deviation=deviation,
        chains=len(uniform),
    )


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
