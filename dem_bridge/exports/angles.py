"""From a wanted stiffness to the angle at which two cylinders have it, and how exactly that must be set."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.exports.parameters import EQUATION, origin
from dem_bridge.exports.table import Table, counts, numbers
from dem_bridge.geometry import Body
from dem_bridge.physics.hertz import AxisRatio, angle_of_stiffness, crossed_cylinders, stiffness_slope
from dem_bridge.scene import Scene

Floats = NDArray[np.float64]

#: relative error of stiffness that a tolerance of angles keeps
WITHIN = 0.01
#: degrees: of the curve where none are given
CURVE = (0.1, 0.2, 0.5, *(float(angle) for angle in range(1, 91)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Angles:
    """How to set cylinders for a profile of stiffness, ``(n,)`` all. Made by :func:`angles_for`."""

    stiffness: Floats
    """Wanted, N/m^1.5."""
    angle: Floats
    """To be set, degrees."""
    tolerance: Floats
    """Degrees: an angle that is off by no more has its stiffness to ``within``."""
    slope: Floats
    """d ln(stiffness)/d(angle), 1/degree; 0 at 90."""
    within: float


def angles_for(
    stiffness: float | Iterable[float],
    *,
    radius: float,
    youngs_modulus: float,
    poissons_ratio: float,
    law: AxisRatio = "exact",
    within: float = WITHIN,
) -> Angles:
    """Angles at which equal crossed cylinders have a wanted ``stiffness`` (N/m^1.5, one or ``(n,)``).

    ``radius`` in m, ``youngs_modulus`` in Pa; ``law``: "exact" (Hertz) or "paper" (eq. 3.1 of Chaunsali, Kim & Yang
    2018). The tolerance is how much smaller the angle may be for a stiffness higher by ``within``; the stiffness falls
    ever more slowly up to 90 degrees and rises again behind, so as much to the other side costs less. At small angles
    it is ``within`` over the slope, and at 90 degrees, where there is no slope, sqrt(3 within) in radians.

    Raises UsageError for what no such cylinders have: less than at 90 degrees, or no number.

    >>> found = angles_for([7.27e10, 2e10, 4.689197642511e9], radius=9e-3, youngs_modulus=72e9, poissons_ratio=0.17)
    >>> found.angle.round(3), found.tolerance.round(3)
    (array([ 1.648,  7.962, 90.   ]), array([0.019, 0.1  , 9.871]))
    """
    if not 0.0 < within < 1.0:
        raise UsageError(f"within = {within!r}; allowed: a number above 0 and below 1")
    wanted = [stiffness] if isinstance(stiffness, int | float) else list(stiffness)
    pair = Cylinders(radius=radius, youngs_modulus=youngs_modulus, poissons_ratio=poissons_ratio, law=law)
    found = []
    for k, one in enumerate(wanted):
        try:
            found.append((one, *pair.angle(one, within)))
        except ValueError as error:
            raise UsageError(f"stiffness[{k}] cannot be had: {error}") from None
    columns = np.array(found, dtype=float).reshape(-1, 4).T
    return Angles(stiffness=columns[0], angle=columns[1], tolerance=columns[2], slope=columns[3], within=within)


@dataclass(frozen=True, kw_only=True)
class Cylinders:
    """Two that are alike; UsageError for what is none."""

    radius: float
    """m."""
    youngs_modulus: float
    """Pa."""
    poissons_ratio: float
    law: AxisRatio

    def __post_init__(self) -> None:
        try:
            self.stiffness(90.0, self.law)
        except ValueError as error:
            raise UsageError(str(error)) from None

    def are(self, bodies: Iterable[Body]) -> bool:
        """Whether all have this radius and material."""
        elastic = {"young": self.youngs_modulus, "poisson": self.poissons_ratio}
        return all(body.radius == self.radius and body.material.elastic == elastic for body in bodies)

    def stiffness(self, angle: float, law: AxisRatio) -> float:
        """N/m^1.5, at an angle in degrees."""
        elastic = {"young": self.youngs_modulus, "poisson": self.poissons_ratio}
        return crossed_cylinders(angle=angle, radius=self.radius, law=law, **elastic).stiffness

    def angle(self, stiffness: float, within: float) -> tuple[float, float, float]:
        """Angle and its tolerance (degrees) and the slope there; ValueError for a stiffness that there is not."""
        elastic = {"radius": self.radius, "young": self.youngs_modulus, "poisson": self.poissons_ratio}
        found, below = (
            angle_of_stiffness(one, law=self.law, **elastic) for one in (stiffness, stiffness * (1.0 + within))
        )
        return found, found - below, stiffness_slope(found, law=self.law)


def _cylinders(scene: Scene, given: dict[str, float | None], law: AxisRatio | None) -> Cylinders:
    """What is given, and the rest as the scene's first two cylinders in touch have it."""
    known: dict[str, float] = {}
    geometry = scene.geometry
    if geometry is not None:
        crossed = [
            k for k, (one, other) in enumerate(pairwise(geometry.bodies)) if one.shape == other.shape != "sphere"
        ]
        law = law or geometry.law
        if crossed:
            body = geometry.bodies[crossed[0]]
            known = {
                "radius": body.radius,
                "youngs_modulus": body.material.youngs_modulus,
                "poissons_ratio": body.material.poissons_ratio,
            }
    known |= {key: value for key, value in given.items() if value is not None}
    if missing := [key for key in given if key not in known]:
        raise UsageError(
            f"{scene.name} has no two cylinders that cross, and {', '.join(missing)} not given; allowed: a scene that"
            f" has, or all of {', '.join(given)}"
        )
    return Cylinders(law=law or "exact", **known)


