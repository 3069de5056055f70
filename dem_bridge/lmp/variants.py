"""Other decks for the same scene, as another author might write them: each function changes a Deck.

Each variant edits the deck's text, so that everything else stays the same, bit for bit. UnsupportedScene is raised if a
variant cannot express the scene. Formulas: LAMMPS manual, *pair_style gran/hertz/history* and *fix wall/gran*.

Pair styles with one coefficient for all contacts encode the stiffness of each by radii. ``gran/hertz/history`` has
F = Kn sqrt(R_eff) overlap^1.5 with 1/R_eff = 1/R_i + 1/R_(i+1). Contact i has its beta if
u_i + u_(i+1) = (Kn / beta_i)^2, where u = 1/R. The first radius determines all others, and only an interval of it makes
all of them positive; Kn scales them all. If stiffnesses are scattered at random, the interval is empty after a few
contacts.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UnsupportedScene
from dem_bridge.lmp.deck import Deck
from dem_bridge.lmp.pair_coefficients import coefficients, damping_model, line_order
from dem_bridge.physics.contact_law import Floats
from dem_bridge.scene.scene import Scene

#: smallest ratio of a radius to the overlap of its contacts, so that bodies that are not neighbours never touch
MARGIN = 1.25
#: number of first radii that are tried within the interval
_TRIALS = 255


def encoded_radii(stiffness: Floats, overlap: Floats) -> tuple[Floats, float] | None:
    """Return radii (m) and Kn (N/m^2) that give each contact its stiffness, or None if there are none.

    Of all solutions the one with the shortest chain is returned, because round-off grows with positions.

    Parameters
    ----------
    stiffness : ndarray
        Stiffness beta of each contact, N/m^1.5, ``(n,)``.
    overlap : ndarray
        Largest overlap of each contact, m, ``(n,)``.

    Returns
    -------
    tuple or None
        Radii, ``(n + 1,)``, and Kn.

    Examples
    --------
    >>> radii, kn = encoded_radii(np.array([4e9, 4e9, 8e9]), np.full(3, 1e-6))
    >>> kn * np.sqrt(1.0 / (1.0 / radii[1:] + 1.0 / radii[:-1])) / [4e9, 4e9, 8e9]
    array([1., 1., 1.])
    >>> encoded_radii(np.array([4e9, 1e9, 4e9, 1e9, 9e9]), np.full(5, 1e-6)) is None
    True
    """
    if len(stiffness) == 0:
        return None
    target = (float(np.min(stiffness)) / stiffness) ** 2
    sign = np.where(np.arange(len(target) + 1) % 2 == 0, 1.0, -1.0)
    # u_i = sign_i (u_0 - shift_i): positive for even i above, for odd i below the shift
    shift = np.concatenate([[0.0], np.cumsum(sign[:-1] * target)])
    low, high = float(np.max(shift[::2])), float(np.min(shift[1::2]))
    if not low < high * (1.0 - 1e-9):
        return None
    deepest = np.maximum(np.append(overlap, 0.0), np.append(0.0, overlap))
    best, shortest = None, math.inf
    for part in np.arange(1, _TRIALS + 1) / (_TRIALS + 1):
        inverse = _inverse_radii(target, low + part * (high - low))
        if np.min(inverse) <= 0.0:
            continue
        # the largest scale of 1/R that keeps every radius above its lower bound
        needed = float(np.max(MARGIN * deepest * inverse)) or 2.0**-15
        length = needed * float(np.sum(1.0 / inverse))
        if length < shortest:
            best, shortest = (inverse, needed), length
    if best is None:
        return None
    inverse, needed = best
    least = needed / float(np.max(inverse))
    # the smallest radius is a power of two, so that equal radii give exact positions
    radii = 2.0 ** math.ceil(math.log2(least)) * (float(np.max(inverse)) / inverse)
    kn = float(stiffness[0]) * math.sqrt(1.0 / float(radii[0]) + 1.0 / float(radii[1]))
    return radii, kn


def _inverse_radii(target: Floats, first: float) -> Floats:
    """Return 1/R of each body, one after the other, so that each sum of two is exact to its last digit."""
    inverse = [first]
    for total in target.tolist():
        inverse.append(total - inverse[-1])
    return np.array(inverse)


#: classic styles of walls -> exponent n
CLASSIC = MappingProxyType({"hooke": 2.0, "hooke/history": 2.0, "hertz/history": 2.5})
#: gamma_n of undamped classic walls, 1/s or 1/(m s); with 0 many releases give nan (undamped-classic-wall)
SMALLEST_GAMMA = 1e-300
_NO_WALL = "the scene has no wall, which this variant requires"
#: row of an atom in the data file: id, type, diameter, density, x
_ATOM = re.compile(r"^(\d+) (\d+) (\S+) (\S+) (\S+) 0 0$", re.MULTILINE)


def newton_off(deck: Deck) -> Deck:
    """Return the deck with ``newton off``: each rank computes the pairs across its border itself."""
    return _changed(deck, {deck.input_file: _once(r"^newton +on$", "newton          off", deck.files[deck.input_file])})


def with_restart(deck: Deck, *, after: str = "") -> Deck:
    """Return the deck as a run in two parts: halfway LAMMPS writes a restart file, clears its state and reads the file.

    The step of the cut is not a step of a dump, if there is such a step. Pair style and coefficients are repeated:
    LAMMPS (2025-07-22) restores the laws of ``granular``, but with an uninitialised neighbour cutoff, usually 0.

    Parameters
    ----------
    deck : Deck
        The deck.
    after : str
        Lines that follow ``read_restart``.
    """
    cut = _between_dumps(deck)
    lines = deck.files[deck.input_file].splitlines()
    box = next(i for i, line in enumerate(lines) if line.startswith("units "))
    cell = next(i for i, line in enumerate(lines) if line.startswith("neighbor "))
    restart, dump = f"restart.{deck.name}", f"dump.{deck.name}.2.bin"
    again = [line for line in lines[cell:] if not line.startswith(("variable ", "#", "run "))]
    # LAMMPS appends to text dumps only; "append yes" overwrites a binary one
    again = [line.replace("${dump}", dump).replace(" first yes ", " first no ") for line in again]
    first = [re.sub(r"^run .*", f"run             {cut}", line) for line in lines]
    text = [
        *first,
        "",
        f"# halfway, at step {cut} of {deck.schedule.steps}, the state is written to a restart file and read again",
        f"write_restart   {restart}",
        "clear",
        *(line for line in lines[box:cell] if line.startswith("atom_modify")),
        f"read_restart    {restart}",
        *([after] if after else []),
        *again,
        "run             ${steps} upto",
    ]
    return replace(_changed(deck, {deck.input_file: "\n".join(text) + "\n"}), more_dumps=(dump,))


def frozen_walls(deck: Deck, scene: Scene) -> Deck:
    """Return the deck with ``fix freeze`` for the bodies that are its walls, which gives them an infinite mass.

    Their force in the dump, which the fix sets to zero, is the reaction again.
    """
    if scene.wall_left is None and scene.wall_right is None:
        raise UnsupportedScene(_NO_WALL)
    if scene.damping is not None and scene.damping.law != "dashpot":
        raise UnsupportedScene("the pair coefficients of the deck have the effective mass of walls without fix freeze")
    lines = (
        "fix             before walls store/force",
        "fix             frozen walls freeze",
        "variable        reaction atom f_before[1]",
        "fix             reaction walls addforce v_reaction 0 0",
        "timestep ",
    )
    return _changed(deck, {deck.input_file: _once(r"^timestep ", "\n".join(lines), deck.files[deck.input_file])})


def flat_walls(deck: Deck, scene: Scene, *, style: str = "granular", region: bool = False) -> Deck:
    """Return the deck with planes of ``fix wall/gran`` as walls, with K = beta / sqrt(R) because R_eff = R for a plane.

    The frozen bodies remain as markers that nothing touches; their force in the dump is the reaction of their plane.

    Parameters
    ----------
    deck : Deck
        The deck.
    scene : Scene
        Its scene.
    style : str
        "granular", or one of :data:`CLASSIC`.
    region : bool
        Whether the plane is a region of ``fix wall/gran/region``.
    """
    if scene.wall_left is None and scene.wall_right is None:
        raise UnsupportedScene(_NO_WALL)
    data, mark = f"data.{deck.name}", deck.types + 1
    last = len(deck.line)
    walls = [("left", 1, len(scene.stiffness))] if scene.wall_left is not None else []
    walls += [("right", last, scene.n_contact - 1)] if scene.wall_right is not None else []
    marks = {atom for _, atom, _ in walls}

    def marked(row: re.Match[str]) -> str:
        kind = mark if int(row[1]) in marks else row[2]
        return f"{row[1]} {kind} {row[3]} {row[4]} {row[5]} 0 0"

    rows = _ATOM.sub(marked, deck.files[data])
    rows = _once(rf"^{deck.types} atom types$", f"{mark} atom types", rows)
    lines = []
    for side, atom, contact in walls:
        inward = 1.0 if side == "left" else -1.0
        plane = float(deck.line[atom - 1]) + inward * deck.surrogate_radius
        law = flat_law(scene, contact, deck.surrogate_radius, style)
        where = f"xplane {f'{plane!r} NULL' if side == 'left' else f'NULL {plane!r}'}"
        if region:
            lines.append(f"region          plane_{side} plane {plane!r} 0 0 {inward:g} 0 0")
            where = f"region plane_{side}"
        lines += [
            f"fix             {side} bodies wall/gran{'/region' * region} {style} {law} {where} contacts",
            f"compute         push_{side} bodies reduce sum f_{side}[2]",
            f"variable        reaction_{side} equal -c_push_{side}",
            f"group           mark_{side} id {atom}",
            f"fix             mark_{side} mark_{side} addforce v_reaction_{side} 0 0",
        ]
    text = deck.files[deck.input_file]
    for side in (side for side, _, _ in walls):
        # the pair of types may be that of other contacts too
        text = re.sub(rf"^pair_coeff .*# wall_{side}: .*\n", "", text, flags=re.MULTILINE)
    text = _once(r"^timestep ", "\n".join([*lines, "timestep "]), text)
    return replace(_changed(deck, {deck.input_file: text, data: rows}), types=mark)


def flat_law(scene: Scene, contact: int, radius: float, style: str) -> str:
    """Return the law of a body of ``radius`` (m) on a plane: R_eff = R and m_eff = m."""
    c, (damping, etas) = scene.contacts, damping_model(scene)
    body = min(int(c.left[contact]), int(c.right[contact]))
    body = body if body < scene.n_body else int(c.right[contact])
    mass, clip = float(scene.mass[body]), scene.damped and c.clip
    beta, n, damped, power = (float(x[contact]) for x in (c.stiffness, c.exponent, c.damping, c.damping_power))
    if style == "granular":
        eta = float(etas[contact])
        if damping == "viscoelastic":
            eta, damping = (eta / mass, damping) if eta * power > 0.0 else (eta, "velocity")
        return coefficients(beta, n, eta, radius, damping=damping, clip=clip, pull_off=float(c.pull_off[contact]))
    if c.pull_off[contact] > 0.0:
        raise UnsupportedScene(f"a wall {style} has no adhesion")
    if n != CLASSIC[style]:
        raise UnsupportedScene(f"a wall {style} has n = {CLASSIC[style]} only")
    if damped > 0.0 and power != n - 2.0:
        raise UnsupportedScene(f"a wall {style} has no dashpot, only damping in proportion to overlap^{n - 2.0:g}")
    # the force of hertz/history is sqrt(R overlap) (Kn overlap + m gamma overlap'), that of hooke the bracket alone
    root = math.sqrt(radius) if n == 2.5 else 1.0
    gamma = damped / (mass * root) or SMALLEST_GAMMA
    return f"{beta / root!r} NULL {gamma!r} NULL 0 0{' limit_damping' * clip}"


def hertz_material(deck: Deck, *, poisson: float = 0.25) -> Deck:
    """Return the deck with ``hertz/material`` in place of ``hertz``: K = (4/3) E / (2 (1 - nu^2)) for equal materials.

    Parameters
    ----------
    deck : Deck
        The deck.
    poisson : float
        Poisson's ratio nu that is written; E follows from it and the stiffness.
    """

    def of_material(row: re.Match[str]) -> str:
        return f"{row[1]}hertz/material {1.5 * (1.0 - poisson**2) * float(row[2])!r} {row[3]} {poisson!r} "

    text, places = re.subn(
        r"^(pair_coeff +\d+ .*?)hertz (\S+) (\S+) ", of_material, deck.files[deck.input_file], flags=re.MULTILINE
    )
    if not places:
        raise UnsupportedScene("no contact has the model hertz")
    return _changed(deck, {deck.input_file: text})


def hertz_history(deck: Deck, scene: Scene, peak_overlap: NDArray[np.float64]) -> Deck:
    """Return the deck with ``pair_style gran/hertz/history``, which has one Kn: the radii encode the stiffness.

    Parameters
    ----------
    deck : Deck
        The deck.
    scene : Scene
        Its scene.
    peak_overlap : ndarray
        Largest overlap of each contact of the scene, m, ``(n_contact,)``.
    """
    if scene.n_contact == 0:
        raise UnsupportedScene("the scene has no contact, which this variant requires")
    if np.any(scene.contacts.exponent != 2.5):
        raise UnsupportedScene("gran/hertz/history has n = 2.5 only")
    if scene.adhesive:
        raise UnsupportedScene("gran/hertz/history has no adhesion")
    if scene.damped:
        raise UnsupportedScene("gran/hertz/history has one damping coefficient for all, with the effective mass in it")
    order = line_order(scene)
    encoded = encoded_radii(scene.contacts.stiffness[order], peak_overlap[order])
    if encoded is None:
        raise UnsupportedScene("no radii give all contacts their stiffness under one Kn")
    radii, kn = encoded
    line = _places(scene, radii)
    data = f"data.{deck.name}"
    old, lowest, highest = deck.surrogate_radius, float(line[0] - radii[0]), float(line[-1] + radii[-1])

    def sized(row: re.Match[str]) -> str:
        radius, place = float(radii[int(row[1]) - 1]), float(line[int(row[1]) - 1])
        # the density of the same mass; the deck sets the masses
        density = float(row[4]) * (old / radius) ** 3
        return f"{row[1]} 1 {2.0 * radius!r} {density!r} {place!r} 0 0"

    rows = _ATOM.sub(sized, deck.files[data])
    rows = _once(r"^\d+ atom types$", "1 atom types", rows)
    width = float(np.max(radii))
    rows = _once(r"^\S+ \S+ xlo xhi$", f"{lowest - width!r} {highest + width!r} xlo xhi", rows)
    for side in "yz":
        rows = _once(rf"^\S+ \S+ {side}lo {side}hi$", f"{-8.0 * width!r} {8.0 * width!r} {side}lo {side}hi", rows)
    text = re.sub(r"^pair_coeff .*\n", "", deck.files[deck.input_file], flags=re.MULTILINE)
    style = f"pair_style      gran/hertz/history {kn!r} 0 0 0 0 0\npair_coeff      * *"
    text = _once(r"^pair_style .*$", style, text)
    text = _once(r"^# surrogate radius .*$", "# the radii encode the stiffness: Kn sqrt(R_eff) = beta", text)
    return replace(
        _changed(deck, {deck.input_file: text, data: rows}),
        surrogate_radius=float(np.min(radii)),
        encoded_radii=radii,
        line=line,
        types=1,
    )


def _places(scene: Scene, radii: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the centres along x with body 0 at 0, m, walls included."""
    steps = radii[:-1] + radii[1:] + scene.contacts.gap[line_order(scene)]
    place = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(place - place[1] if scene.wall_left is not None else place)


def _between_dumps(deck: Deck) -> int:
    """Return a step near the middle without a dump, if there is one."""
    dumped = deck.schedule.dense_steps
    middle = int(dumped[len(dumped) // 2])
    near = [step for step in (middle + 1, middle - 1) if 0 < step < deck.schedule.steps]
    return next((step for step in near if step not in dumped), middle)


def _changed(deck: Deck, files: dict[str, str]) -> Deck:
    """Return the deck with these files replaced."""
    return replace(deck, files=MappingProxyType({**deck.files, **files}))


def _once(pattern: str, new: str | Callable[[re.Match[str]], str], text: str) -> str:
    """Return ``text`` with the only match of the pattern replaced."""
    put = (lambda _: new) if isinstance(new, str) else new
    changed, count = re.subn(pattern, put, text, flags=re.MULTILINE)
    if count != 1:
        raise ValueError(f"{pattern!r} fits {count} places of the deck; allowed: one")
    return changed
