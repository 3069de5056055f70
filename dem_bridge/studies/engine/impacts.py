"""The impacts of the study "engine": what a deck writes for each, and the physics that these words mean.

Two equal spheres meet, or one sphere meets a frozen sphere or a plane; all partners have the same closing speed. The
force is ``elastic(d) + damping(d) d'`` with the overlap d, whose parameters are a :class:`Contact`. The formulas are
those of the manual (*pair_style granular*, *pair_style gran/hooke*, *fix wall/gran*).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from dem_bridge.physics.adhesion import AdhesionLaw, pull_off_force
from dem_bridge.physics.damped_impact import alpha_of_restitution, alpha_of_tsuji

DENSITY = 2700.0
#: m, and m/s at which they close: spheres, and grains of powder whose adhesion matters
RADIUS, SPEED = 2.5e-3, 4.0
POWDER_RADIUS, POWDER_SPEED = 2.5e-6, 0.19
YOUNG, POISSON = 7e10, 0.33
#: E* of two bodies of this material, and of a body on a wall of the same material
MODULUS = YOUNG / (2.0 * (1.0 - POISSON**2))
#: J/m^2, LAMMPS' gamma
SURFACE_ENERGY = 0.1
LAWS = ("hooke", "hertz", "hertz/material", "dmt", "jkr")
ADHESIVE: tuple[AdhesionLaw, ...] = ("dmt", "jkr")
#: "none" is the word of the manual; "undamped" is ``damping velocity`` with the coefficient 0
DAMPINGS = ("none", "undamped", "velocity", "mass_velocity", "viscoelastic", "tsuji", "coeff_restitution")
CLASSIC = ("hooke", "hooke/history", "hertz/history")
CLASSIC_DAMPINGS = ("undamped", "mass_velocity")
PARTNERS = ("pair", "frozen", "wall", "region")
#: spring constant of hooke, N/m, and stiffness of the classic Hertz styles and of hertz, Pa
SPRING, HERTZ = 1e6, 4.0 / 3.0 * MODULUS
#: s of :mod:`dem_bridge.physics.adhesion` where a JKR contact begins, and where the textbook's opens
TOUCH, BREAK = math.cbrt(4.0 / 3.0), math.cbrt(1.0 / 3.0)
#: coefficient of restitution that decks with tsuji and coeff_restitution write
WRITTEN = 0.5
#: further coefficients, for Hertz contacts of two spheres
WRITTEN_TOO = (0.1, 0.3, 0.7, 0.9)


@dataclass(frozen=True, kw_only=True)
class Contact:
    """Physics of one impact, SI: ``elastic(d) + damping d^power d'``; with ``clip`` it is at least zero."""

    mass: float
    """Effective mass, kg."""
    speed: float
    """Closing speed, m/s."""
    stiffness: float
    """beta of ``beta d^(n-1)``, N/m^(n-1)."""
    exponent: float
    """n."""
    damping: float
    power: float
    clip: bool
    adhesion: AdhesionLaw | None = None
    pull_off: float = 0.0
    """N."""
    breaks: float = BREAK
    """s of :mod:`dem_bridge.physics.adhesion` at which a JKR contact opens."""

    @property
    def length(self) -> float:
        """Return the length of the JKR contact, m."""
        return math.pow(self.pull_off / self.stiffness, 2.0 / 3.0)


