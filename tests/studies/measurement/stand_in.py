"""Print how often right and wrong models are excluded, for a stand-in of a simulation whose values are linear.

``python -m tests.studies.measurement.stand_in``. There are two more values than parameters, and their errors are one
percent of the effect of a parameter, so that the covariance of the parameters decides. The comparison is that of
the study; beside it stands a covariance from 100 or 400 samples (Latin hypercube) that is taken for exact.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import binomtest, chi2, norm, qmc

from dem_bridge.studies.measurement.comparison import Whitening, deviations_of
from dem_bridge.trajectory.trajectory import Floats
from tests.studies.measurement.test_joint import NOISE, compared

RIGHT, WRONG = 400, 100


def share(missed: int, models: int) -> str:
    """Return a share with its 95 % binomial interval."""
    low, high = binomtest(missed, models).proportion_ci(0.95)
    return f"{100 * missed / models:.1f} % ({100 * low:.1f} to {100 * high:.1f} %)"


def by_samples(slopes: Floats, error: Floats, samples: int, seed: int) -> bool:
    """Return whether a covariance from samples that is taken for exact excludes the errors."""
    sampler = qmc.LatinHypercube(d=slopes.shape[1], rng=np.random.default_rng(seed))
    changes = norm.ppf(sampler.random(samples)) @ slopes.T
    spread = (changes - changes.mean(axis=0)) / np.sqrt(samples - 1.0)
    whitened = Whitening(np.full(len(error), NOISE), spread.T)(error)
    return deviations_of(float(chi2.sf(np.sum(whitened**2), len(error)))) > 2.0


def main() -> None:
    """Print the table of docs/measurement.md."""
    for count in (1, 5, 20, 40):
        random = np.random.default_rng(count)
        slopes = random.standard_normal((count + 2, count))
        missed, sampled = 0, np.zeros(2, dtype=int)
        for nth in range(RIGHT):
            found = compared(slopes, random.standard_normal(count), random.standard_normal(count + 2))
            missed += found.joint().deviations > 2.0
            sampled += [by_samples(slopes, found.error, samples, nth) for samples in (100, 400)]
        print(
            f"{count} parameters, right models excluded: {share(missed, RIGHT)}; covariance from 100 samples", end=" "
        )
        print(" and from 400 ".join(share(int(number), RIGHT) for number in sampled), flush=True)
        wrong = {"one parameter by 3": 0, "one parameter by 6": 0, "spread twice": 0, "errors twice": 0}
        first = np.eye(count)[0]
        for _ in range(WRONG):
            deviates, noise = random.standard_normal(count), random.standard_normal(count + 2)
            cases = (
                (deviates + 3 * first, noise),
                (deviates + 6 * first, noise),
                (2 * deviates, noise),
                (deviates, 2 * noise),
            )
            for name, case in zip(wrong, cases, strict=True):
                wrong[name] += compared(slopes, *case).joint().deviations > 2.0
        print(f"{count} parameters, of {WRONG} wrong models excluded: {wrong}", flush=True)


if __name__ == "__main__":
    main()
