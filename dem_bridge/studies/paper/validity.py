"""Validity of the model: whether each contact of a chain satisfies the assumptions of Hertz' law and of lumped masses.

Forces are the peak forces of the run, and times are those of a collision of two bodies with that force. Ellipses and
pressures follow from the exact Hertz law, also where the chain's stiffness follows another law.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from dem_bridge.physics.exact import two_body_collision
from dem_bridge.physics.validity import (
    Validity,
    edge_tension,
    ellipse_on_body,
    no_cracking,
    no_crushing,
    quasi_static,
    weightless,
)
from dem_bridge.report.columns import DEGREE, GIGAPASCAL, HERTZ_STIFFNESS, MILLIMETRE, NEWTON, PERCENT, Column
from dem_bridge.report.study import Table
from dem_bridge.scene.geometry import Geometry
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.model_hierarchy.model_terms import GRAVITY
from dem_bridge.studies.paper import PAPER
from dem_bridge.studies.paper.runs import Runs
from dem_bridge.trajectory.trajectory import Trajectory

CONTACTS_COLUMNS = (
    "contact", Column("angle", DEGREE), Column("stiffness by eq. 3.1", HERTZ_STIFFNESS),
    Column("exact", HERTZ_STIFFNESS), Column("too stiff by", PERCENT), Column("peak force", NEWTON),
    Column("semi-major axis", MILLIMETRE), "over half-height", Column("peak pressure", GIGAPASCAL),
    "over compressive strength", "edge tension over tensile strength", "contact time over sound's",
    "static over peak force",
)  # fmt: skip


#: columns that are judged, in the order of :attr:`ContactValidity.judged`, with the assumption they stand for
JUDGED = {
    "over half-height": "the ellipse ends on the body",
    "over compressive strength": "the contact is not crushed",
    "edge tension over tensile strength": "no crack opens",
    "contact time over sound's": "the body acts as one mass",
    "static over peak force": "weight does not matter",
}
#: the one of them that should be large
LEAST = "contact time over sound's"


@dataclass(frozen=True, kw_only=True)
class ContactValidity:
    """Hold the state of one contact at its peak force, and which assumptions hold."""

    contact: int
    angle: float
    """Degrees; nan: not two cylinders."""
    by_paper: float
    """Stiffness by eq. 3.1, N/m^1.5."""
    exact: float
    """Stiffness by Hertz' exact solution, N/m^1.5."""
    force: float
    """N."""
    semi_major: float
    """m."""
    pressure: float
    """Pa, in the middle of the ellipse."""
    closing: float
    """m/s, with which two such bodies collide so that the contact has this force."""
    sound: float
    """m/s, of sound along a bar of the material."""
    size: float
    """m, the diameter that sound crosses."""
    judged: tuple[Validity, ...]
    """In the order of :data:`JUDGED`."""

    @property
    def too_stiff(self) -> float:
        """Return the stiffness by eq. 3.1 over the exact one, less 1."""
        return self.by_paper / self.exact - 1.0

    @property
    def crossing(self) -> float:
        """Return the time that sound takes across a cylinder, s; of a sphere, across one of its radius."""
        return self.size / self.sound

    @property
    def vibration(self) -> float:
        """Return the part of the energy that a collision leaves in vibration.

        It is 1.04 (v/c)^(3/5) for a sphere on a half-space (Hunter 1957; Johnson 1985, section 11.4).
        """
        return 1.04 * float((self.closing / self.sound) ** 0.6)

    @property
    def over_half_height(self) -> float:
        """Return the semi-major axis of the contact ellipse over half the height of the body."""
        return self.judged[0].ratio

    @property
    def row(self) -> tuple[float, ...]:
        """Return the numbers of :data:`CONTACTS_COLUMNS`, in SI."""
        on_body, crushing, cracking, statics, weighing = (item.ratio for item in self.judged)
        first = (float(self.contact), self.angle, self.by_paper, self.exact, self.too_stiff, self.force)
        sizes = (self.semi_major, on_body, self.pressure)
        return (*first, *sizes, crushing, cracking, statics, weighing)


