"""Tables of a scene's contacts, bodies and LAMMPS pair coefficients."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.base import Resolution
from dem_bridge.backends.bca import SINGLE_PULSE
from dem_bridge.backends.prescan import Prescan
from dem_bridge.backends.steps import radius_of
from dem_bridge.backends.tabled import prescan_scene
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.exports.table import Column, Table, counts, numbers, texts, with_uncertainty
from dem_bridge.lmp.coefficients import GRANULAR_STYLE, Laws, laws, line_order, pairs
from dem_bridge.lmp.encoding import Types, body_types
from dem_bridge.lmp.pairing import granular
from dem_bridge.physics.exact import two_body_collision
from dem_bridge.scene import DAMPING_LAWS, Scene
from dem_bridge.trajectory import Trajectory
from dem_bridge.version import FORM_DATE, __version__

Floats = NDArray[np.float64]

NO_GEOMETRY = (
    "the scene has no geometry, so shapes, sizes, angles, stiffnesses by angle, contact ellipses and pressures are"
    " unknown; a scene file in physical form has a geometry"
)

EQUATION = "eq. 3.1: Chaunsali, Kim & Yang (2018), with their approximate axis ratio of the contact ellipse"


def origin(scene: Scene, run: Trajectory | None = None) -> dict[str, Any]:
    """Return the provenance of a table: the scene and, where the table has results, the run."""
    provenance: dict[str, Any] = {"scene": scene.name, "scene_hash": scene.content_hash, "dem_bridge": __version__}
    if run is not None:
        provenance |= {key: run.provenance[key] for key in ("backend", "settings", "versions") if key in run.provenance}
    return provenance


@dataclass(frozen=True, kw_only=True)
class _DeckContacts:
    """Hold the contacts of a scene's deck; arrays run along the line of atoms, walls included."""

    scene: Scene
    resolution: Resolution

    @cached_property
    def prescan(self) -> Prescan:
        """Return the short coarse run from which the surrogate radius follows."""
        return prescan_scene(self.scene)

    @cached_property
    def radius(self) -> float:
        """Return the surrogate radius of the deck, m."""
        largest = float(np.max(self.prescan.peak_overlap, initial=0.0))
        radius = radius_of(self.scene, self.resolution, self.prescan)
        if radius < largest:
            raise UsageError(
                f"surrogate_radius = {radius:g} m; allowed: more than the largest overlap, {largest:.3g} m"
            )
        return radius

    @cached_property
    def laws(self) -> Laws:
        """Return the distinct contact laws of the scene."""
        return laws(self.scene)

    @cached_property
    def types(self) -> Types:
        """Return the atom type of each body and wall."""
        return body_types(self.laws.where, self.resolution.types)

    @cached_property
    def place(self) -> NDArray[np.int64]:
        """Return for each contact of the scene the index along the line of its left atom."""
        return np.argsort(line_order(self.scene))

    @property
    def first(self) -> int:
        """Return the index of body 0 along the line."""
        return int(self.scene.wall_left is not None)

    def coefficients(self, law: int) -> tuple[str, float, float]:
        """Return the model, stiffness and damping that follow ``pair_coeff I J`` for ``pair_style granular``."""
        model, stiffness, damping = self.laws.coefficients(law, self.radius).split()[:3]
        return model, float(stiffness), float(damping)


def _unit_of(models: Sequence[str | None]) -> str:
    """Return the unit of the stiffness in ``pair_coeff`` for these models."""
    unit_of_model = {"hertz": "N/m^2", "hooke": "N/m", None: "N/m^2"}
    units = {unit_of_model[model] for model in models}
    return units.pop() if len(units) == 1 else "N/m^2 or N/m"


def _kinds(scene: Scene) -> list[str]:
    """Return "chain", "wall_left" or "wall_right" for each contact."""
    walls = [side for side in ("wall_left", "wall_right") if getattr(scene, side) is not None]
    return ["chain"] * len(scene.stiffness) + walls


