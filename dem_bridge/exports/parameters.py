"""Tables of what a scene is made of: its contacts, its bodies, and what LAMMPS is told of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.base import Resolution
from dem_bridge.backends.bca import no_single_pulse
from dem_bridge.backends.prescan import Prescan
from dem_bridge.backends.steps import radius_of
from dem_bridge.backends.tabled import prescan_scene
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.exports.table import Column, Table, barred, counts, numbers, texts
from dem_bridge.lmp.coefficients import Laws, laws, line_order, pairs, refusal
from dem_bridge.lmp.encoding import Types, body_types
from dem_bridge.lmp.pairing import granular
from dem_bridge.physics.exact import two_body_collision
from dem_bridge.scene import DAMPING_LAWS, Scene
from dem_bridge.trajectory import Trajectory
from dem_bridge.version import FORM_DATE, __version__

Floats = NDArray[np.float64]

NO_GEOMETRY = (
    "the scene does not say what its bodies are: shapes, sizes, angles, laws of stiffness, ellipses and pressures are"
    " not known; a scene in physical form has them"
)

EQUATION = "eq. 3.1 is that of Chaunsali, Kim & Yang (2018), with its approximate axis ratio of the contact ellipse"


def origin(scene: Scene, run: Trajectory | None = None) -> dict[str, Any]:
    """Provenance of a table of a scene, and of the run in it."""
    found: dict[str, Any] = {"scene": scene.name, "scene_hash": scene.content_hash, "dem_bridge": __version__}
    if run is not None:
        found |= {key: run.provenance[key] for key in ("backend", "settings", "versions") if key in run.provenance}
    return found


@dataclass(frozen=True, kw_only=True)
class _Told:
    """What a deck of the scene says of contacts; arrays along the line of atoms, walls included."""

    scene: Scene
    resolution: Resolution

    @cached_property
    def prescan(self) -> Prescan:
        return prescan_scene(self.scene)

    @cached_property
    def radius(self) -> float:
        """m."""
        deepest, radius = self.deepest, radius_of(self.scene, self.resolution, self.prescan)
        if radius < deepest:
            raise UsageError(
                f"surrogate_radius = {radius:g} m; allowed: more than the largest overlap, {deepest:.3g} m"
            )
        return radius

    @property
    def deepest(self) -> float:
        """Largest overlap of all, m."""
        return float(np.max(self.prescan.peak_overlap, initial=0.0))

    @cached_property
    def laws(self) -> Laws:
        return laws(self.scene)

    @cached_property
    def types(self) -> Types:
        return body_types(self.laws.where, self.resolution.types)

    @cached_property
    def place(self) -> NDArray[np.int64]:
        """Place along the line of each contact of the scene; it joins the atoms there and one further."""
        return np.argsort(line_order(self.scene))

    @property
    def first(self) -> int:
        """Place of body 0."""
        return int(self.scene.wall_left is not None)

    def coefficients(self, law: int) -> tuple[str, float, float]:
        """Model, stiffness and damping of ``pair_style granular``, as they stand behind ``pair_coeff I J``."""
        model, stiffness, damping = self.laws.coefficients(law, self.radius).split()[:3]
        return model, float(stiffness), float(damping)


def _unit_of(models: Sequence[str | None]) -> str:
    """Of the stiffness behind ``pair_coeff``."""
    found = {"hertz": "N/m^2", "hooke": "N/m", None: "N/m^2"}
    units = {found[one] for one in models}
    return units.pop() if len(units) == 1 else "N/m^2 or N/m"


def _kinds(scene: Scene) -> list[str]:
    walls = [side for side in ("wall_left", "wall_right") if getattr(scene, side) is not None]
    return ["chain"] * len(scene.stiffness) + walls


def contacts(scene: Scene, run: Trajectory | None = None, **form: Any) -> Table:
    """Every contact: geometry, stiffness by both laws, what LAMMPS is told, what is predicted and, with a run, found.

    ``form``: types, geometry and surrogate_radius of the deck, as in :class:`~dem_bridge.backends.base.Resolution`.
    """
    told, c = _Told(scene=scene, resolution=Resolution(**form)), scene.contacts
    notes: list[str] = []
    columns: list[Column] = [
        counts("contact", "contact", range(scene.n_contact)),
        texts("where", "where", _kinds(scene)),
        *_geometry(scene, notes),
        numbers("stiffness", "stiffness of the scene", "N/m^(n-1)", c.stiffness),
        numbers("exponent", "n", "", c.exponent),
        numbers("gap", "gap", "m", c.gap),
        *_damping(scene),
        *_of_deck(told, notes),
        *_predicted(scene, told.prescan, notes),
        *_found(scene, run, notes),
    ]
    return Table(
        id="contacts",
        title=f"Contacts of {scene.name}",
        columns=tuple(columns),
        notes=tuple(notes),
        provenance=origin(scene, run),
    )


def _geometry(scene: Scene, notes: list[str]) -> list[Column]:
    """Angles, and the stiffness that both laws give at them."""
    angle: list[float | None] = [None] * scene.n_contact
    paper, exact = angle.copy(), angle.copy()
    if scene.geometry is None:
        notes.append(NO_GEOMETRY)
    else:
        for k in range(len(scene.stiffness)):
            angle[k], exact[k] = scene.geometry.angle[k], scene.geometry.contact(k).stiffness
            if angle[k] is not None:
                paper[k] = scene.geometry.contact(k, "paper").stiffness
        if None in paper[: len(scene.stiffness)]:
            notes.append("a sphere has no angle, and eq. 3.1 is of two crossed cylinders")
        if scene.n_contact > len(scene.stiffness):
            notes.append("what walls are is not known: stiffness and n are all that is said of them")
        notes.append(EQUATION)
    ratio = [None if p is None or e is None else p / e for p, e in zip(paper, exact, strict=True)]
    return [
        numbers("angle", "angle", "deg", angle),
        numbers("stiffness_paper", "stiffness by eq. 3.1", "N/m^1.5", paper),
        numbers("stiffness_exact", "stiffness by Hertz' exact law", "N/m^1.5", exact),
        numbers("paper_over_exact", "eq. 3.1 over exact", "", ratio),
    ]


def _damping(scene: Scene) -> list[Column]:
    if scene.damping is None:
        return []
    assert isinstance(scene.damping.coefficient, tuple)  # set when the scene was made
    return [numbers("damping", "damping coefficient", DAMPING_LAWS[scene.damping.law], scene.damping.coefficient)]


def _of_deck(told: _Told, notes: list[str]) -> list[Column]:
    scene, law = told.scene, told.laws.where[told.place].tolist()
    model: list[str | None] = [None] * scene.n_contact
    stiffness: list[float | None] = [None] * scene.n_contact
    if reason := refusal(scene):
        notes.append(f"LAMMPS' model and k_n are those of pair_style granular, which has none here: {reason}")
    else:
        known = [told.coefficients(one) for one in range(len(told.laws.stiffness))]
        model, stiffness = [known[one][0] for one in law], [known[one][1] for one in law]
        notes.append(
            "k_n as in pair_coeff: stiffness / sqrt(R/2) for hertz, R the gauge radius; the stiffness for hooke"
        )
    return [
        texts("lammps_model", "LAMMPS model", model),
        numbers("lammps_k_n", "LAMMPS k_n", _unit_of(model), stiffness, digits=6),
        counts("type_left", "type left", told.types[told.place]),
        counts("type_right", "type right", told.types[told.place + 1]),
        numbers("surrogate_radius", "gauge radius", "m", [told.radius] * scene.n_contact),
    ]


def _predicted(scene: Scene, prescan: Prescan, notes: list[str]) -> list[Column]:
    """By the coarse run that decks are sized by, and by binary collisions."""
    c, overlap = scene.contacts, prescan.peak_overlap
    notes.append(
        "the survey is the coarse run by which decks are sized, good to a few per cent; its forces are elastic"
    )
    force: list[float | None] = [None] * scene.n_contact
    residence = force.copy()
    if reasons := no_single_pulse(scene):
        notes.append(f"binary collisions describe a single pulse, but {'; '.join(reasons)}: what they say is empty")
    else:
        speed = scene.velocity[0]
        for k in range(scene.n_contact):
            hit = two_body_collision(
                masses=(scene.mass[k], scene.mass[k + 1]),
                velocities=(speed, 0.0),
                stiffness=float(c.stiffness[k]),
                exponent=float(c.exponent[k]),
            )
            force[k], residence[k], speed = hit.peak_force, hit.half_time, hit.exit_velocity[1]
    return [
        numbers("peak_overlap_prescan", "peak overlap, survey", "m", overlap, digits=3),
        numbers("peak_force_prescan", "peak force, survey", "N", c.force(overlap, np.arange(len(overlap))), digits=3),
        numbers("peak_force_bca", "peak force, BCA", "N", force),
        numbers("residence_bca", "residence time, BCA", "s", residence),
    ]


def _found(scene: Scene, run: Trajectory | None, notes: list[str]) -> list[Column]:
    """Of a run, and what Hertz' exact law makes of its forces."""
    nothing = np.full(scene.n_contact, np.nan)
    force, bar, overlap, overlap_bar = nothing, nothing, nothing, nothing
    if run is None:
        notes.append("no run was asked for: peaks, ellipses and pressures are not known")
    else:
        force, bar = run.peak_force, np.asarray(run.uncertainty["peak_force"])
        notes.append(f"found by {run.provenance['backend']}: the largest force of the whole run, wherever it came from")
        if scene.law is not None or scene.damped:
            notes.append("peak overlaps found are those of elastic powers, which not all contacts are: they are empty")
        else:
            power = 1.0 / (scene.contacts.exponent - 1.0)
            overlap = (force / scene.contacts.stiffness) ** power
            # the root rises the faster the lower it is, so the lower side has the wider bar
            lower = (np.maximum(force - bar, 0.0) / scene.contacts.stiffness) ** power
            overlap_bar = np.where(np.isfinite(bar), overlap - lower, np.nan)
    major, minor, pressure = (list[float | None]([None] * scene.n_contact) for _ in range(3))
    if run is not None and scene.geometry is not None:
        hertzian = (scene.contacts.exponent == 2.5) & (scene.law is None)
        if not np.all(hertzian):
            notes.append("ellipses and pressures are those of Hertz' law, n = 2.5; other contacts have none")
        for k in np.flatnonzero(hertzian[: len(scene.stiffness)]).tolist():
            contact, newton = scene.geometry.contact(k), float(force[k])
            if newton > 0.0:
                (major[k], minor[k]), pressure[k] = contact.semi_axes(newton), contact.peak_pressure(newton)
        notes.append("ellipses and pressures follow from the peak force by Hertz' exact law")
    return [
        *barred("peak_overlap", "peak overlap", "m", overlap, overlap_bar),
        *barred("peak_force", "peak force", "N", force, bar),
        numbers("semi_major", "semi-major axis", "m", major),
        numbers("semi_minor", "semi-minor axis", "m", minor),
        numbers("peak_pressure", "peak pressure", "Pa", pressure),
    ]


