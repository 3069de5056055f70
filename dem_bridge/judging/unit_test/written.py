"""A scene as a unit test of LAMMPS, whose states and tolerance come from the reference solution.

No LAMMPS takes part: the rows are those of the reference, and ``epsilon`` is the error of the time step, by which our
velocity-Verlet code, which takes the same steps, differs from it. States are taken where no velocity is tiny but not
zero, because the test program compares relative to each component.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling, backend, unsupported_reason
from dem_bridge.backends.lammps import LammpsGranular
from dem_bridge.errors import UnsupportedScene
from dem_bridge.judging.check.law import MULTIPLE_OF_RADIUS_CHANGE
from dem_bridge.judging.reference import ReferenceSamples, reference_at
from dem_bridge.judging.twin_run import twin_run
from dem_bridge.judging.unit_test.recorded import in_segments
from dem_bridge.lmp.deck import MOST_SETS, Deck
from dem_bridge.lmp.reader.evaluation import read_script
from dem_bridge.lmp.unit_test import Analytic, UnitTest
from dem_bridge.physics.damped_impact import linear_restitution, restitution_obtained
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.timescales import contact_time_of
from dem_bridge.trajectory.trajectory import Floats
from dem_bridge.version import __version__

#: time steps of the shortest contact time where no step is given, for which epsilon is about 1e-5
STEPS_OF_CONTACT = 1000.0
#: states among which those of the test are chosen, and the number of these
_CANDIDATES, _SEGMENTS = 300, 3
#: least velocity of a body that is not zero, relative to the largest: below it, epsilon would be a thousand times the
#: error of the step relative to the largest velocity
_LEAST_VELOCITY = 1e-3
#: part of the largest least velocity of a third of the run that is as good, so that states in free flight are late ones
_NEARLY = 0.99
#: least factor by which the error falls at half the step where it is that of the step: between those of order 0 and 1
_LEAST_FALL = math.sqrt(2.0)
#: part of the tolerance of a formula that the error of the step takes
_SHARE_OF_STEP = 0.5
#: commands of a deck that a test has in another way, or does not need
_LEFT_OUT = ("newton", "read_data", "thermo", "thermo_style", "thermo_modify", "dump", "dump_modify", "run", "timestep")
_LOOP_VARIABLES = ("steps", "per_sample", "dense", "dump", "next")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Motion:
    """States of the bodies at the candidate times, by our code at the step of the test and by the reference."""

    deck: Deck
    reference: ReferenceSamples
    velocity: Floats
    """Of our code with absolute positions, m/s, ``(n_t, n_body)``; the other arrays alike."""
    displacement: Floats
    round_off: tuple[float, float]
    """Largest effect of absolute positions on velocities, m/s, and on displacements, m."""
    finer_error: float
    """Largest error of velocities at half the step, m/s."""

    @property
    def error(self) -> float:
        """Largest error of velocities at the step, m/s."""
        return float(np.max(np.abs(self.velocity - self.reference.values["velocity"])))


def unit_test_of(scene: Scene, *, dt: float | None = None, name: str | None = None) -> UnitTest:
    """Return the unit test of a scene.

    Parameters
    ----------
    scene : Scene
        The scene.
    dt : float, optional
        Largest time step, s; the default is 1/1000 of the shortest contact time.
    name : str, optional
        Name of the test; the default is that of the scene.

    Raises
    ------
    UnsupportedScene
        If LAMMPS, our velocity-Verlet code or the reference cannot do the scene, or a test cannot contain it.
    """
    writer = LammpsGranular(None)
    for code in (writer, backend("verlet"), backend("reference")):
        if reason := unsupported_reason(code, scene):
            raise UnsupportedScene(f"there is no unit test of {scene.name}: {code.name}: {reason}")
    if scene.drive is not None and scene.drive.shape == "table":
        raise UnsupportedScene(f"there is no unit test of {scene.name}: a drive by a table needs a file of its own")
    if dt is None:
        dt = (contact_time_of(scene) or scene.duration) / STEPS_OF_CONTACT
    count = max(1, min(_CANDIDATES, math.floor(scene.duration / dt)))
    deck = writer.deck(scene, Resolution(dt=dt), Sampling(count=count))
    if f"masses.{scene.name}" in deck.files:
        raise UnsupportedScene(f"there is no unit test of {scene.name}: it has more than {MOST_SETS} different masses")
    motion = _motion(scene, deck)
    rows, with_velocities = _chosen(motion)
    formula = _formula(scene, motion, rows) if with_velocities else None
    return _test(scene, motion, formula or _Formula(rows=rows), with_velocities, name or scene.name)


def _motion(scene: Scene, deck: Deck) -> _Motion:
    """Return the states of a scene at the samples of its deck."""
    plan = deck.schedule
    times = np.asarray(plan.step * plan.per_sample * np.arange(plan.samples + 1), dtype=np.float64)
    reference = reference_at(scene, times)

    def run(step: float, radius: float | None) -> tuple[Floats, Floats]:
        result = twin_run(replace(scene, samples=plan.samples), step, radius)
        return result.velocity, result.displacement

    velocity, displacement = run(plan.step, deck.surrogate_radius)
    plain = run(plan.step, None)
    finer, _ = run(0.5 * plan.step, None)
    return _Motion(
        deck=deck,
        reference=reference,
        velocity=velocity,
        displacement=displacement,
        round_off=(
            float(np.max(np.abs(velocity - plain[0]))),
            float(np.max(np.abs(displacement - plain[1]))),
        ),
        finer_error=float(np.max(np.abs(finer - reference.values["velocity"]))),
    )


def _chosen(motion: _Motion) -> tuple[list[int], bool]:
    """Return the rows of the states of a test, and whether their velocities can be compared.

    In each third of the run it is the last state whose least velocity, zeros apart, is nearly the largest.
    """
    ours, exact = np.abs(motion.velocity), np.abs(motion.reference.values["velocity"])
    both = np.minimum(ours, exact)
    at_rest = (ours == 0.0) & (exact == 0.0)
    least = np.min(np.where(at_rest, np.inf, both), axis=1) / max(float(np.max(exact)), 1e-300)
    last = len(least) - 1
    bounds = sorted({1 + (last * k) // _SEGMENTS for k in range(_SEGMENTS)} | {last + 1})
    thirds = [(low, least[low:high]) for low, high in pairwise(bounds)]
    rows = [low + int(np.flatnonzero(part >= _NEARLY * np.max(part))[-1]) for low, part in thirds]
    moving = [row for row in rows if least[row] >= _LEAST_VELOCITY]
    return (moving, True) if moving else ([high - 1 for high in bounds[1:]], False)


def _errors(scene: Scene, motion: _Motion, rows: list[int], starts: Floats, with_velocities: bool) -> float:
    """Return the largest error by component that a right code has in the states of a test."""
    exact, plan = motion.reference, motion.deck.schedule
    ends = [plan.per_sample * row for row in rows]
    velocity, displacement = in_segments(scene, plan.step, ends, motion.deck.surrogate_radius)
    parts = [(displacement, exact.values["displacement"], exact.uncertainty["displacement"], starts)]
    if with_velocities:
        parts.append((velocity, exact.values["velocity"], exact.uncertainty["velocity"], np.zeros_like(starts)))
    largest = 0.0
    for (ours, theirs, uncertainty, start), floor in zip(parts, motion.round_off[::-1], strict=False):
        size = np.abs(ours - theirs[rows]) + uncertainty + MULTIPLE_OF_RADIUS_CHANGE * floor
        least = np.minimum(np.abs(ours + start), np.abs(theirs[rows] + start))
        largest = max(largest, float(np.max(np.where(least > 0.0, size / np.where(least > 0.0, least, 1.0), 0.0))))
    # each step rounds a position and a velocity once
    return largest + plan.steps * 2.0**-53


def _rounded_up(value: float) -> float:
    """Return a number with two digits that is not smaller.

    Examples
    --------
    >>> _rounded_up(1.231e-6), _rounded_up(9.95e-7)
    (1.3e-06, 1e-06)
    """
    power = math.floor(math.log10(value)) - 1
    return float(f"{math.ceil(value / 10.0**power * (1.0 - 1e-12))}e{power}")


# ---------------------------------------------------------------- formulas
@dataclass(frozen=True, kw_only=True)
class _Formula:
    """The states of a test, and the formula for one of them."""

    rows: list[int]
    analytic: Analytic | None = None
    variables: Mapping[str, float] = field(default_factory=dict)


def _formula(scene: Scene, motion: _Motion, rows: list[int]) -> _Formula | None:
    """Return the formula of a collision of two bodies, or of a body and a wall on its right."""
    c, last = scene.contacts, len(rows) - 1
    forces = scene.gravity or scene.drag or scene.precompression or scene.drive or scene.adhesive or scene.law
    if scene.n_contact != 1 or scene.wall_left is not None or forces or scene.velocity[0] <= 0.0 or c.gap[0] < 0.0:
        return None
    speeds = scene.velocity if scene.n_body == 2 else (scene.velocity[0], 0.0)
    exact = motion.reference.values["displacement"]
    moved = np.pad(exact, ((0, 0), (0, 2 - scene.n_body)))
    overlap = moved[:, 0] - moved[:, 1] - c.gap[0]
    e = _restitution(scene)
    apart = overlap[rows[-1]] < 0.0 and float(np.max(overlap)) > 0.0 and rows[-1] > int(np.argmax(overlap))
    if e is not None and apart and (scene.n_body == 1 or _mirrored(scene)):
        tolerance = _tolerance(e * speeds[0], -float(motion.velocity[rows[-1], 0]))
        model, speed = ("wall_restitution", "vx_in") if scene.n_body == 1 else ("collision_restitution", "vin")
        analytic = Analytic(model=model, tolerance=tolerance, segment=last)
        return _Formula(rows=rows, analytic=analytic, variables={"en": e, speed: speeds[0]})
    return _peak(scene, motion, rows, overlap) if scene.n_body == 2 and not scene.damped else None


def _peak(scene: Scene, motion: _Motion, rows: list[int], overlap: Floats) -> _Formula | None:
    """Return the formula of the largest overlap of an elastic Hertz contact, at a further state."""
    row, stiffness = int(np.argmax(overlap)), float(scene.contacts.stiffness[0])
    exact = np.abs(motion.reference.values["velocity"])
    if scene.contacts.exponent[0] != 2.5 or np.min(exact[row]) < _LEAST_VELOCITY * np.max(exact):
        return None
    first, second = scene.mass
    share, closing = second / (first + second), scene.velocity[0] - scene.velocity[1]
    peak = (1.25 * share * first * closing**2 / stiffness) ** 0.4
    now = float(motion.displacement[row, 0] - motion.displacement[row, 1] - scene.contacts.gap[0])
    tolerance = max(_tolerance(peak, now), _tolerance(peak**1.5, now**1.5))
    rows = sorted({*rows, row})
    analytic = Analytic(model="hertz_peak", tolerance=tolerance, segment=rows.index(row))
    return _Formula(rows=rows, analytic=analytic, variables={"vrela": closing, "mred_factor": share, "kfac": stiffness})


def _tolerance(exact: float, ours: float) -> float:
    """Return the tolerance of a formula, of which the error of the step takes a part."""
    return _rounded_up(max(abs(ours - exact) / abs(exact), 2.0**-52) / _SHARE_OF_STEP)


def _mirrored(scene: Scene) -> bool:
    """Return True for two equal bodies that move towards each other with one speed."""
    return scene.mass[0] == scene.mass[1] and scene.velocity[0] == -scene.velocity[1]


def _restitution(scene: Scene) -> float | None:
    """Return the coefficient of restitution of the only contact by its formula; None where there is none."""
    damping, exponent = scene.damping, float(scene.contacts.exponent[0])
    if damping is None:
        return 1.0
    value = float(np.atleast_1d(damping.coefficient)[0])
    if damping.law == "coeff_restitution" and exponent == 2.5:
        return restitution_obtained(value, clip=bool(damping.clip))
    if damping.law == "coeff_restitution" and exponent == 2.0 and not damping.clip:
        return value
    if damping.law == "dashpot" and exponent == 2.0:
        inverse = sum(1.0 / mass for mass in scene.mass)
        ratio = 0.5 * value * math.sqrt(inverse / float(scene.contacts.stiffness[0]))
        return linear_restitution(damping_ratio=ratio, clip=bool(damping.clip)) if ratio < 1.0 else None
    return None


# ---------------------------------------------------------------- the test
def _test(scene: Scene, motion: _Motion, formula: _Formula, with_velocities: bool, name: str) -> UnitTest:
    """Return a test of chosen states and a formula."""
    deck, rows = motion.deck, formula.rows
    plan, walls = deck.schedule, (int(scene.wall_left is not None), int(scene.wall_right is not None))
    shift = 2.0 * deck.surrogate_radius * (1 + walls[0])  # no centre at 0, where the smallest error is a large share
    line = deck.line + shift
    bodies = slice(walls[0], len(line) - walls[1])
    values = motion.reference.values
    places = np.tile(line, (len(rows), 1))
    places[:, bodies] += values["displacement"][rows]
    speeds = np.pad(values["velocity"][rows], ((0, 0), walls))
    steps = [plan.per_sample * row for row in rows]
    states = {"run_pos": tuple(_rows(state) for state in places)}
    if with_velocities:
        states["run_vel"] = tuple(_rows(state) for state in speeds)
    exact, speed = motion.error <= plan.steps * 2.0**-53, float(np.max(np.abs(values["velocity"])))
    vetted = exact or motion.error <= MULTIPLE_OF_RADIUS_CHANGE * motion.round_off[0] or (
        motion.finer_error * _LEAST_FALL <= motion.error
    )  # fmt: skip
    head, pairs, tail, variables = _commands(scene, deck, line)
    return UnitTest(
        name=name,
        pre_commands=tuple(head),
        pair_style=pairs[0].partition(" ")[2].strip(),
        pair_coeff=tuple(command.partition(" ")[2].strip() for command in pairs[1:]),
        post_commands=tuple(tail),
        segments=tuple(np.diff([0, *steps]).tolist()),
        variables=variables | {key: repr(value) for key, value in formula.variables.items()},
        prerequisites=(("atom", "sphere"), ("pair", pairs[0].split()[1])),
        states=states,
        epsilon=_rounded_up(_errors(scene, motion, rows, line[bodies], with_velocities)),
        tags=("granular",) if vetted and speed > 0.0 else ("granular", "unvetted"),
        version=f"the reference solution of dem_bridge {__version__}",
        atoms=len(line),
        analytic=formula.analytic,
    )


def _rows(values: Floats) -> dict[int, tuple[float, float, float]]:
    """Return the state of atoms on a line along x."""
    return {tag: (value, 0.0, 0.0) for tag, value in enumerate(values.tolist(), start=1)}


def _commands(scene: Scene, deck: Deck, line: Floats) -> tuple[list[str], list[str], list[str], dict[str, str]]:
    """Return the commands of a deck before, of and after its pair style, with its atoms in place of its data file."""
    head: list[str] = []
    pairs: list[str] = []
    tail: list[str] = []
    variables: dict[str, str] = {}
    for raw in deck.files[deck.input_file].splitlines():
        command = " ".join(raw.partition("#")[0].split())
        words = command.split()
        if not words or (words[0] == "variable" and words[1] in _LOOP_VARIABLES):
            continue
        if words[0] == "variable" and words[2] == "index":
            variables[words[1]] = " ".join(words[3:])
        elif words[0] in ("pair_style", "pair_coeff"):
            pairs.append(command)
        elif words[0] == "read_data":
            head += _atoms(deck, line)
        elif words[0] not in _LEFT_OUT:
            (tail if pairs else head).append(command)
    return head, pairs, [*tail, "timestep ${dt}"], variables


def _atoms(deck: Deck, line: Floats) -> Iterator[str]:
    """Yield the commands that create the box and the atoms of a deck at other places."""
    state = read_script(
        deck.files[deck.input_file], file=deck.input_file, opened=lambda name: deck.files[name]
    ).particles
    (low, high), across, depth = state.box
    shift = float(line[0] - deck.line[0])
    sides = [low + shift, high + shift, *across, *depth]
    yield f"region box block {' '.join(map(repr, sides))} units box"
    yield f"create_box {deck.types} box"
    for atom, place in zip(state.atoms.values(), line.tolist(), strict=True):
        yield f"create_atoms {atom.kind} single {place!r} 0.0 0.0 units box"
    yield f"set group all diameter {2.0 * deck.surrogate_radius!r}"
    for atom in state.atoms.values():
        if not atom.weighed:  # a wall, whose mass the deck does not set
            yield f"set atom {atom.number} density {atom.density!r}"
        if atom.velocity[0] != 0.0:
            yield f"set atom {atom.number} vx {atom.velocity[0]!r}"
