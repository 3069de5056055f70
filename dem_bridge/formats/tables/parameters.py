"""Tables of a scene's contacts, bodies and LAMMPS pair coefficients."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from dem_bridge.backends.base import Resolution
from dem_bridge.backends.bca import SINGLE_PULSE
from dem_bridge.backends.prescan import Prescan
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.backends.surrogate_radius import radius_of
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.formats.tables.table import COLUMNS, Table, tabulate
from dem_bridge.lmp.pair_coefficients import GRANULAR_STYLE, Laws, Types, body_types, granular, laws, line_order, pairs
from dem_bridge.physics.exact import two_body_collision
from dem_bridge.scene.scene import DAMPING_LAWS, Scene
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.version import FORM_DATE, __version__

#: sentences on definitions, and on the reasons for unknown values
NOTES = {
    "no_geometry": (
        "the scene has no geometry, so shapes, sizes, angles, stiffnesses by angle, contact "
        "ellipses and pressures are unknown; a scene file in physical form has a geometry"
    ),
    "equation": ("eq. 3.1: Chaunsali, Kim & Yang (2018), with their approximate axis ratio of the contact ellipse"),
    "spheres": "a contact with a sphere has no angle, and eq. 3.1 applies to two crossed cylinders only",
    "exponent": "n is the exponent of the potential; the force is stiffness overlap^(n-1): overlap^1.5 for n = 2.5",
    "walls": "walls have a stiffness and an exponent n, but no shape and no material",
    "not_granular": ("LAMMPS model and k_n are empty because pair_style granular cannot express the scene: {reason}"),
    "k_n": (
        "LAMMPS k_n is the value in pair_coeff: stiffness / sqrt(R/2) for hertz, where R is "
        "the surrogate radius, and the stiffness for hooke"
    ),
    "prescan": (
        "the prescan is a short coarse run before the real one; its overlaps and elastic "
        "forces are accurate to a few per cent"
    ),
    "no_bca": "BCA columns are empty: {reason}",
    "no_run": "without a run, peak forces, peak overlaps, contact ellipses and pressures are unknown",
    "run": "results by {backend}; the peak force is the largest of the whole run",
    "no_overlaps": "peak overlaps are empty: they follow from peak forces only for elastic power laws",
    "not_hertzian": "only contacts by Hertz' law, n = 2.5, have contact ellipses and pressures",
    "ellipses": "contact ellipses and pressures follow from the peak force by Hertz' exact law",
    "own_mass": (
        "the equations of motion use the mass of the scene; density times volume differs for "
        "a body whose mass was set in the scene file"
    ),
    "radius": ("for spheres of radius R = {radius!r} m; k_n = stiffness / sqrt(R/2) for hertz, stiffness for hooke"),
}


def origin(scene: Scene, run: Trajectory | None = None) -> dict[str, Any]:
    """Return the provenance of a table: the scene and, where the table has results, the run."""
    provenance: dict[str, Any] = {"scene": scene.name, "scene_hash": scene.content_hash, "dem_bridge": __version__}
    if run is not None:
        provenance |= {key: run.provenance[key] for key in ("backend", "settings", "versions") if key in run.provenance}
    return provenance


@dataclass(frozen=True, kw_only=True)
class _Deck:
    """Hold the coefficients and atom types of a scene's deck; types run along the line of atoms, walls included."""

    prescan: Prescan
    """Short coarse run from which the surrogate radius follows."""
    radius: float
    """Surrogate radius, m."""
    laws: Laws
    types: Types

    def coefficients(self, law: int) -> tuple[str, float, float]:
        """Return the model, stiffness and damping that follow ``pair_coeff I J`` for ``pair_style granular``."""
        model, stiffness, damping = self.laws.coefficients(law, self.radius).split()[:3]
        return model, float(stiffness), float(damping)