@dataclass(frozen=True, kw_only=True)
class Impact:
    """One impact in LAMMPS' words."""

    law: str
    """Normal model of ``granular``, or the name of a classic style."""
    damping: str
    partner: str
    """"pair", "frozen", "wall" or "region"."""
    clip: bool = False
    classic: bool = False
    written: float = WRITTEN
    """Coefficient of restitution in the deck, if the damping has one."""

    @property
    def name(self) -> str:
        """Return the name of its files."""
        e = f"-{self.written:g}" if self.written != WRITTEN else ""
        words = ("classic" * self.classic, self.law, self.damping, self.partner, "clipped" * self.clip)
        return "-".join(filter(None, words)).replace("/", "_") + e

    @property
    def style(self) -> str:
        """Return the style of the contact in LAMMPS' words."""
        fix = {"wall": "fix wall/gran", "region": "fix wall/gran/region"}.get(self.partner)
        if fix:
            return f"{fix} {self.law if self.classic else 'granular'}"
        return f"pair_style {'gran/' + self.law if self.classic else 'granular'}"

    @property
    def words(self) -> str:
        """Return law and damping in a few words."""
        law = "" if self.classic else f"{self.law}, "
        restitution = f" {self.written:g}" if self.damping in ("tsuji", "coeff_restitution") else ""
        return f"{law}{self.damping}{restitution}{', limit_damping' * self.clip}"

    @property
    def adhesion(self) -> AdhesionLaw | None:
        """Return "dmt" or "jkr", None for other laws."""
        return next((law for law in ADHESIVE if law == self.law), None)

    @property
    def radius(self) -> float:
        """Return the radius of the bodies, m."""
        return POWDER_RADIUS if self.adhesion else RADIUS

    @property
    def mass(self) -> float:
        """Return the mass of one body, kg."""
        return 4.0 / 3.0 * math.pi * self.radius**3 * DENSITY

    @property
    def flat(self) -> bool:
        """Return True if the body meets a plane."""
        return self.partner in ("wall", "region")

    @property
    def linear(self) -> bool:
        """Return True if the elastic force is linear in the overlap."""
        return self.law in ("hooke", "hooke/history")

    @property
    def coefficient(self) -> float:
        """Return the damping coefficient that the deck writes."""
        if self.damping in ("tsuji", "coeff_restitution"):
            return self.written
        base = 9.5e-7 if self.adhesion else 4.05 if self.linear else 10.0
        if self.damping == "velocity":
            return base
        # about the same damping for two spheres, whose effective mass is half of one's
        per_mass = base / (0.5 * self.mass)
        if self.damping == "mass_velocity":
            # of classic Hertz, the force has the factor sqrt(R d)
            return per_mass / (1e-4 if self.law == "hertz/history" else 1.0)
        if self.damping == "viscoelastic":
            return per_mass / (8e-8 if self.adhesion else 2e-4)
        return 0.0

    @property
    def contact(self) -> Contact:
        """Return the physics that the words mean."""
        radius = self.radius if self.flat else 0.5 * self.radius
        mass = 0.5 * self.mass if self.partner == "pair" else self.mass
        root, n = math.sqrt(radius), 2.0 if self.linear else 2.5
        beta, eta = SPRING if self.linear else HERTZ * root, self.coefficient
        damping, power = {
            "velocity": (eta, 0.0),
            "mass_velocity": (eta * mass * (root if self.law == "hertz/history" else 1.0), 0.0),
            "viscoelastic": (eta * mass * root, 0.5),
        }.get(self.damping, (0.0, 0.0))
        if self.law == "hertz/history" and damping:
            power = 0.5
        if self.damping in ("tsuji", "coeff_restitution"):
            alpha = alpha_of_tsuji(eta) if self.damping == "tsuji" else alpha_of_restitution(eta, exponent=n)
            damping, power = alpha * math.sqrt(mass * beta), 0.5 * (n - 2.0)
        pull = pull_off_force(self.adhesion, radius=radius, surface_energy=SURFACE_ENERGY) if self.adhesion else 0.0
        return Contact(
            mass=mass,
            speed=POWDER_SPEED if self.adhesion else SPEED,
            stiffness=beta,
            exponent=n,
            damping=damping,
            power=power,
            clip=self.clip,
            adhesion=self.adhesion,
            pull_off=pull,
        )

    @property
    def law_words(self) -> str:
        """Return the law as a deck writes it, for ``pair_coeff`` or a wall."""
        limit = " limit_damping" * self.clip
        if self.classic:
            stiffness = SPRING if self.linear else HERTZ
            return f"{stiffness!r} NULL {self.coefficient!r} NULL 0 0{limit}"
        eta = repr(self.coefficient)
        numbers = {
            "hooke": f"{SPRING!r} {eta}",
            "hertz": f"{HERTZ!r} {eta}",
            "hertz/material": f"{YOUNG!r} {eta} {POISSON!r}",
        }.get(self.law, f"{YOUNG!r} {eta} {POISSON!r} {SURFACE_ENERGY!r}")
        word = "velocity" if self.damping == "undamped" else self.damping
        # releases of 2021 keep JKR's own history only beside that of a tangential model
        tangential = "linear_history 0 0 0" if self.law == "jkr" else "linear_nohistory 0 0"
        return f"{self.law} {numbers} tangential {tangential} damping {word}{limit}"


