"""The public facade for many chains that differ in numbers only."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from dem_bridge.foundation.arguments import check_arguments
from dem_bridge.runs.store import Store
from dem_bridge.scene.file import scene_of
from dem_bridge.scene.scene import Scene

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from dem_bridge.ensembles.result import Ensemble
    from dem_bridge.runs.campaign import Progress


def ensemble(
    scene: Scene | str | Path,
    vary: Mapping[str, float],
    n: int = 10_000,
    seed: int = 0,
    *,
    accuracy: float = 1e-4,
    samples: int | None = None,
    sampler: str = "random",
    checks: int = 4,
    executor: Executor | None = None,
    progress: Progress | None = None,
    store: bool | str | Path = True,
) -> Ensemble:
    """Solve many chains that differ from a scene in numbers only, drawn at random.

    The chains are solved side by side in compiled batches on all cores, by the order-4 method of "blanes-moan" with
    corrected touches, with the fewest steps for the accuracy. A seeded sample of them is also solved by the reference
    and by LAMMPS.

    Parameters
    ----------
    scene : Scene, str or Path
        Intended chain: a scene, the name of a shipped scene or the path of a scene file.
    vary : mapping
        What varies, each by normal deviates: "angle" (standard deviation of each angle between cylinders, degrees),
        "mass", "stiffness", "velocity" (relative standard deviations) and "gap" (standard deviation of what is added
        to each gap, m; only its magnitude counts).
    n : int
        Number of chains. The memory in use does not grow with it: large results are files in a temporary folder.
    seed : int
        Seed. The first chains of a larger ensemble with the same seed are the same.
    accuracy : float
        Accuracy of arrival, crossing and residence times, peak velocities and peak forces, each relative to its own
        value; with ``samples`` also of velocities, relative to the largest of the chain.
    samples : int, optional
        Number of equal intervals at whose ends the velocities of all chains are kept. None: none are kept.
    sampler : {"random", "sobol"}
        Independent draws, or the scrambled Sobol' sequence (Owen 1998, *J. Complexity* 14, 466).
    checks : int
        Number of chains that the reference and LAMMPS solve, too.
    executor : concurrent.futures.Executor, optional
        Where blocks of chains are solved. None: threads on all cores. The results do not depend on it.
    progress : callable, optional
        Function that is called with (done, total, label).
    store : bool, str or Path
        Where runs of the sample are kept, as in :func:`dem_bridge.verify`.

    Returns
    -------
    Ensemble
        ``table`` (a pandas frame, a row for each chain), ``long_table``, ``to_xarray()``, ``quantiles(observable)``
        and ``checked``, the agreement of the sample.

    Raises
    ------
    UsageError
        For a setting out of its range.
    UnsupportedScene
        For a scene with forces that depend on velocities, adhesion, a drive or a law of its own; for "angle" in a
        scene without angles.
    RunBroken
        If a velocity is not finite.

    References
    ----------
    Blanes & Moan (2002), *J. Comput. Appl. Math.* 142, 313.

    Examples
    --------
    >>> import dem_bridge as db
    >>> chains = db.ensemble("decelerating-40", vary={"angle": 0.5}, n=16, checks=0)
    >>> chains.table.shape, chains.quantiles("arrival_at_end").shape
    ((16, 163), (3,))
    """
    check_arguments(ensemble, locals())
    from dem_bridge.ensembles.draw import Variation
    from dem_bridge.ensembles.run import run_ensemble

    variation = Variation(scene=scene_of(scene), vary=dict(vary), seed=seed, sampler=sampler)
    return run_ensemble(
        variation,
        n,
        accuracy=accuracy,
        samples=samples,
        checks=checks,
        executor=executor,
        store=Store.opened(store),
        progress=progress,
    )
