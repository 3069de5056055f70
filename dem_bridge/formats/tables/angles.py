"""Angles at which crossed cylinders have a required stiffness, and how accurately the angles must be set."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.formats.tables.parameters import NOTES, origin
from dem_bridge.formats.tables.table import Table, tabulate
from dem_bridge.foundation.arguments import check_arguments
from dem_bridge.foundation.numbers import check_number
from dem_bridge.physics.hertz import AxisRatio, angle_of_stiffness, crossed_cylinders, stiffness_slope
from dem_bridge.scene.geometry import Body
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats

#: default relative tolerance of the stiffness; the tolerance of an angle follows from it
WITHIN = 0.01
_LAWS: tuple[AxisRatio, ...] = ("paper", "exact")
#: default angles of the stiffness curve, degrees
CURVE = (0.1, 0.2, 0.5, *(float(angle) for angle in range(1, 91)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Angles:
    """Hold the contact angles of a profile of stiffness; every array has the shape ``(n,)``.

    :func:`angles_for` returns an instance.
    """

    stiffness: Floats
    """Required contact stiffness, N/m^1.5."""
    angle: Floats
    """Angle between the axes of the two cylinders, degrees."""
    tolerance: Floats
    """Largest error of the angle, degrees, for which the relative error of the stiffness is at most ``within``."""
    slope: Floats
    """Derivative d ln(stiffness)/d(angle), 1/degree; 0 at 90 degrees."""
    within: float
    """Relative tolerance of the stiffness."""


def angles_for(
    stiffness: float | Iterable[float],
    *,
    radius: float,
    youngs_modulus: float,
    poissons_ratio: float,
    law: AxisRatio = "exact",
    within: float = WITHIN,
) -> Angles:
    """Return the angles at which two equal crossed cylinders have a required contact stiffness.

    Parameters
    ----------
    stiffness : float or iterable of float
        Required stiffness beta of the contact, N/m^1.5; one value or ``(n,)`` values.
    radius : float
        Radius of both cylinders, m.
    youngs_modulus : float
        Young's modulus of both cylinders, Pa.
    poissons_ratio : float
        Poisson's ratio of both cylinders.
    law : {"exact", "paper"}
        "exact" is the contact law of Hertz; "paper" is eq. 3.1 of [1]_ with its approximate axis ratio.
    within : float
        Relative tolerance of the stiffness, above 0 and below 1.

    Returns
    -------
    Angles
        Angles, tolerances and slopes. The tolerance is the decrease of the angle that raises the stiffness by
        ``within``. The stiffness decreases up to 90 degrees with an ever smaller slope, so an equal increase of the
        angle changes it less. At small angles the tolerance is ``within`` divided by the slope; at 90 degrees, where
        the slope is zero, it is sqrt(3 ``within``) in radians.

    Raises
    ------
    UsageError
        If a stiffness is not a finite positive number or is below that at 90 degrees, or ``within`` or a property of
        the cylinders is out of its range.

    References
    ----------
    .. [1] R. Chaunsali, E. Kim and J. Yang (2018), eq. 3.1.

    Examples
    --------
    >>> solution = angles_for([7.27e10, 2e10, 4.689197642511e9], radius=9e-3, youngs_modulus=72e9, poissons_ratio=0.17)
    >>> solution.angle.round(3), solution.tolerance.round(3)
    (array([ 1.648,  7.962, 90.   ]), array([0.019, 0.1  , 9.871]))
    """
    check_arguments(angles_for, locals())
    check_number("within", within, "a number above 0 and below 1", above=0.0, below=1.0)
    required = [stiffness] if not isinstance(stiffness, Iterable) else list(stiffness)
    pair = Cylinders(radius=radius, youngs_modulus=youngs_modulus, poissons_ratio=poissons_ratio, law=law)
    solutions = []
    for k, value in enumerate(required):
        try:
            solutions.append((value, *pair.angle(value, within)))
        except ValueError as error:
            raise UsageError(f"stiffness[{k}] is not possible with these cylinders: {error}") from None
    columns = np.array(solutions, dtype=float).reshape(-1, 4).T
    return Angles(stiffness=columns[0], angle=columns[1], tolerance=columns[2], slope=columns[3], within=within)


@dataclass(frozen=True, kw_only=True)
class Cylinders:
    """Describe two equal crossed cylinders; raise UsageError where a property is out of its range."""

    radius: float
    """Radius, m."""
    youngs_modulus: float
    """Young's modulus, Pa."""
    poissons_ratio: float
    law: AxisRatio
    """Law of the stiffness, "exact" or "paper"."""

    def __post_init__(self) -> None:
        try:
            self.stiffness(90.0, self.law)
        except ValueError as error:
            raise UsageError(str(error)) from None

    def __str__(self) -> str:
        modulus, ratio = f"Young's modulus {self.youngs_modulus!r} Pa", f"Poisson's ratio {self.poissons_ratio!r}"
        return f"cylinders of radius {self.radius!r} m, {modulus}, {ratio}"

    @property
    def properties(self) -> dict[str, float]:
        """Return the radius and the elastic properties."""
        return {"radius": self.radius, "young": self.youngs_modulus, "poisson": self.poissons_ratio}

    def are(self, bodies: Iterable[Body]) -> bool:
        """Return True if all bodies have this radius, Young's modulus and Poisson's ratio."""
        return all({"radius": body.radius, **body.material.elastic} == self.properties for body in bodies)

    def stiffness(self, angle: float, law: AxisRatio) -> float:
        """Return the stiffness, N/m^1.5, at an angle in degrees."""
        return crossed_cylinders(angle=angle, law=law, **self.properties).stiffness

    def angle(self, stiffness: float, within: float) -> tuple[float, float, float]:
        """Return the angle and its tolerance, degrees, and the slope there; raise ValueError if no angle fits."""
        targets = (stiffness, stiffness * (1.0 + within))
        angle, stiffer = (angle_of_stiffness(beta, law=self.law, **self.properties) for beta in targets)
        return angle, angle - stiffer, stiffness_slope(angle, law=self.law)