def _deck_of(scene: Scene, settings: Mapping[str, Any]) -> _Deck:
    """Return the deck of a scene; raise UsageError unless its radius is above the largest overlap."""
    resolution, prescan, distinct = Resolution(**settings), prescan_scene(scene), laws(scene)
    largest = float(np.max(prescan.peak_overlap, initial=0.0))
    radius = radius_of(scene, resolution, prescan)
    if radius <= largest:
        raise UsageError(f"surrogate_radius = {radius:g} m; allowed: more than the largest overlap, {largest:.3g} m")
    types = body_types(distinct.where, resolution.types)
    return _Deck(prescan=prescan, radius=radius, laws=distinct, types=types)


def _unit_of(models: Sequence[str | None]) -> str:
    """Return the unit of the stiffness in ``pair_coeff`` for these models."""
    unit_of_model = {"hertz": "N/m^2", "dmt": "N/m^2", "hooke": "N/m", None: "N/m^2"}
    units = {unit_of_model[model] for model in models}
    return units.pop() if len(units) == 1 else "N/m^2 or N/m"


def _kinds(scene: Scene) -> list[str]:
    """Return "chain", "wall_left" or "wall_right" for each contact."""
    walls = [side for side in ("wall_left", "wall_right") if getattr(scene, side) is not None]
    return ["chain"] * len(scene.stiffness) + walls


#: names of the columns of damping laws whose coefficient is one of restitution
_DAMPING_NAMES = {"coeff_restitution": "restitution", "tsuji": "restitution_tsuji"}


def contacts(scene: Scene, run: Trajectory | None = None, **deck_settings: Any) -> Table:
    """Return the table of contacts: geometry, stiffness, LAMMPS coefficients, predictions and results of a run.

    ``deck_settings`` are the fields ``types``, ``geometry`` and ``surrogate_radius`` of
    :class:`~dem_bridge.backends.base.Resolution`.
    """
    deck, c = _deck_of(scene, deck_settings), scene.contacts
    notes: list[str] = []
    values: dict[str, Any] = {"contact": range(scene.n_contact), "where": _kinds(scene), **_geometry(scene, notes)}
    values |= {"stiffness": c.stiffness, "exponent": c.exponent, "gap": c.gap, **_deck_columns(scene, deck, notes)}
    notes.append(NOTES["exponent"])
    values |= _predictions(scene, deck.prescan, notes) | _results(scene, run, notes)
    details = {"lammps_k_n": {"unit": _unit_of(values.get("lammps_model", [None] * scene.n_contact))}}
    if (damping := scene.damping) is not None:
        name = _DAMPING_NAMES.get(damping.law, "damping") + "_not_clipped" * (not damping.clip)
        values[name], details[name] = damping.coefficient, {"unit": DAMPING_LAWS[damping.law]}
    if (adhesion := scene.adhesion) is not None:
        values[f"pull_off_{adhesion.law}"] = adhesion.pull_off
    fields = {"title": f"Contacts of {scene.name}", "notes": tuple(notes), "provenance": origin(scene, run)}
    return tabulate("contacts", values, details=details, **fields)


def _geometry(scene: Scene, notes: list[str]) -> dict[str, Any]:
    """Return the contact angles and the stiffness by both laws at these angles."""
    if (geometry := scene.geometry) is None:
        notes.append(NOTES["no_geometry"])
        return {}
    exact = np.array([geometry.contact(k).stiffness for k in range(len(geometry.angle))])
    paper = np.array(
        [
            math.nan if angle is None else geometry.contact(k, "paper").stiffness
            for k, angle in enumerate(geometry.angle)
        ]
    )
    if np.isnan(paper).any() and not np.isnan(paper).all():
        notes.append(NOTES["spheres"])
    if scene.n_contact > len(scene.stiffness):
        notes.append(NOTES["walls"])
    if not np.isnan(paper).all():  # a chain of spheres has no angles
        notes.append(NOTES["equation"])
    values = {"stiffness_paper": paper, "stiffness_exact": exact, "paper_over_exact": paper / exact}
    return {"angle": geometry.angle, **values}


