"""Columns of the exported tables, by table and quantity: heading, unit, kind and digits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple

Kind = Literal["number", "count", "text"]


class Form(NamedTuple):
    """Hold how a column is shown; one that is ``optional`` is left out without values."""

    heading: str
    unit: str = ""
    kind: Kind = "number"
    digits: int = 5
    optional: bool = False
    uncertain: bool = False
    """Whether a column with its uncertainty follows."""

    def with_details(self, details: Mapping[str, str]) -> Form:
        """Return the form with the ``heading`` and ``unit`` that depend on the scene or the settings."""
        if unknown := set(details) - {"heading", "unit"}:
            raise KeyError(f"details of a column = {sorted(unknown)}; allowed: heading, unit")
        return self._replace(heading=details.get("heading", self.heading), unit=details.get("unit", self.unit))


COLUMNS: Mapping[str, Mapping[str, Form]] = {
    "contacts": {
        "contact": Form("contact", kind="count"),
        "where": Form("where", kind="text"),
        "angle": Form("angle", "deg"),
        "stiffness_paper": Form("stiffness by eq. 3.1", "N/m^1.5"),
        "stiffness_exact": Form("stiffness by Hertz' exact law", "N/m^1.5"),
        "paper_over_exact": Form("eq. 3.1 over exact"),
        "stiffness": Form("stiffness of the scene", "N/m^(n-1)"),
        "exponent": Form("n"),
        "gap": Form("gap", "m"),
        "damping": Form("damping coefficient", optional=True),
        "damping_not_clipped": Form("damping coefficient, not clipped", optional=True),
        "restitution": Form("coefficient of restitution", optional=True),
        "restitution_not_clipped": Form("coefficient of restitution, not clipped", optional=True),
        "restitution_tsuji": Form("coefficient of restitution (Tsuji)", optional=True),
        "restitution_tsuji_not_clipped": Form("coefficient of restitution (Tsuji), not clipped", optional=True),
        "pull_off_dmt": Form("pull-off force (DMT)", "N", optional=True),
        "pull_off_jkr": Form("pull-off force (JKR)", "N", optional=True),
        "lammps_model": Form("LAMMPS model", kind="text"),
        "lammps_k_n": Form("LAMMPS k_n", digits=6),
        "type_left": Form("atom type left", kind="count"),
        "type_right": Form("atom type right", kind="count"),
        "surrogate_radius": Form("surrogate radius", "m"),
        "peak_overlap_prescan": Form("peak overlap, prescan", "m", digits=3),
        "peak_force_prescan": Form("peak force, prescan", "N", digits=3),
        "peak_force_bca": Form("peak force, BCA", "N"),
        "residence_bca": Form("residence time, BCA", "s"),
        "peak_overlap": Form("peak overlap", "m", uncertain=True),
        "peak_force": Form("peak force", "N", uncertain=True),
        "semi_major": Form("semi-major axis of the contact ellipse", "m"),
        "semi_minor": Form("semi-minor axis of the contact ellipse", "m"),
        "peak_pressure": Form("peak contact pressure", "Pa"),
    },
    "bodies": {
        "body": Form("body", kind="count"),
        "mass": Form("mass", "kg"),
        "mass_by_density": Form("density times volume", "kg"),
        "shape": Form("shape", kind="text"),
        "radius": Form("radius", "m"),
        "height": Form("height", "m"),
        "material": Form("material", kind="text"),
        "youngs_modulus": Form("Young's modulus", "Pa"),
        "poissons_ratio": Form("Poisson's ratio"),
        "density": Form("density", "kg/m^3"),
        "velocity": Form("initial velocity", "m/s"),
        "atom_id": Form("atom id", kind="count"),
        "atom_type": Form("atom type", kind="count"),
    },
    "pair-coeffs": {
        "type_1": Form("atom type I", kind="count"),
        "type_2": Form("atom type J", kind="count"),
        "contact": Form("first contact", kind="count"),
        "contacts": Form("number of contacts", kind="count"),
        "stiffness": Form("stiffness", "N/m^(n-1)"),
        "exponent": Form("n"),
        "lammps_model": Form("LAMMPS model", kind="text"),
        "lammps_k_n": Form("LAMMPS k_n", digits=6),
        "lammps_damping": Form("LAMMPS damping coefficient", digits=6),
        "coefficients": Form("arguments of pair_coeff I J", kind="text"),
    },
    "angles": {
        "contact": Form("contact", kind="count"),
        "stiffness": Form("stiffness", "N/m^(n-1)"),
        "angle": Form("angle", "deg"),
        "tolerance": Form("angle tolerance", "deg", digits=3),
        "stiffness_slope": Form("d ln(stiffness)/d(angle)", "1/deg", digits=4),
    },
    "stiffness-curve": {
        "angle": Form("angle", "deg"),
        "stiffness_paper": Form("stiffness by eq. 3.1", "N/m^1.5"),
        "stiffness_exact": Form("stiffness by Hertz' exact law", "N/m^1.5"),
        "paper_over_exact": Form("eq. 3.1 over exact"),
        "slope_paper": Form("d ln(stiffness)/d(angle), eq. 3.1", "1/deg"),
        "slope_exact": Form("d ln(stiffness)/d(angle), exact", "1/deg"),
    },
}