def angles(
    scene: Scene,
    *,
    law: AxisRatio | None = None,
    radius: float | None = None,
    youngs_modulus: float | None = None,
    poissons_ratio: float | None = None,
    within: float = WITHIN,
) -> Table:
    """How to set the cylinders of a chain for its stiffness, contact by contact, as :func:`angles_for` has it.

    ``law``, None: that of the scene, or "exact"; the cylinders are those of the scene where none are given.
    """
    if not 0.0 < within < 1.0:
        raise UsageError(f"within = {within!r}; allowed: a number above 0 and below 1")
    given = {"radius": radius, "youngs_modulus": youngs_modulus, "poissons_ratio": poissons_ratio}
    pair, links = _cylinders(scene, given, law), len(scene.stiffness)
    own = all(value is None for value in given.values())
    geometry, exponent = scene.geometry, scene.contacts.exponent
    rows: list[tuple[float | None, ...]] = []
    reasons: dict[str, list[int]] = {}
    for k, stiffness in enumerate(scene.stiffness):
        why = None
        if geometry is not None and "sphere" in (geometry.bodies[k].shape, geometry.bodies[k + 1].shape):
            why = "a sphere has no angle"
        elif geometry is not None and own and not pair.are(geometry.bodies[k : k + 2]):
            why = "its two cylinders are not those that the table is of"
        elif exponent[k] != 2.5 or scene.law is not None:
            why = "only Hertz' law, n = 2.5, has angles"
        else:
            try:
                rows.append(pair.angle(stiffness, within))
            except ValueError as error:
                why = str(error)
        if why is not None:
            reasons.setdefault(why, []).append(k)
            rows.append((None, None, None))
    notes = [f"contact {_listed(which)}: {why}" for why, which in reasons.items()]
    if not any(row[0] is not None for row in rows):
        raise UsageError(f"{scene.name} has no contact with an angle; {'; '.join(notes) or 'it has none at all'}")
    angle, tolerance, slope = zip(*rows, strict=True)
    return Table(
        id="angles",
        title=f"Angles to set for the stiffness of {scene.name}",
        columns=(
            counts("contact", "contact", range(links)),
            numbers("stiffness", "stiffness", "N/m^(n-1)", scene.stiffness),
            numbers("angle", "angle", "deg", angle),
            numbers("tolerance", f"tolerance for {100.0 * within:g} %", "deg", tolerance, digits=3),
            numbers("stiffness_slope", "d ln(stiffness)/d(angle)", "1/deg", slope, digits=4),
        ),
        notes=(
            f"cylinders of radius {pair.radius!r} m, Young's modulus {pair.youngs_modulus!r} Pa, Poisson's ratio"
            f" {pair.poissons_ratio!r}, by the {pair.law} law",
            f"an angle off by no more than the tolerance, to either side, has its stiffness to {100.0 * within:g} %",
            *notes,
        ),
        provenance=origin(scene) | {"law": pair.law, "within": within},
    )


def stiffness_curve(
    scene: Scene,
    *,
    angles: Sequence[float] | None = None,
    radius: float | None = None,
    youngs_modulus: float | None = None,
    poissons_ratio: float | None = None,
) -> Table:
    """Stiffness of two of the scene's cylinders against their angle (``angles``, degrees), by both laws."""
    given = {"radius": radius, "youngs_modulus": youngs_modulus, "poissons_ratio": poissons_ratio}
    pair, at = _cylinders(scene, given, "exact"), CURVE if angles is None else tuple(angles)
    if len(at) == 0:
        raise UsageError("angles = []; allowed: one or more, above 0 and up to 90 degrees")
    try:
        paper, exact = ([pair.stiffness(angle, law) for angle in at] for law in ("paper", "exact"))
    except (TypeError, ValueError) as error:
        raise UsageError(str(error)) from None
    return Table(
        id="stiffness-curve",
        title=f"Stiffness against angle for cylinders as in {scene.name}",
        columns=(
            numbers("angle", "angle", "deg", at),
            numbers("stiffness_paper", "stiffness by eq. 3.1", "N/m^1.5", paper),
            numbers("stiffness_exact", "stiffness by Hertz' exact law", "N/m^1.5", exact),
            numbers("paper_over_exact", "eq. 3.1 over exact", "", [p / e for p, e in zip(paper, exact, strict=True)]),
            numbers("slope_paper", "d ln(stiffness)/d(angle), eq. 3.1", "1/deg", [_slope(one, "paper") for one in at]),
            numbers("slope_exact", "d ln(stiffness)/d(angle), exact", "1/deg", [_slope(one, "exact") for one in at]),
        ),
        notes=(
            f"cylinders of radius {pair.radius!r} m, Young's modulus {pair.youngs_modulus!r} Pa, Poisson's ratio"
            f" {pair.poissons_ratio!r}",
            EQUATION,
        ),
        provenance=origin(scene),
    )


def _listed(places: Sequence[int]) -> str:
    """
    >>> _listed([0, 2, 3, 4, 7])
    '0, 2 to 4, 7'
    """
    ends = np.flatnonzero(np.diff(places, append=np.inf) != 1).tolist()
    runs = zip([0, *(end + 1 for end in ends[:-1])], ends, strict=True)
    return ", ".join(f"{places[one]}" if one == last else f"{places[one]} to {places[last]}" for one, last in runs)


def _slope(angle: float, law: AxisRatio) -> float:
    return stiffness_slope(angle, law=law)
