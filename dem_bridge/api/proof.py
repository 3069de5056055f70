"""The public facade for proofs: enclose the motion of a scene, with a certificate that can be checked."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from dem_bridge.foundation.arguments import check_arguments
from dem_bridge.scene.file import scene_of
from dem_bridge.scene.scene import Scene

if TYPE_CHECKING:
    from dem_bridge.proof.proof import Proof


def prove(scene: Scene | str | Path, digits: int = 16, *, file: str | Path | None = None, anew: bool = False) -> Proof:
    """Prove the motion of a scene: balls that contain it at the sample times, and all touches in their order.

    The inputs are the doubles of the scene, taken as exact numbers. See :doc:`/theory/proof`.

    Parameters
    ----------
    scene : Scene, str or Path
        Scene, name of a shipped scene or path of a scene file. It may have walls, gaps, initial overlaps, gravity,
        precompression, any start velocities, and exponents n from 2 to 5 in steps of 1/2.
    digits : int
        Digits of the largest velocity that are wanted at the end, 1 to 60.
    file : str or Path, optional
        Certificate, which is written at each of some thirty checkpoints. If the file has an unfinished proof of the
        same scene, this is continued.
    anew : bool
        Whether a certificate that exists is replaced instead.

    Returns
    -------
    Proof

    Raises
    ------
    UnsupportedScene
        If the scene has a feature that cannot be proved; the message names it.
    BackendUnavailable
        If python-flint is not installed (extra ``proof``).
    UsageError
        If ``digits`` is out of range or needs too many bits, or ``file`` cannot be used.

    Examples
    --------
    >>> import dem_bridge as db
    >>> pair = db.Scene(name="pair", duration=1e-4, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(0.5, 0.0), gap=1e-6)
    >>> proof = db.prove(pair)
    >>> proof.velocity[-1].tolist(), bool((proof.velocity_radius <= 1e-16).all())
    ([0.0, 0.5], True)
    >>> [(touch.contact, touch.closes, f"{float(touch.time[0]):.9e}") for touch in proof.touches]
    [(0, True, '2.000000000e-06'), (0, False, '6.605674674e-05')]
    """
    check_arguments(prove, locals())
    from dem_bridge.proof.proof import checked_digits, prove_scene  # an extra

    return prove_scene(scene_of(scene), checked_digits(digits), None if file is None else Path(file), anew=anew)