def bodies(scene: Scene, **form: Any) -> Table:
    """Every body: mass, shape, size, material, start velocity, and which atom of a deck it is; ``form`` as above."""
    told = _Told(scene=scene, resolution=Resolution(**form))
    known = scene.geometry.bodies if scene.geometry is not None else ()
    nothing: list[None] = [None] * scene.n_body
    notes = [] if known else [NO_GEOMETRY]
    mass_of_shape = [body.mass for body in known]
    if any(not math.isclose(one, mass, rel_tol=1e-9) for one, mass in zip(mass_of_shape, scene.mass, strict=False)):
        notes.append("the scene's own mass is what moves; density times volume is another where a mass was given")
    columns = (
        counts("body", "body", range(scene.n_body)),
        numbers("mass", "mass", "kg", scene.mass),
        numbers("mass_by_density", "density times volume", "kg", mass_of_shape or nothing),
        texts("shape", "shape", [body.shape for body in known] or nothing),
        numbers("radius", "radius", "m", [body.radius for body in known] or nothing),
        numbers("height", "height", "m", [body.height for body in known] or nothing),
        texts("material", "material", [body.material.name for body in known] or nothing),
        numbers("youngs_modulus", "Young's modulus", "Pa", [b.material.youngs_modulus for b in known] or nothing),
        numbers("poissons_ratio", "Poisson's ratio", "", [b.material.poissons_ratio for b in known] or nothing),
        numbers("density", "density", "kg/m^3", [body.material.density for body in known] or nothing),
        numbers("velocity", "start velocity", "m/s", scene.velocity),
        counts("atom_id", "atom", range(1 + told.first, 1 + told.first + scene.n_body)),
        counts("atom_type", "atom type", told.types[told.first : told.first + scene.n_body]),
    )
    return Table(
        id="bodies",
        title=f"Bodies of {scene.name}",
        columns=columns,
        notes=tuple(notes),
        provenance=origin(scene),
    )