def _deck_columns(scene: Scene, deck: _Deck, notes: list[str]) -> dict[str, Any]:
    """Return the contacts' coefficients and atom types in the deck."""
    place = np.argsort(line_order(scene))  # index along the line of the left atom of each contact of the scene
    values: dict[str, Any] = {"type_left": deck.types[place], "type_right": deck.types[place + 1]}
    values["surrogate_radius"] = [deck.radius] * scene.n_contact
    if reason := GRANULAR_STYLE.unsupported_reason(scene):
        notes.append(NOTES["not_granular"].format(reason=reason))
        return values
    notes.append(NOTES["k_n"])
    coefficients = [deck.coefficients(law) for law in deck.laws.where[place].tolist()]
    values |= zip(("lammps_model", "lammps_k_n"), zip(*coefficients, strict=True), strict=False)
    return values


def _predictions(scene: Scene, prescan: Prescan, notes: list[str]) -> dict[str, Any]:
    """Return the predictions by the prescan and by the binary collision approximation (BCA)."""
    c, overlap = scene.contacts, prescan.peak_overlap
    force = c.force(overlap, np.arange(len(overlap)))
    values: dict[str, Any] = {"peak_overlap_prescan": overlap, "peak_force_prescan": force}
    notes.append(NOTES["prescan"])
    if reason := SINGLE_PULSE.unsupported_reason(scene):
        notes.append(NOTES["no_bca"].format(reason=reason))
        return values
    hits, speed = [], scene.velocity[0]
    for masses, stiffness, exponent in zip(
        pairwise(scene.mass), c.stiffness.tolist(), c.exponent.tolist(), strict=True
    ):
        hits.append(two_body_collision(masses=masses, velocities=(speed, 0.0), stiffness=stiffness, exponent=exponent))
        speed = hits[-1].exit_velocity[1]
    values |= {"peak_force_bca": [hit.peak_force for hit in hits], "residence_bca": [hit.half_time for hit in hits]}
    return values


def _results(scene: Scene, run: Trajectory | None, notes: list[str]) -> dict[str, Any]:
    """Return a run's peak forces, with overlaps, ellipses and pressures by Hertz' exact law."""
    if run is None:
        notes.append(NOTES["no_run"])
        return {}
    force, uncertainty = run.peak_force, np.asarray(run.uncertainty["peak_force"])
    values: dict[str, Any] = {"peak_force": force, "peak_force_uncertainty": uncertainty}
    notes.append(NOTES["run"].format(backend=run.provenance["backend"]))
    if scene.law is not None or scene.damped:
        notes.append(NOTES["no_overlaps"])
    else:
        # the root is steeper below the value than above it, so the lower side has the larger uncertainty
        lower = np.where(np.isfinite(uncertainty), np.maximum(force - uncertainty, 0.0), math.nan)
        power = 1.0 / (scene.contacts.exponent - 1.0)
        overlap, least = ((newton / scene.contacts.stiffness) ** power for newton in (force, lower))
        values |= {"peak_overlap": overlap, "peak_overlap_uncertainty": overlap - least}
    if scene.geometry is not None:
        hertzian = (scene.contacts.exponent == 2.5) & (scene.law is None)
        if not np.all(hertzian):
            notes.append(NOTES["not_hertzian"])
        ellipses = np.full((3, scene.n_contact), np.nan)
        for k in np.flatnonzero((hertzian & (force > 0.0))[: len(scene.stiffness)]).tolist():
            contact = scene.geometry.contact(k)
            ellipses[:, k] = *contact.semi_axes(float(force[k])), contact.peak_pressure(float(force[k]))
        values |= zip(("semi_major", "semi_minor", "peak_pressure"), ellipses, strict=True)
        notes.append(NOTES["ellipses"])
    return values


