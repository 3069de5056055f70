"""What in a script is possible and unlikely: sizes that no granular chain has, and runs in which little happens."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dem_bridge.foundation.wording import number, share
from dem_bridge.judging.check.laboratory import Laboratory
from dem_bridge.judging.deck import UserDeck
from dem_bridge.lmp.reader.evaluation import UNITS
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.timescales import contact_time_of

#: largest overlap, relative to the radius of the smaller body, at which Hertz's law is a good one
LARGEST_OVERLAP_OF_RADIUS = 0.03
#: overlap at the start, relative to the radius, above which places or radii are wrong
LARGEST_OVERLAP_AT_START = 0.1
#: nearest bodies of each one among which the largest overlap at the start is looked for
_NEIGHBOURS_AT_START = 12
#: largest step, relative to the shortest contact time, by the rule of thumb of DEM codes
LARGEST_STEP_OF_CONTACT_TIME = 0.05
#: densities of solids, kg/m^3: aerogels to osmium; Young's moduli, Pa: gels to diamond
DENSITIES_KG_PER_M3, MODULI_PA = (1.0, 23_000.0), (1e3, 1.3e12)
#: relative difference of a mixed stiffness from that of two springs in series that is worth a look
LARGEST_DIFFERENCE_OF_MIXING = 0.05
#: part of the largest velocity below which a body has not moved; overlaps go as its power 2/n
SHARE_OF_SPEED_AT_REST = 1e-6
#: marks a deck whose radius this program chose
_SURROGATE = "surrogate radius"


@dataclass(frozen=True, kw_only=True)
class Plausibility:
    """One property of a script beside what is usual."""

    name: str
    value: float
    usual: str
    sentence: str
    look: bool

    def as_json(self) -> dict[str, object]:
        """Return the fields; a value that is not finite becomes null."""
        value = self.value if math.isfinite(self.value) else None
        return {
            "name": self.name,
            "value": value,
            "usual": self.usual,
            "outcome": "look" if self.look else "ok",
            "sentence": self.sentence,
        }


def plausibility_of(lab: Laboratory, text: str) -> tuple[Plausibility, ...]:
    """Return the properties of a script, those that are unlikely first."""
    deck, scene = lab.subject.deck, lab.scene
    physical = not lab.subject.of_scene and _SURROGATE not in text
    entries = list(_of_material(deck)) if physical else []
    if scene is None and (start := start_overlap(deck)) is not None and start.part > LARGEST_OVERLAP_OF_RADIUS:
        text = f"{start.sentence} (are places and diameters right?)"
        entries.append(Plausibility(name="start", value=start.part, usual="0", look=True, sentence=text))
    if scene is not None:
        entries = [
            *_of_contacts(lab, scene, physical),
            *_of_start(deck, scene, physical),
            *_of_end(lab, scene),
            *entries,
        ]
        entries += _of_mixing(deck)
    return tuple(sorted(entries, key=lambda entry: not entry.look))


@dataclass(frozen=True, kw_only=True)
class StartOverlap:
    """The largest overlap of two bodies at the start."""

    part: float
    """Overlap relative to the radius of the smaller body."""
    atoms: tuple[int, int]

    @property
    def sentence(self) -> str:
        """The overlap in words."""
        first, second = self.atoms
        return f"atoms {first} and {second} begin with an overlap of {100.0 * self.part:.3g} % of the smaller radius"


def start_overlap(deck: UserDeck) -> StartOverlap | None:
    """Return the largest overlap of two bodies at the start, also off a line; None if there is none or no body is read.

    Images of bodies in a periodic box are not looked at.
    """
    from scipy.spatial import KDTree  # takes a while to import, and few scripts need it

    atoms = list(deck.state.particles.atoms.values())
    if len(atoms) < 2:
        return None
    radii = np.array([atom.radius for atom in atoms])
    tree = KDTree(np.array([atom.place for atom in atoms]))
    apart, places = tree.query(tree.data, k=min(len(atoms), _NEIGHBOURS_AT_START))
    part = (radii[:, None] + radii[places] - apart) / np.minimum(radii[:, None], radii[places])
    part[places == np.arange(len(atoms))[:, None]] = -np.inf
    part = np.round(part, 9)  # of equal ones the first counts
    first, column = np.unravel_index(np.argmax(part), part.shape)
    if not part[first, column] > 0.0:
        return None
    pair = sorted((atoms[first].number, atoms[places[first, column]].number))
    return StartOverlap(part=float(part[first, column]), atoms=(pair[0], pair[1]))


def _of_contacts(lab: Laboratory, scene: Scene, physical: bool) -> Iterator[Plausibility]:
    deck, prescan = lab.subject.deck, lab.prescan
    deepest = 0.0 if prescan is None else float(np.max(prescan.peak_overlap, initial=0.0))
    if prescan is not None and deepest == 0.0:
        yield Plausibility(
            name="contacts", value=0.0, usual="1 or more", look=True, sentence="no contact closes during the run"
        )
        return
    if physical and prescan is not None and (radii := _radii(deck)):
        part = deepest / min(radii)
        look = part > LARGEST_OVERLAP_OF_RADIUS
        text = f"largest overlap {share(part)} of the radius"
        more = ", and Hertz's law holds for small ones (are stiffness, speed and units right?)" if look else ""
        yield Plausibility(
            name="overlap",
            value=part,
            usual=f"up to {share(LARGEST_OVERLAP_OF_RADIUS)}",
            look=look,
            sentence=text + more,
        )
    contact, unit = contact_time_of(scene), lab.subject.time_unit
    if contact and deck.dt:
        part = deck.dt / contact
        yield Plausibility(
            name="step",
            value=part,
            usual=f"up to {share(LARGEST_STEP_OF_CONTACT_TIME)} of the shortest contact",
            look=part > LARGEST_STEP_OF_CONTACT_TIME,
            sentence=f"the step is {_multiple(part)} the shortest contact time, {number(contact)} {unit}",
        )
    if physical and any(n == 2.0 for n in scene.contacts.exponent):
        text = "hooke: the force is proportional to the overlap; that of spheres goes as its power 3/2 (hertz)"
        yield Plausibility(name="exponent", value=2.0, usual="2.5", look=True, sentence=text)
    damping = scene.damping
    if damping is not None and not damping.clip and damping.law in ("dashpot", "mass_velocity"):
        text = "damping without limit_damping pulls when a contact opens"
        yield Plausibility(name="tension", value=math.nan, usual="limit_damping", look=True, sentence=text)


def _multiple(part: float) -> str:
    """Return a step as a part of a time, or as a multiple of it.

    Examples
    --------
    >>> _multiple(0.017), _multiple(1.66)
    ('1.7 % of', '1.7 times')
    """
    return f"{share(part)} of" if part <= 1.0 else f"{part:.2g} times"


def _of_start(deck: UserDeck, scene: Scene, physical: bool) -> Iterator[Plausibility]:
    overlap = -float(np.min(scene.contacts.gap, initial=0.0))
    if physical and overlap > 0.0 and scene.precompression == 0.0 and scene.gravity == 0.0 and (radii := _radii(deck)):
        text = f"bodies begin with overlaps of up to {share(overlap / min(radii))} of the radius, which no load holds"
        yield Plausibility(name="start", value=overlap / min(radii), usual="0", look=True, sentence=text)
    if not any(scene.velocity) and not scene.gravity and not scene.drive and overlap == 0.0:
        yield Plausibility(
            name="motion", value=0.0, usual="a velocity", look=True, sentence="nothing moves at the start"
        )


def _of_end(lab: Laboratory, scene: Scene) -> Iterator[Plausibility]:
    if scene.n_body < 3 or scene.gravity or scene.precompression or scene.drive or lab.prescan is None:
        return
    # a body moves if it does at the start or if one of its contacts closes, whatever the samples show
    peak, c = lab.prescan.peak_overlap, scene.contacts
    closed = peak > SHARE_OF_SPEED_AT_REST ** (2.0 / c.exponent) * float(np.max(peak, initial=0.0))
    moved = np.append(np.array(scene.velocity) != 0.0, True)
    moved[c.left[closed]] = moved[c.right[closed]] = True
    moved = moved[:-1]
    walls = np.maximum(c.left, c.right) >= scene.n_body
    if closed.any() and np.any(walls & (peak == 0.0)):
        text = "a wall is never touched" if np.sum(walls) == 1 else "one of the walls is never touched"
        yield Plausibility(name="wall", value=0.0, usual="1 or more contacts", look=True, sentence=text)
    if not moved.all() and closed.any():
        rest = f"{int(np.sum(~moved))} of {scene.n_body} bodies"
        text = f"{rest} have not moved when the run ends ({number(scene.duration)} {lab.subject.time_unit})"
        yield Plausibility(
            name="end", value=float(np.mean(moved)), usual="all", look=bool(not moved[-1]), sentence=text
        )


def _of_material(deck: UserDeck) -> Iterator[Plausibility]:
    """Yield densities and moduli beyond those of solids; a wrong unit style shows in them."""
    if deck.state.units == "lj":
        return
    length, time, mass = UNITS.get(deck.state.units, (1.0, 1.0, 1.0))
    densities = [
        atom.mass * mass / (4.0 / 3.0 * math.pi * (atom.radius * length) ** 3)
        for atom in deck.state.particles.atoms.values()
        if atom.radius > 0.0 and not (atom.weighed and atom.density == 1.0)
    ]
    if densities and not DENSITIES_KG_PER_M3[0] <= min(densities) <= max(densities) <= DENSITIES_KG_PER_M3[1]:
        odd = next(value for value in densities if not DENSITIES_KG_PER_M3[0] <= value <= DENSITIES_KG_PER_M3[1])
        text = f"a density of {number(odd)} kg/m^3 in units {deck.state.units}: no solid has it (are the units right?)"
        yield Plausibility(name="density", value=odd, usual="100 to 23000 kg/m^3", look=True, sentence=text)
    pressure = mass / (length * time**2)
    for command in deck.commands:
        words = command.rest
        model = next((k for k, word in enumerate(words) if word in ("hertz/material", "dmt", "jkr")), len(words))
        try:
            modulus = float(words[model + 1]) * pressure
        except (IndexError, ValueError):
            continue
        if modulus > 0.0 and not MODULI_PA[0] <= modulus <= MODULI_PA[1]:
            text = f"a Young's modulus of {number(modulus)} Pa in units {deck.state.units} (are the units right?)"
            yield Plausibility(name="modulus", value=modulus, usual="1e3 to 1.3e12 Pa", look=True, sentence=text)
            return


def _of_mixing(deck: UserDeck) -> Iterator[Plausibility]:
    """Yield mixed stiffnesses that are not those of two springs in series."""
    if deck.read is None:
        return
    for text in deck.read.mixed:
        words = text.split()
        pair = f"types {words[1]} and {words[2]} have no pair_coeff"
        if words[3] not in ("hertz", "hooke"):
            modulus, unit = float(words[4]), "Pa" if deck.state.units == "si" else f"in units {deck.state.units}"
            said = f"{pair}: LAMMPS mixes E = {number(modulus)} {unit} from both, as Hertz's law does"
            yield Plausibility(name="mixing", value=modulus, usual="a line for the pair", look=False, sentence=said)
            return
        first, second = (_own_stiffness(deck, word) for word in words[1:3])
        mixed = float(words[4])
        series = 2.0 * first * second / (first + second) if first and second else math.nan
        if abs(mixed / series - 1.0) > LARGEST_DIFFERENCE_OF_MIXING:
            said = f"{pair}: LAMMPS takes K = {number(mixed)}"
            said += f", the geometric mean; two springs in series have {number(series)}"
            yield Plausibility(name="mixing", value=mixed, usual=number(series), look=True, sentence=said)
            return


def _own_stiffness(deck: UserDeck, kind: str) -> float:
    """Return the stiffness of the pair of a type with itself; 0 if no line states it."""
    for command in deck.commands:
        if command.name == "pair_coeff" and command.rest[:2] == (kind, kind):
            return float(command.rest[3])
    return 0.0


def _radii(deck: UserDeck) -> list[float]:
    """Return the radii of all bodies, m."""
    length = UNITS.get(deck.state.units, (1.0, 1.0, 1.0))[0]
    return [atom.radius * length for atom in deck.state.particles.atoms.values()]