def _cylinders(scene: Scene, law: AxisRatio | None, settings: Mapping[str, float | None]) -> Cylinders:
    """Return the cylinders of a table: properties set by the caller, others from the scene's first crossed pair."""
    names = ("radius", "youngs_modulus", "poissons_ratio")
    properties: dict[str, float] = {}
    if (geometry := scene.geometry) is not None:
        law = law or geometry.law
        crossed = (left for left, right in pairwise(geometry.bodies) if left.shape == right.shape != "sphere")
        if body := next(crossed, None):
            elastic = (body.material.youngs_modulus, body.material.poissons_ratio)
            properties = dict(zip(names, (body.radius, *elastic), strict=True))
    properties |= {key: value for key, value in settings.items() if value is not None}
    if missing := [key for key in names if key not in properties]:
        raise UsageError(
            f"{scene.name} has no two crossed cylinders, and {', '.join(missing)} not given; allowed: a scene with"
            f" crossed cylinders, or values for all of {', '.join(names)}"
        )
    return Cylinders(law=law or "exact", **properties)


def angles(scene: Scene, *, law: AxisRatio | None = None, within: float = WITHIN, **cylinders: float | None) -> Table:
    """Return the table of the angles at which a chain's contacts have their stiffness (see :func:`angles_for`).

    ``law`` None is the law of the scene's geometry, or "exact" without one. ``cylinders`` are properties of
    :class:`Cylinders`; one that is missing or None is that of the scene's first crossed pair.
    """
    check_number("within", within, "a number above 0 and below 1", above=0.0, below=1.0)
    pair = _cylinders(scene, law, cylinders)
    scene_cylinders = all(value is None for value in cylinders.values())
    geometry, exponent = scene.geometry, scene.contacts.exponent
    rows: list[tuple[float | None, ...]] = []
    reasons: dict[str, list[int]] = {}
    for k, stiffness in enumerate(scene.stiffness):
        reason = None
        if geometry is not None and "sphere" in (geometry.bodies[k].shape, geometry.bodies[k + 1].shape):
            reason = "a sphere has no angle"
        elif geometry is not None and scene_cylinders and not pair.are(geometry.bodies[k : k + 2]):
            reason = "its cylinders differ from those of this table in radius or material"
        elif exponent[k] != 2.5 or scene.law is not None:
            reason = "an angle follows only from Hertz' law, n = 2.5"
        else:
            try:
                rows.append(pair.angle(stiffness, within))
            except ValueError as error:
                reason = str(error)
        if reason is not None:
            reasons.setdefault(reason, []).append(k)
            rows.append((None, None, None))
    notes = [f"contact {_listed(indices)}: {reason}" for reason, indices in reasons.items()]
    if not any(row[0] is not None for row in rows):
        raise UsageError(
            f"{scene.name} has no contact with an angle; {'; '.join(notes) or 'the scene has no contacts'}"
        )
    values: dict[str, Any] = {"contact": range(len(rows)), "stiffness": scene.stiffness}
    values |= zip(("angle", "tolerance", "stiffness_slope"), zip(*rows, strict=True), strict=True)
    percent = f"{100.0 * within:g} %"
    return tabulate(
        "angles",
        values,
        details={"tolerance": {"heading": f"angle tolerance for {percent} of stiffness"}},
        title=f"Contact angles that give the stiffness of {scene.name}",
        notes=(
            f"{pair}; stiffness by the {pair.law} law",
            "with an error of the angle up to the tolerance, of either sign, the stiffness is off by at most"
            f" {percent}",
            *notes,
        ),
        provenance=origin(scene) | {"law": pair.law, "within": within},
    )


def stiffness_curve(scene: Scene, *, angles: Sequence[float] | None = None, **cylinders: float | None) -> Table:
    """Return the table of the stiffness of two crossed cylinders against their angle (degrees), by both laws.

    ``cylinders`` are as in :func:`angles`.
    """
    pair, angle_grid = _cylinders(scene, "exact", cylinders), CURVE if angles is None else tuple(angles)
    if len(angle_grid) == 0:
        raise UsageError("angles = []; allowed: one or more angles above 0 and up to 90 degrees")
    values: dict[str, Any] = {"angle": angle_grid}
    try:
        for law in _LAWS:
            values[f"stiffness_{law}"] = np.array([pair.stiffness(angle, law) for angle in angle_grid])
            values[f"slope_{law}"] = [stiffness_slope(angle, law=law) for angle in angle_grid]
    except (TypeError, ValueError) as error:
        raise UsageError(str(error)) from None
    values["paper_over_exact"] = values["stiffness_paper"] / values["stiffness_exact"]
    title, notes = f"Stiffness against angle for the cylinders of {scene.name}", (str(pair), NOTES["equation"])
    return tabulate("stiffness-curve", values, title=title, notes=notes, provenance=origin(scene))


def _listed(indices: Sequence[int]) -> str:
    """Return the indices as text, with runs of three and more shortened.

    >>> _listed([0, 2, 3, 4, 7])
    '0, 2 to 4, 7'
    """
    ends = np.flatnonzero(np.diff(indices, append=np.inf) != 1).tolist()
    runs = zip([0, *(end + 1 for end in ends[:-1])], ends, strict=True)
    return ", ".join(
        f"{indices[first]}" if first == last else f"{indices[first]} to {indices[last]}" for first, last in runs
    )