def contacts(scene: Scene, run: Trajectory | None = None, **deck_settings: Any) -> Table:
    """Return the table of contacts: geometry, stiffness, LAMMPS coefficients, predictions and results of a run.

    ``deck_settings`` are the fields ``types``, ``geometry`` and ``surrogate_radius`` of
    :class:`~dem_bridge.backends.base.Resolution`.
    """
    deck, c = _DeckContacts(scene=scene, resolution=Resolution(**deck_settings)), scene.contacts
    notes: list[str] = []
    columns: list[Column] = [
        counts("contact", "contact", range(scene.n_contact)),
        texts("where", "where", _kinds(scene)),
        *_geometry(scene, notes),
        numbers("stiffness", "stiffness of the scene", "N/m^(n-1)", c.stiffness),
        numbers("exponent", "n", "", c.exponent),
        numbers("gap", "gap", "m", c.gap),
        *_damping(scene),
        *_deck_columns(deck, notes),
        *_predictions(scene, deck.prescan, notes),
        *_results(scene, run, notes),
    ]
    return Table(
        id="contacts",
        title=f"Contacts of {scene.name}",
        columns=tuple(columns),
        notes=tuple(notes),
        provenance=origin(scene, run),
    )


def _geometry(scene: Scene, notes: list[str]) -> list[Column]:
    """Return the columns of the contact angles and of the stiffness by both laws at these angles."""
    (angle, paper, exact), links = np.full((3, scene.n_contact), np.nan), len(scene.stiffness)
    if scene.geometry is None:
        notes.append(NO_GEOMETRY)
    else:
        for k, degrees in enumerate(scene.geometry.angle):
            exact[k] = scene.geometry.contact(k).stiffness
            if degrees is not None:
                angle[k], paper[k] = degrees, scene.geometry.contact(k, "paper").stiffness
        if np.isnan(paper[:links]).any():
            notes.append("a contact with a sphere has no angle, and eq. 3.1 applies to two crossed cylinders only")
        if scene.n_contact > links:
            notes.append("walls have a stiffness and an exponent n, but no shape and no material")
        notes.append(EQUATION)
    return [
        numbers("angle", "angle", "deg", angle),
        numbers("stiffness_paper", "stiffness by eq. 3.1", "N/m^1.5", paper),
        numbers("stiffness_exact", "stiffness by Hertz' exact law", "N/m^1.5", exact),
        numbers("paper_over_exact", "eq. 3.1 over exact", "", paper / exact),
    ]


def _damping(scene: Scene) -> list[Column]:
    """Return the column of damping coefficients, or no column for a scene without damping."""
    if scene.damping is None:
        return []
    assert isinstance(scene.damping.coefficient, tuple)  # Scene turns a single coefficient into a tuple
    return [numbers("damping", "damping coefficient", DAMPING_LAWS[scene.damping.law], scene.damping.coefficient)]


def _deck_columns(deck: _DeckContacts, notes: list[str]) -> list[Column]:
    """Return the columns of the contacts' coefficients and atom types in the deck."""
    scene, law = deck.scene, deck.laws.where[deck.place].tolist()
    model, stiffness = list[str | None]([None] * scene.n_contact), np.full(scene.n_contact, np.nan)
    if reason := GRANULAR_STYLE.unsupported_reason(scene):
        notes.append(f"LAMMPS model and k_n are empty because pair_style granular cannot express the scene: {reason}")
    else:
        coefficients = {nth: deck.coefficients(nth) for nth in law}
        model = [coefficients[nth][0] for nth in law]
        stiffness[:] = [coefficients[nth][1] for nth in law]
        notes.append(
            "LAMMPS k_n is the value in pair_coeff: stiffness / sqrt(R/2) for hertz, where R is the surrogate radius,"
            " and the stiffness for hooke"
        )
    return [
        texts("lammps_model", "LAMMPS model", model),
        numbers("lammps_k_n", "LAMMPS k_n", _unit_of(model), stiffness, digits=6),
        counts("type_left", "atom type left", deck.types[deck.place]),
        counts("type_right", "atom type right", deck.types[deck.place + 1]),
        numbers("surrogate_radius", "surrogate radius", "m", [deck.radius] * scene.n_contact),
    ]


