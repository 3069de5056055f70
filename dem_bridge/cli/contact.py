"""The command ``dem-bridge contact``: stiffness, times, steps and coefficients of restitution of one contact."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

import dem_bridge
from dem_bridge.cli.options import AS_JSON
from dem_bridge.cli.parameters import POSITIVE, Limits, Option, make_command, numbers, print_json

if TYPE_CHECKING:
    from dem_bridge.scene.contact_numbers import ContactNumbers

_POISSON = Limits("a number above -1 and up to 0.5", above=-1.0, at_most=0.5)
_RESTITUTION = Limits("a number from 0.05 to 1", at_least=0.05, at_most=1.0)
_ERRORS = Limits("numbers from 1e-8 to 0.1", at_least=1e-8, at_most=0.1)


def _given(name: str, text: str, flag: str, *, limits: Limits = POSITIVE, **shown: Any) -> Option:
    """Return the option of a number that must be given, with a short flag and one of its name."""
    flags = (flag, f"--{name.replace('_', '-')}")
    return Option(name, text, float, limits=limits, flags=flags, required=True, **shown)


@make_command(
    "contact",
    _given("youngs_modulus", "Young's modulus, Pa.", "--E", unit="Pa"),
    _given("poissons_ratio", "Poisson's ratio.", "--nu", metavar="NU", limits=_POISSON),
    _given("density", "Density, kg/m^3.", "--rho", metavar="RHO"),
    _given("radius", "Radius of the sphere, m.", "--R", unit="m"),
    _given("speed", "Speed of approach, m/s.", "--v", unit="m/s"),
    Option(
        "restitution",
        "Wanted coefficient of restitution.",
        float,
        metavar="E",
        limits=_RESTITUTION,
        default="1",
        flags=("--e", "--restitution"),
    ),
    Option(
        "partner",
        "What the sphere hits: an equal sphere, a plane of its material, or a rigid plane.",
        ("sphere", "wall", "rigid-wall"),
        default="sphere",
    ),
    Option(
        "errors",
        "Permissible errors for which time steps are computed.",
        numbers,
        metavar="A,B,...",
        limits=_ERRORS,
        default="1e-2,1e-3,1e-4",
    ),
    AS_JSON,
)
def contact(as_json: bool = False, **settings: Any) -> None:
    """Compute the numbers of one contact of spheres.

    These are stiffness, overlap, force, contact time and Rayleigh time, the time steps for wanted errors, and what to
    write for a coefficient of restitution in codes that run here.
    """
    answer = dem_bridge.contact_numbers(**settings)
    if as_json:
        print_json(answer.as_json())
        return
    for line in _lines(answer):
        click.echo(line)


def _lines(answer: ContactNumbers) -> list[str]:
    """Return the answer in lines of at most 80 columns."""
    lines = [
        f"stiffness        {answer.stiffness:.10g} N/m^1.5",
        f"effective mass   {answer.mass:.10g} kg",
        f"largest overlap  {answer.peak_overlap:.10g} m (elastic)",
        f"largest force    {answer.peak_force:.10g} N (elastic)",
        f"contact time     {answer.contact_time:.10g} s (elastic)",
        f"                 {answer.damped_contact_time:.10g} s with e = {answer.restitution:g}, not clipped",
        f"Rayleigh time    {answer.rayleigh_time:.10g} s, {answer.rayleigh_share:.3g} of the contact time",
        "",
        f"largest time step of velocity-Verlet with e = {answer.restitution:g}, not clipped",
        "error     of e (s)    steps  Rayleigh   of positions (s)    steps  Rayleigh",
    ]
    for step in answer.steps:
        shares = (f"{100.0 * dt / answer.rayleigh_time:.3g} %" for dt in (step.restitution, step.position))
        counts = (
            f"{count:.0f}" if count < 1e6 else f"{count:.1e}" for count in (step.restitution_steps, step.position_steps)
        )
        (count_e, count_x), (share_e, share_x) = counts, shares
        head = f"{step.error:<7g} {step.restitution:>10.3e} {count_e:>8} {share_e:>9}"
        lines.append(f"{head} {step.position:>18.3e} {count_x:>8} {share_x:>9}")
    lines += [
        "errors: e absolute; positions at the end of the contact, of the largest overlap",
        "",
        "coefficient of restitution       clipped      write  result if e is written",
    ]
    for row in answer.written:
        write = "-" if row.write is None else f"{row.write:.6f}"
        lines.append(f"{row.code:<32} {'yes' if row.clip else 'no':>7} {write:>10} {row.obtained:>23.6f}")
    lines.append(f"force written by hand: {answer.damping:.10g} N s/m^(5/4) times d^(1/4) d'")
    lines.append("clipped: limit_damping (LAMMPS), limitForce on (LIGGGHTS); -: nothing gives it")
    return lines