def bodies(scene: Scene, **deck_settings: Any) -> Table:
    """Return the table of bodies: mass, shape, size, material, initial velocity and atom of the deck.

    ``deck_settings`` are those of :func:`contacts`.
    """
    types = body_types(laws(scene).where, Resolution(**deck_settings).types)
    shapes = scene.geometry.bodies if scene.geometry is not None else ()
    mass_of_shape = [body.mass for body in shapes]
    notes = [] if shapes else [NOTES["no_geometry"]]
    if shapes and not np.allclose(mass_of_shape, scene.mass, rtol=1e-9, atol=0.0):
        notes.append(NOTES["own_mass"])
    first = int(scene.wall_left is not None)
    atoms = slice(first, first + scene.n_body)
    values: dict[str, Any] = {"body": range(scene.n_body), "mass": scene.mass, "velocity": scene.velocity}
    values |= {"atom_id": range(1 + atoms.start, 1 + atoms.stop), "atom_type": types[atoms]}
    values |= {"mass_by_density": mass_of_shape, "material": [body.material.name for body in shapes]}
    values |= {key: [getattr(body, key) for body in shapes] for key in ("shape", "radius", "height")}
    for key in ("youngs_modulus", "poissons_ratio", "density"):
        values[key] = [getattr(body.material, key) for body in shapes]
    title = f"Bodies of {scene.name}"
    return tabulate("bodies", values, title=title, notes=tuple(notes), provenance=origin(scene))


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
    deck = _deck_of(scene, deck_settings)
    order, c = line_order(scene), scene.contacts
    rows = []
    for low, high, place, count in pairs(deck.types):
        first, law = int(order[place]), int(deck.laws.where[place])
        pair: dict[str, Any] = {"type_1": low, "type_2": high, "contact": first, "contacts": count}
        pair |= {"stiffness": c.stiffness[first], "exponent": c.exponent[first], "law": law}
        pair |= zip(("lammps_model", "lammps_k_n", "lammps_damping"), deck.coefficients(law), strict=True)
        rows.append(pair | {"coefficients": deck.laws.coefficients(law, deck.radius)})
    values = {quantity: [row[quantity] for row in rows] for quantity in COLUMNS["pair-coeffs"]}
    return tabulate(
        "pair-coeffs",
        values,
        details={"lammps_k_n": {"unit": _unit_of(values["lammps_model"])}},
        title=f"Pair coefficients of {scene.name} for pair_style granular",
        notes=(NOTES["radius"].format(radius=deck.radius),),
        provenance=origin(scene),
        include="\n".join(_include(scene, deck, rows)) + "\n",
    )


def _include(scene: Scene, deck: _Deck, rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the lines of a file that LAMMPS reads by ``include``."""
    kinds = _kinds(scene)
    lines = [
        f"# pair coefficients of {scene.name}, written by dem_bridge {__version__}"
        f" DATE: {FORM_DATE} UNITS: si SCENE: sha256:{scene.content_hash}",
        f"# for spheres of radius R = {deck.radius!r} m: hertz has K = beta / sqrt(R/2), hooke has k = beta",
        f"# in a deck of {int(np.max(deck.types))} atom types; types of its {len(deck.types)} atoms, walls included:",
    ]
    types = [str(kind) for kind in deck.types.tolist()]
    lines += [f"#   {' '.join(types[start : start + 30])}" for start in range(0, len(types), 30)]
    lines += granular(deck.laws, deck.radius).head
    for row in rows:
        name = f"contact {row['contact']}" if kinds[row["contact"]] == "chain" else kinds[row["contact"]]
        more = f" and {row['contacts'] - 1} more" if row["contacts"] > 1 else ""
        pair, beta = f"{row['type_1']} {row['type_2']} {row['coefficients']}", float(deck.laws.stiffness[row["law"]])
        lines.append(f"pair_coeff      {pair}  # {name}{more}: beta = {beta!r}")
    return lines