def pair_coeffs(scene: Scene, **form: Any) -> Table:
    """Every pair of atom types that meets, with what stands behind its ``pair_coeff``; ``form`` as above.

    ``include`` are the same lines as in the scene's deck for ``pair_style granular``, from ``pair_style`` on. Raises
    UnsupportedScene where that style cannot express the scene.
    """
    if reason := refusal(scene):
        raise UnsupportedScene(
            f"there are no pair coefficients of {scene.name}: {reason}; its tables: `dem-bridge deck --style table`"
        )
    told, order, c = _Told(scene=scene, resolution=Resolution(**form)), line_order(scene), scene.contacts
    met = list(pairs(told.types))
    rows = [(low, high, int(order[at]), count, int(told.laws.where[at])) for low, high, at, count in met]
    known = [told.coefficients(law) for *_, law in rows]
    columns = (
        counts("type_1", "type I", [row[0] for row in rows]),
        counts("type_2", "type J", [row[1] for row in rows]),
        counts("contact", "first contact", [row[2] for row in rows]),
        counts("contacts", "contacts", [row[3] for row in rows]),
        numbers("stiffness", "stiffness", "N/m^(n-1)", [float(c.stiffness[row[2]]) for row in rows]),
        numbers("exponent", "n", "", [float(c.exponent[row[2]]) for row in rows]),
        texts("lammps_model", "LAMMPS model", [one[0] for one in known]),
        numbers("lammps_k_n", "LAMMPS k_n", _unit_of([one[0] for one in known]), [one[1] for one in known], digits=6),
        numbers("lammps_damping", "LAMMPS damping coefficient", "", [one[2] for one in known], digits=6),
        texts("coefficients", "behind pair_coeff I J", [told.laws.coefficients(row[4], told.radius) for row in rows]),
    )
    return Table(
        id="pair-coeffs",
        title=f"Pair coefficients of {scene.name} for pair_style granular",
        columns=columns,
        notes=(
            f"for spheres of radius R = {told.radius!r} m; k_n = stiffness / sqrt(R/2) for hertz, stiffness for hooke",
        ),
        provenance=origin(scene),
        include="\n".join(_include(told, rows)) + "\n",
    )


def _include(told: _Told, rows: list[tuple[int, int, int, int, int]]) -> list[str]:
    scene, kinds = told.scene, _kinds(told.scene)
    lines = [
        f"# pair coefficients of {scene.name}, written by dem_bridge {__version__}"
        f" DATE: {FORM_DATE} UNITS: si SCENE: sha256:{scene.content_hash}",
        f"# for spheres of radius R = {told.radius!r} m: hertz has K = beta / sqrt(R/2), hooke has k = beta",
        f"# in a deck of {int(np.max(told.types))} atom types; those of the {len(told.types)} atoms, walls included:",
    ]
    types = [str(one) for one in told.types.tolist()]
    lines += [f"#   {' '.join(types[at : at + 30])}" for at in range(0, len(types), 30)]
    lines += granular(told.laws, told.radius).head
    for low, high, contact, count, law in rows:
        name = f"contact {contact}" if kinds[contact] == "chain" else kinds[contact]
        more = f" and {count - 1} more" if count > 1 else ""
        beta = float(told.laws.stiffness[law])
        behind = told.laws.coefficients(law, told.radius)
        lines.append(f"pair_coeff      {low} {high} {behind}  # {name}{more}: beta = {beta!r}")
    return lines