def _predictions(scene: Scene, prescan: Prescan, notes: list[str]) -> list[Column]:
    """Return the columns of the predictions by the prescan and by the binary collision approximation (BCA)."""
    c, overlap = scene.contacts, prescan.peak_overlap
    notes.append(
        "the prescan is a short coarse run before the real one; its overlaps and elastic forces are accurate to a few"
        " per cent"
    )
    force, residence = np.full((2, scene.n_contact), np.nan)
    if reason := SINGLE_PULSE.unsupported_reason(scene):
        notes.append(f"BCA columns are empty: {reason}")
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
        numbers("peak_overlap_prescan", "peak overlap, prescan", "m", overlap, digits=3),
        numbers("peak_force_prescan", "peak force, prescan", "N", c.force(overlap, np.arange(len(overlap))), digits=3),
        numbers("peak_force_bca", "peak force, BCA", "N", force),
        numbers("residence_bca", "residence time, BCA", "s", residence),
    ]


def _results(scene: Scene, run: Trajectory | None, notes: list[str]) -> list[Column]:
    """Return the columns of a run's peak forces, with overlaps, ellipses and pressures by Hertz' exact law."""
    unknown = np.full((7, scene.n_contact), np.nan)
    force, uncertainty, overlap, overlap_uncertainty, major, minor, pressure = unknown
    if run is None:
        notes.append("without a run, peak forces, peak overlaps, contact ellipses and pressures are unknown")
    else:
        force, uncertainty = run.peak_force, np.asarray(run.uncertainty["peak_force"])
        notes.append(f"results by {run.provenance['backend']}; the peak force is the largest of the whole run")
        if scene.law is not None or scene.damped:
            notes.append("peak overlaps are empty: they follow from peak forces only for elastic power laws")
        else:
            power = 1.0 / (scene.contacts.exponent - 1.0)
            overlap = (force / scene.contacts.stiffness) ** power
            # the root is steeper below the value than above it, so the lower side has the larger uncertainty
            lower = (np.maximum(force - uncertainty, 0.0) / scene.contacts.stiffness) ** power
            overlap_uncertainty = np.where(np.isfinite(uncertainty), overlap - lower, np.nan)
    if run is not None and scene.geometry is not None:
        hertzian = (scene.contacts.exponent == 2.5) & (scene.law is None)
        if not np.all(hertzian):
            notes.append("only contacts by Hertz' law, n = 2.5, have contact ellipses and pressures")
        for k in np.flatnonzero(hertzian[: len(scene.stiffness)]).tolist():
            contact, newton = scene.geometry.contact(k), float(force[k])
            if newton > 0.0:
                (major[k], minor[k]), pressure[k] = contact.semi_axes(newton), contact.peak_pressure(newton)
        notes.append("contact ellipses and pressures follow from the peak force by Hertz' exact law")
    return [
        *with_uncertainty("peak_overlap", "peak overlap", "m", overlap, overlap_uncertainty),
        *with_uncertainty("peak_force", "peak force", "N", force, uncertainty),
        numbers("semi_major", "semi-major axis of the contact ellipse", "m", major),
        numbers("semi_minor", "semi-minor axis of the contact ellipse", "m", minor),
        numbers("peak_pressure", "peak contact pressure", "Pa", pressure),
    ]


def bodies(scene: Scene, **deck_settings: Any) -> Table:
    """Return the table of bodies: mass, shape, size, material, initial velocity and atom of the deck.

    ``deck_settings`` are those of :func:`contacts`.
    """
    deck = _DeckContacts(scene=scene, resolution=Resolution(**deck_settings))
    shapes = scene.geometry.bodies if scene.geometry is not None else ()
    unknown: list[None] = [None] * scene.n_body
    notes = [] if shapes else [NO_GEOMETRY]
    mass_of_shape = [body.mass for body in shapes]
    if any(
        not math.isclose(by_density, mass, rel_tol=1e-9)
        for by_density, mass in zip(mass_of_shape, scene.mass, strict=False)
    ):
        notes.append(
            "the equations of motion use the mass of the scene; density times volume differs for a body whose mass was"
            " set in the scene file"
        )
    columns = (
        counts("body", "body", range(scene.n_body)),
        numbers("mass", "mass", "kg", scene.mass),
        numbers("mass_by_density", "density times volume", "kg", mass_of_shape or unknown),
        texts("shape", "shape", [body.shape for body in shapes] or unknown),
        numbers("radius", "radius", "m", [body.radius for body in shapes] or unknown),
        numbers("height", "height", "m", [body.height for body in shapes] or unknown),
        texts("material", "material", [body.material.name for body in shapes] or unknown),
        numbers("youngs_modulus", "Young's modulus", "Pa", [b.material.youngs_modulus for b in shapes] or unknown),
        numbers("poissons_ratio", "Poisson's ratio", "", [b.material.poissons_ratio for b in shapes] or unknown),
        numbers("density", "density", "kg/m^3", [body.material.density for body in shapes] or unknown),
        numbers("velocity", "initial velocity", "m/s", scene.velocity),
        counts("atom_id", "atom id", range(1 + deck.first, 1 + deck.first + scene.n_body)),
        counts("atom_type", "atom type", deck.types[deck.first : deck.first + scene.n_body]),
    )
    return Table(
        id="bodies",
        title=f"Bodies of {scene.name}",
        columns=columns,
        notes=tuple(notes),
        provenance=origin(scene),
    )


