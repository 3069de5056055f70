"""Validity of the model: every contact of a chain beside the assumptions of Hertz' law and of lumped masses.

Forces are the peak forces of the run, times those of the collision of two bodies at that force; ellipses and pressures
follow from the exact Hertz law, whatever law the chain's stiffness is by.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from dem_bridge.geometry import Geometry
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
from dem_bridge.scene import Scene
from dem_bridge.studies.model_hierarchy.model_terms import GRAVITY
from dem_bridge.studies.paper.runs import Runs
from dem_bridge.studies.study import Table
from dem_bridge.trajectory import Trajectory

COLUMNS = (
    "contact",
    "angle (degrees)",
    "stiffness by eq. 3.1 (N/m^1.5)",
    "exact (N/m^1.5)",
    "too stiff by (%)",
    "peak force (N)",
    "semi-major axis (mm)",
    "over half-height",
    "peak pressure (GPa)",
    "over compressive strength",
    "edge tension over tensile strength",
    "contact time over sound's",
    "static over peak force",
)
#: columns that are judged, in the order of :attr:`ContactValidity.judged`, with the assumption they stand for
JUDGED = {
    "over half-height": "the ellipse ends on the body",
    "over compressive strength": "the contact is not crushed",
    "edge tension over tensile strength": "no crack opens",
    "contact time over sound's": "the body acts as one mass",
    "static over peak force": "weight does not matter",
}
#: the one of them that should be large
_LEAST = "contact time over sound's"


@dataclass(frozen=True, kw_only=True)
class ContactValidity:
    """One contact at its peak force, and which assumptions hold."""

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
    judged: tuple[Validity, ...]
    """In the order of :data:`JUDGED`."""

    @property
    def too_stiff(self) -> float:
        """Eq. 3.1 over the exact solution, less 1."""
        return self.by_paper / self.exact - 1.0

    @property
    def over_half_height(self) -> float:
        """Semi-major axis of the contact ellipse over half the height of the body."""
        return self.judged[0].ratio

    @property
    def row(self) -> tuple[float, ...]:
        """The numbers of :data:`COLUMNS`."""
        on_body, crushing, cracking, statics, weighing = (item.ratio for item in self.judged)
        first = (float(self.contact), self.angle, self.by_paper, self.exact, 100.0 * self.too_stiff, self.force)
        sizes = (1e3 * self.semi_major, on_body, 1e-9 * self.pressure)
        return (*first, *sizes, crushing, cracking, statics, weighing)


def contact_validity(scene: Scene, run: Trajectory, k: int) -> ContactValidity:
    """Contact k of a scene with a geometry, at its peak force in the run."""
    geometry = scene.geometry
    assert geometry is not None  # asked for by `validity_tables`
    items, other, angle = geometry.bodies[k], geometry.bodies[k + 1], geometry.angle[k]
    contact = geometry.contact(k)
    material, force = other.material, float(run.peak_force[k])
    by_paper = geometry.contact(k, "paper").stiffness
    major, _ = contact.semi_axes(force)
    pressure = contact.peak_pressure(force)
    half = min(0.5 * body.height if body.height is not None else body.radius for body in (items, other))
    # what collision of these two bodies would have this force, and how long it would last
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
        judged=(
            ellipse_on_body(major, half_height=half),
            no_crushing(pressure),
            no_cracking(tension),
            quasi_static(time, size=2.0 * other.radius, young=material.youngs_modulus, density=material.density),
            weightless(weight, force),
        ),
    )


def _known(runs: Runs, names: Iterable[str]) -> Iterable[tuple[Scene, list[ContactValidity]]]:
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
    """Strengths are known of that alone."""
    return geometry is not None and {body.material.name for body in geometry.bodies} == {"fused quartz"}


def contacts_table(runs: Runs, name: str) -> Table | None:
    """Every contact of one chain; None where it has no geometry or no run."""
    for scene, result in _known(runs, [name]):
        return Table(
            id=f"contacts-{scene.name}",
            title=f"Every contact of {scene.name} and what is assumed of it",
            caption=(
                "Ellipse, pressure and tension by the exact Hertz law at the peak force of the run. Ratios above 1"
                " break an assumption, but for the contact's time over that of sound across a body, which should be"
                " 10 or more, and the static force (weight above the contact), which should be below 0.1 of the peak."
                " Strengths are handbook values of fused quartz: 1.1 GPa in compression, 48 MPa in tension."
            ),
            columns=COLUMNS,
            rows=tuple(result.row for result in result),
        )
    return None


def scenes_table(runs: Runs, names: Iterable[str]) -> Table:
    """One line a scene: its worst contact for each assumption, and in how many it fails."""
    rows = []
    for scene, result in _known(runs, names):
        row: list[str | float] = [scene.name]
        for place, name in enumerate(JUDGED):
            judged = [result.judged[place] for result in result]
            worst = (min if name == _LEAST else max)(item.ratio for item in judged)
            row += [worst, f"{sum(not item.holds for item in judged)} of {len(result)}"]
        row.append(max(100.0 * result.too_stiff for result in result))
        rows.append(tuple(row))
    columns = [f"{name}, {'least' if name == _LEAST else 'largest'}" for name in JUDGED]
    return Table(
        id="validity",
        title="Validity of the model, scene by scene",
        caption=f"Worst contact, and in how many an assumption fails: {'; '.join(JUDGED.values())}. Of chains of"
        " fused quartz, whose strengths are taken.",
        columns=("scene", *(text for c in columns for text in (c, "fails in")), "eq. 3.1 too stiff by, largest (%)"),
        rows=tuple(rows),
    )