def contact_validity(scene: Scene, run: Trajectory, k: int) -> ContactValidity:
    """Return the state of contact k of a scene with a geometry, at its peak force in the run."""
    geometry = scene.geometry
    assert geometry is not None  # see contacts_of
    items, other, angle = geometry.bodies[k], geometry.bodies[k + 1], geometry.angle[k]
    contact = geometry.contact(k)
    material, force = other.material, float(run.peak_force[k])
    by_paper = geometry.contact(k, "paper").stiffness
    major, _ = contact.semi_axes(force)
    pressure = contact.peak_pressure(force)
    half = min(0.5 * body.height if body.height is not None else body.radius for body in (items, other))
    # the collision of these two bodies that has this force, and its duration
    reduced = scene.mass[k] * scene.mass[k + 1] / (scene.mass[k] + scene.mass[k + 1])
    overlap = contact.overlap(force)
    closing = (2.0 * contact.stiffness * overlap**2.5 / (2.5 * reduced)) ** 0.5
    time = two_body_collision(
        masses=(scene.mass[k], scene.mass[k + 1]), velocities=(closing, 0.0), stiffness=contact.stiffness, exponent=2.5
    ).contact_time
    weight = GRAVITY * sum(scene.mass[: k + 1])
    tension = edge_tension(pressure, poisson=material.poissons_ratio, axis_ratio=contact.axis_ratio)
    return ContactValidity(
        contact=k,
        angle=float("nan") if angle is None else angle,
        by_paper=by_paper,
        exact=contact.stiffness,
        force=force,
        semi_major=major,
        pressure=pressure,
        closing=closing,
        sound=math.sqrt(material.youngs_modulus / material.density),
        size=2.0 * other.radius,
        judged=(
            ellipse_on_body(major, half_height=half),
            no_crushing(pressure),
            no_cracking(tension),
            quasi_static(time, size=2.0 * other.radius, young=material.youngs_modulus, density=material.density),
            weightless(weight, force),
        ),
    )


def contacts_of(runs: Runs, names: Iterable[str]) -> Iterable[tuple[Scene, list[ContactValidity]]]:
    """Yield the scenes whose bodies are of fused quartz and their contacts that carried a force."""
    for name in names:
        truth = runs.truth(name)
        if truth is None:
            continue
        scene = runs.scenes[name]
        if _of_quartz(scene.geometry) and set(scene.contacts.exponent.tolist()) == {2.5}:
            links = scene.n_body - 1
            reached = [k for k in range(links) if truth.peak_force[k] > 0.0]
            yield scene, [contact_validity(scene, truth, k) for k in reached]


def _of_quartz(geometry: Geometry | None) -> bool:
    """Return True for bodies of fused quartz, the only material of known strength."""
    return geometry is not None and {body.material.name for body in geometry.bodies} == {"fused quartz"}


def contacts_table(runs: Runs, name: str) -> Table | None:
    """Return the table of every contact of one chain; None where it has no geometry or no run."""
    for scene, contacts in contacts_of(runs, [name]):
        rows = [contact.row for contact in contacts]
        return replace(PAPER.table("contacts", CONTACTS_COLUMNS, rows, chain=scene.name), id=f"contacts-{scene.name}")
    return None


def scenes_table(runs: Runs, names: Iterable[str]) -> Table:
    """Return the worst contact of each scene for each assumption, and in how many contacts it fails."""
    rows = []
    for scene, contacts in contacts_of(runs, names):
        row: list[str | float] = [scene.name]
        for place, name in enumerate(JUDGED):
            judged = [contact.judged[place] for contact in contacts]
            worst = (min if name == LEAST else max)(item.ratio for item in judged)
            row += [worst, f"{sum(not item.holds for item in judged)} of {len(contacts)}"]
        rows.append((*row, max(contact.too_stiff for contact in contacts)))
    names = [f"{name}, {'least' if name == LEAST else 'largest'}" for name in JUDGED]
    pairs = (text for name in names for text in (name, "fails in"))
    columns = ("scene", *pairs, Column("eq. 3.1 too stiff by, largest", PERCENT))
    return PAPER.table("validity", columns, rows, assumptions="; ".join(JUDGED.values()))