@dataclass(frozen=True, kw_only=True)
class Steps:
    """Time steps of an impact."""

    dt: float
    """s."""
    count: int
    every: int
    """Steps between two rows of the dump."""
    gap: float
    """Clearance at the start, m: a share of a step's way, so that no touch falls on a step."""


def catalogue() -> Iterator[Impact]:
    """Yield every impact: all laws, dampings, partners and clips, and more coefficients of restitution."""
    for partner in PARTNERS:
        for clip in (False, True):
            for law in LAWS:
                for damping in DAMPINGS:
                    yield Impact(law=law, damping=damping, partner=partner, clip=clip)
            for law in CLASSIC:
                for damping in CLASSIC_DAMPINGS:
                    yield Impact(law=law, damping=damping, partner=partner, clip=clip, classic=True)
    for damping in ("tsuji", "coeff_restitution"):
        for written in WRITTEN_TOO:
            yield Impact(law="hertz/material", damping=damping, partner="pair", written=written)


def deck_of(impact: Impact, steps: Steps) -> str:
    """Return the commands of one impact, which write ``NAME.dump``."""
    contact = impact.contact
    single, radius = impact.flat, impact.radius
    size, first = 16.0 * radius, (1.0 if single else 2.0) * radius + steps.gap
    speed = 0.5 * contact.speed if impact.partner == "pair" else contact.speed
    lines = [
        "units si",
        "atom_style sphere",
        "atom_modify map array sort 0 0.0",
        "boundary f f f",
        "newton on",
        "comm_modify vel yes",
        f"region box block {-size!r} {size!r} {-size!r} {size!r} {-size!r} {size!r}",
        "create_box 1 box",
        f"create_atoms 1 single {first!r} 0 0",
        *([] if single else ["create_atoms 1 single 0 0 0"]),
        f"set group all diameter {2.0 * radius!r} density {DENSITY!r}",
        f"set atom 1 vx {-speed!r}",
        *([f"set atom 2 vx {speed!r}"] if impact.partner == "pair" else []),
        f"neighbor {radius!r} bin",
        "neigh_modify delay 0 every 1 check yes",
    ]
    if single:
        lines += ["region plane plane 0 0 0 1 0 0"] if impact.partner == "region" else []
        lines += [f"pair_style zero {radius!r}", "pair_coeff * *"]
        place = "region plane" if impact.partner == "region" else "xplane 0 NULL"
        lines.append(f"{impact.style.replace('fix ', 'fix wall all ')} {impact.law_words} {place}")
    elif impact.classic:
        lines += [f"{impact.style} {impact.law_words}", "pair_coeff * *"]
    else:
        lines += [impact.style, f"pair_coeff * * {impact.law_words}"]
    lines += ["group moving id 1"] if impact.partner == "frozen" else []
    lines += ["group held id 2", "fix held held freeze"] if impact.partner == "frozen" else []
    lines += [
        f"fix motion {'moving' if impact.partner == 'frozen' else 'all'} nve",
        f"timestep {steps.dt!r}",
        f"dump motion all custom {steps.every} {impact.name}.dump id x vx",
        "dump_modify motion sort id format float %.17g",
        f"thermo {steps.count}",
        f"run {steps.count}",
    ]
    return "".join(f"{line}\n" for line in lines)