def pair_coeffs(scene: Scene, **deck_settings: Any) -> Table:
    """Return the table of all pairs of atom types in contact, with the arguments of their ``pair_coeff``.

    ``Table.include`` has the same lines as the scene's deck for ``pair_style granular``, from ``pair_style`` on.
    ``deck_settings`` are those of :func:`contacts`. Raises UnsupportedScene if ``pair_style granular`` cannot express
    the scene.
    """
    if reason := GRANULAR_STYLE.unsupported_reason(scene):
        raise UnsupportedScene(
            f"{scene.name} has no pair coefficients for pair_style granular: {reason}; for its force tables use"
            " `dem-bridge deck --style table`"
        )
    deck = _DeckContacts(scene=scene, resolution=Resolution(**deck_settings))
    order, c = line_order(scene), scene.contacts
    rows = [
        (low, high, int(order[place]), count, index := int(deck.laws.where[place]), *deck.coefficients(index))
        for low, high, place, count in pairs(deck.types)
    ]
    low, high, first, count, law, model, k_n, damping = zip(*rows, strict=True) if rows else [()] * 8
    arguments = [deck.laws.coefficients(nth, deck.radius) for nth in law]
    columns = (
        counts("type_1", "atom type I", low),
        counts("type_2", "atom type J", high),
        counts("contact", "first contact", first),
        counts("contacts", "number of contacts", count),
        numbers("stiffness", "stiffness", "N/m^(n-1)", c.stiffness[list(first)]),
        numbers("exponent", "n", "", c.exponent[list(first)]),
        texts("lammps_model", "LAMMPS model", model),
        numbers("lammps_k_n", "LAMMPS k_n", _unit_of(model), k_n, digits=6),
        numbers("lammps_damping", "LAMMPS damping coefficient", "", damping, digits=6),
        texts("coefficients", "arguments of pair_coeff I J", arguments),
    )
    return Table(
        id="pair-coeffs",
        title=f"Pair coefficients of {scene.name} for pair_style granular",
        columns=columns,
        notes=(
            f"for spheres of radius R = {deck.radius!r} m; k_n = stiffness / sqrt(R/2) for hertz, stiffness for hooke",
        ),
        provenance=origin(scene),
        include="\n".join(_include(deck, rows)) + "\n",
    )


def _include(deck: _DeckContacts, rows: Sequence[tuple[Any, ...]]) -> list[str]:
    """Return the lines of a file that LAMMPS reads by ``include``."""
    scene, kinds = deck.scene, _kinds(deck.scene)
    lines = [
        f"# pair coefficients of {scene.name}, written by dem_bridge {__version__}"
        f" DATE: {FORM_DATE} UNITS: si SCENE: sha256:{scene.content_hash}",
        f"# for spheres of radius R = {deck.radius!r} m: hertz has K = beta / sqrt(R/2), hooke has k = beta",
        f"# in a deck of {int(np.max(deck.types))} atom types; types of its {len(deck.types)} atoms, walls included:",
    ]
    types = [str(kind) for kind in deck.types.tolist()]
    lines += [f"#   {' '.join(types[start : start + 30])}" for start in range(0, len(types), 30)]
    lines += granular(deck.laws, deck.radius).head
    for low, high, contact, count, law, *_ in rows:
        name = f"contact {contact}" if kinds[contact] == "chain" else kinds[contact]
        more = f" and {count - 1} more" if count > 1 else ""
        beta = float(deck.laws.stiffness[law])
        arguments = deck.laws.coefficients(law, deck.radius)
        lines.append(f"pair_coeff      {low} {high} {arguments}  # {name}{more}: beta = {beta!r}")
    return lines
