"""Velocities of one run of a script by LAMMPS, sampled closely while forces act, so that no pulse is missed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.formats.readers.column_meaning import Choices
from dem_bridge.formats.readers.dumps import read_dump
from dem_bridge.formats.readers.frames_to_record import draft_of_frames
from dem_bridge.foundation.compiled import Ints
from dem_bridge.judging.deck import DeckRun
from dem_bridge.judging.model import Model
from dem_bridge.lmp.reader.evaluation import UNITS
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats

#: part of 1/omega of the stiffest contact between two frames, some 40 of which are in a contact, and the part above
#: which frames miss the largest error
_SPACING_OF_PERIOD, LARGEST_SPACING_OF_PERIOD = 0.1, 0.4
#: change of a velocity between two samples, relative to the largest velocity
_LARGEST_CHANGE_OF_VELOCITY = 0.02
#: frames times bodies of a dump that are read at most, and samples times bodies that are compared at most
_MOST_VALUES_READ, _MOST_VALUES_COMPARED = 2_000_000, 2_000_000
#: samples by which the part of a run is estimated in which forces act
_PROBES_OF_ACTIVITY = 4000


@dataclass(frozen=True, kw_only=True)
class Spacing:
    """Steps between two frames of the times in which forces act."""

    every: int
    resolves: bool
    """False if a run is so long that velocities change a lot between two frames."""


def spacing_of(scene: Scene | None, dt: float | None, steps: int, bodies: int, frequency: float) -> Spacing:
    """Return the steps between two frames of a run.

    Parameters
    ----------
    scene : Scene, optional
        Scene of the run; None if there is none that our code repeats: forces are then taken to act all the time.
    dt : float, optional
        Time step, s; None if the run has several.
    steps, bodies : int
        Number of steps and of bodies of the run.
    frequency : float
        Frequency of the stiffest contact, rad/s; 0 if it is not known.

    Examples
    --------
    >>> spacing_of(None, 1e-6, 1000, 10, 1e4), spacing_of(None, 1e-6, 10**7, 10, 1e4).resolves
    (Spacing(every=10, resolves=True), False)
    """
    known = dt is not None and frequency > 0.0
    every = max(1, int(_SPACING_OF_PERIOD / (frequency * dt) * (1.0 + 1e-9))) if known and dt is not None else 1
    frames = steps / every
    if frames * bodies > _MOST_VALUES_READ and scene is not None and dt is not None:
        frames *= _share_of_time(scene, dt, steps)
    fewer = max(1.0, frames * bodies / _MOST_VALUES_READ)
    thinned = int(np.ceil(every * fewer))
    resolves = fewer == 1.0 or (dt is not None and known and thinned * dt * frequency <= LARGEST_SPACING_OF_PERIOD)
    return Spacing(every=thinned, resolves=resolves)


def _share_of_time(scene: Scene, dt: float, steps: int) -> float:
    """Return the part of the steps of a run in which a contact is closed, by our code at probes of these steps."""
    model = Model(scene)
    probes = np.unique(np.linspace(0, steps, _PROBES_OF_ACTIVITY).astype(np.int64))
    with np.errstate(all="ignore"):
        force = model.stepped(model.system, probes, dt).force
    # one probe more than are seen: the estimate of a short part is not zero
    return min(1.0, (int(np.sum(np.any(force != 0.0, axis=1))) + 1) / len(probes))


def changing(velocity: Floats) -> Ints:
    """Return the rows between which a velocity changes by more than a small part of the largest; the last one, too.

    Examples
    --------
    >>> changing(np.array([[1.0], [1.0], [0.99], [0.97], [0.5], [0.5], [0.5]])).tolist()
    [0, 3, 4, 6]
    """
    most = max(2, _MOST_VALUES_COMPARED // velocity.shape[1])
    change = _LARGEST_CHANGE_OF_VELOCITY * float(np.max(np.abs(velocity), initial=0.0))
    while True:
        rows, last = [0], velocity[0]
        for row, values in enumerate(velocity):
            if np.abs(values - last).max() > change:
                rows.append(row)
                last = values
        if len(rows) <= most:
            return np.unique(np.array([*rows, len(velocity) - 1], dtype=np.int64))
        change *= 2.0


@dataclass(frozen=True, kw_only=True, eq=False)
class LammpsRun:
    """Velocities of one run of the script by LAMMPS."""

    factor: int
    """How many times its time steps are shorter than those of the script."""
    time: Floats
    """Sample times, s, ``(n_t,)``."""
    velocity: Floats
    """In m/s, ``(n_t, n_body)`` of a scene; else in the units of the script, three components of each atom."""
    bodies: tuple[int, ...]
    version: int
    dangerous: int
    """Dangerous builds of the neighbour list."""
    active_steps: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """Further samples, between which velocities change little, while forces act: steps of this run."""
    active: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    """Velocities at :attr:`active_steps`, as :attr:`velocity`."""

    @property
    def finite(self) -> bool:
        """Return True if all velocities are numbers."""
        return bool(np.all(np.isfinite(self.velocity)))

    @property
    def common_steps(self) -> Ints:
        """Further samples as steps of the script as it is, which finer runs share."""
        return self.active_steps // self.factor

    def apart(self, other: LammpsRun) -> float:
        """Return the largest difference of velocities from another run at common samples; nan if not finite."""
        rows = min(len(self.velocity), len(other.velocity))
        _, own, others = np.intersect1d(self.common_steps, other.common_steps, return_indices=True)
        with np.errstate(all="ignore"):
            parts = [self.velocity[:rows] - other.velocity[:rows]]
            if len(own):
                parts.append(self.active[own] - other.active[others])
            return max(float(np.max(np.abs(part))) for part in parts)


def along_chain(run: DeckRun, values: Floats, result: LammpsRun, end: float) -> Floats:
    """Return velocities of all atoms until a time, s, as those of bodies, m/s, ``(n_frame, n_body)``."""
    length, time, _ = UNITS.get(run.deck.state.units, (1.0, 1.0, 1.0))
    sign = -1.0 if run.deck.mirrored else 1.0
    along = sign * length / time * values[:, list(run.order), run.axis]
    # atoms that stay, such as a frozen one at an end, are no bodies: the others move as the samples do
    many = len(result.bodies)
    after = result.velocity[min(int(np.searchsorted(result.time, end)), len(result.time) - 1)]
    starts = range(along.shape[1] - many + 1)
    first = min(starts, key=lambda start: float(np.max(np.abs(along[-1, start : start + many] - after))))
    return np.asarray(along[:, first : first + many])


def times_at(steps: Ints, dt: float) -> Floats:
    """Return the times of steps, s."""
    return np.asarray(dt * steps, dtype=np.float64)


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """Times and velocities of the added dump."""

    time: Floats
    """s, ``(n_t,)``."""
    velocity: Floats
    """In m/s, ``(n_t, n_body)``, if ``of_scene``; else in the units of the script, three components of each atom."""
    bodies: tuple[int, ...]
    of_scene: bool
    """True if the velocities are those of the bodies of a scene, and are numbers."""


def change_of_atoms(text: str) -> str:
    """Return which atom of a dump is the first to leave or to appear, when, and through which face; '' if none is."""
    before: dict[int, list[float]] = {}
    then = 0.0
    for frame in text.split("ITEM: TIME\n")[1:]:
        lines = frame.splitlines()
        sections = {line.partition(":")[2].strip(): place for place, line in enumerate(lines) if line[:5] == "ITEM:"}
        now = float(lines[0])
        heads = {name.partition(" ")[0]: place for name, place in sections.items()}
        box = [tuple(map(float, line.split()[:2])) for line in lines[heads["BOX"] + 1 : heads["BOX"] + 4]]
        rows = (line.split() for line in lines[heads["ATOMS"] + 1 :])
        atoms = {int(row[0]): [float(word) for word in row[2:8]] for row in rows}
        if before and atoms.keys() != before.keys():
            if gone := sorted(before.keys() - atoms.keys()):
                return _departure(gone[0], before[gone[0]], box, then, now)
            return f"atom {min(atoms.keys() - before.keys())} appears between the times {then:g} and {now:g}"
        before, then = atoms, now
    return ""


def _departure(atom: int, state: Sequence[float], box: Sequence[Sequence[float]], then: float, now: float) -> str:
    """Return how an atom left between two times: through the face of the box that its motion leads to, if there is one.

    ``state``: place and velocity at the first of these times.
    """
    when = f"between the times {then:g} and {now:g}"
    for axis, (low, high) in enumerate(box):
        end = state[axis] + state[3 + axis] * (now - then)
        if not low <= end <= high:
            face, at = ("lo", low) if end < low else ("hi", high)
            face = f"{'xyz'[axis]}{face} = {at:g}"
            return f"atom {atom} leaves the box through its face {face} {when}, and the run goes on without it"
    return f"atom {atom} is removed {when}"


def samples_of(text: str, scene: Scene | None, *, dt: float | None, unit: float) -> Samples:
    """Return what the added dump holds; it is parsed once, whether there is a scene or not.

    Parameters
    ----------
    text : str
        The dump.
    scene : Scene, optional
        Scene of the script.
    dt : float, optional
        Time step of the run, s.
    unit : float
        Unit of time of the script, s.

    Raises
    ------
    RunBroken
        If the atoms change during the run.
    """
    try:
        frames = read_dump([text])
    except UsageError as error:
        raise RunBroken(change_of_atoms(text) or str(error)) from None
    assert frames.time is not None  # the added dump has times
    velocity = frames.columns["velocity"]
    if scene is not None and np.all(np.isfinite(velocity)):
        record = draft_of_frames("the dump", frames, scene, Choices(dt), "si").record(scene)
        bodies = tuple(record.columns["velocity"])
        return Samples(time=record.time, velocity=record.values["velocity"], bodies=bodies, of_scene=True)
    atoms = tuple(range(velocity.shape[1]))
    return Samples(time=unit * frames.time, velocity=velocity.reshape(len(velocity), -1), bodies=atoms, of_scene=False)
