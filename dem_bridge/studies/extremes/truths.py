"""Standards for runs of extreme scenes: another code, an exact relation to another scene, or a closed form.

The relations are those of the equations themselves (Galilei, mirror, scales, time reversal, chains that never meet): a
code is compared with its own run of another scene, so that they share nothing with the references but Newton and Hertz.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dem_bridge.backends.base import Sampling
from dem_bridge.backends.reference import SERIES
from dem_bridge.physics.exact import scaling, two_body_collision
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import FREE, QUANTITIES, Floats, Trajectory, Uncertainty

EPS = float(np.finfo(float).eps)
#: a truth comes from the first of these that is not the judged code itself
WITNESSES = ("reference", "scipy", "verlet")
#: closed forms take a few dozen operations, each good to half a unit in the last place
_CLOSED = 32.0 * EPS


@dataclass(frozen=True, kw_only=True)
class Truth:
    """Source of a standard: ``make`` turns runs of ``scenes``, in their order, into it."""

    says: str
    make: Callable[[Sequence[Trajectory]], Trajectory]
    scenes: tuple[Scene, ...] = ()
    """Empty: in closed form."""
    by_itself: bool = True
    """Whether the runs are those of the judged code itself, or of another."""
    faster: float = 1.0
    """The judged scene's time step over that of ``scenes``, where the codes have one."""
    to_the_bit: tuple[str, ...] = ()
    """Backends, by name or kind, that must be this to the last bit."""


def by_others(scene: Scene) -> Truth:
    """Return the same scene by the most exact code that is not the judged one."""
    return Truth(says="another code", make=lambda runs: runs[0], scenes=(scene,), by_itself=False)


def witness(judged: str, scene: Scene) -> str:
    """Return the backend that is the standard for ``judged`` on ``scene``."""
    return next(name for name in WITNESSES if _code(name, scene) != _code(judged, scene))


def _code(name: str, scene: Scene) -> str:
    """Return the code that solves the scene: where its series do not fit, the reference calls scipy."""
    return "scipy" if name == "reference" and not SERIES.covers(scene) else name


def galilei(scene: Scene, speed: float) -> Truth:
    """Compare with a scene where all bodies are slower by ``speed`` (m/s)."""

    def make(runs: Sequence[Trajectory]) -> Trajectory:
        run = runs[0]
        return replace(run, velocity=run.velocity + speed, displacement=run.displacement + speed * run.time[:, None])

    slower = replace(scene, name=f"{scene.name}.at-rest", velocity=tuple(v - speed for v in scene.velocity))
    return Truth(says=f"its own run without the common {speed:g} m/s", make=make, scenes=(slower,))


def mirrored(scene: Scene) -> Truth:
    """Compare with the scene seen from the other end."""
    links = len(scene.stiffness)
    sides = [scene.wall_left is not None, scene.wall_right is not None]
    # the chain's contacts backwards, then the walls: the left one is the right one of the mirror
    places = list(range(links))[::-1] + list(range(links, links + sum(sides)))[::-1]

    def make(runs: Sequence[Trajectory]) -> Trajectory:
        run = runs[0]
        per_contact = ("peak_force", "crossing_time")
        return replace(
            run,
            displacement=-run.displacement[:, ::-1],
            velocity=-run.velocity[:, ::-1],
            contact_force=run.contact_force[:, places],
            **{name: getattr(run, name)[places] for name in per_contact},
            uncertainty=replace(run.uncertainty, **{name: run.uncertainty[name][places] for name in per_contact}),
        )

    other = replace(
        scene,
        name=f"{scene.name}.mirror",
        mass=scene.mass[::-1],
        velocity=tuple(-v for v in scene.velocity[::-1]),
        stiffness=scene.stiffness[::-1],
        exponent=_each(scene.exponent)[::-1],
        gap=_each(scene.gap)[::-1],
        wall_left=scene.wall_right,
        wall_right=scene.wall_left,
        gravity=-scene.gravity,
    )
    return Truth(says="its own run of the mirrored chain", make=make, scenes=(other,))


def scaled(scene: Scene, factor: float, to_the_bit: tuple[str, ...] = ()) -> Truth:
    """Compare with a scene where all is slower by ``factor``: one exponent, no gaps, no gravity."""
    by = scaling(exponent=_each(scene.exponent)[0], velocity=factor)
    if math.log2(factor).is_integer():  # powers of two stay so: 32^(4/5) is 16
        by = replace(by, **{name: _to_power_of_two(value) for name, value in vars(by).items()})

    factors = {
        "displacement": by.displacement,
        "velocity": by.velocity,
        "contact_force": by.force,
        "peak_force": by.force,
        "crossing_time": by.time,
    }

    def make(runs: Sequence[Trajectory]) -> Trajectory:
        run = runs[0]
        uncertainty = Uncertainty(**{name: run.uncertainty[name] * factors[name] for name in QUANTITIES})
        fields = {name: getattr(run, name) * factor for name, factor in factors.items()}
        return replace(run, time=run.time * by.time, **fields, uncertainty=uncertainty)

    slower = replace(
        scene,
        name=f"{scene.name}.slow",
        velocity=tuple(v / factor for v in scene.velocity),
        duration=scene.duration / by.time,
    )
    says = f"its own run at 1/{factor:g} of the speed, scaled"
    return Truth(says=says, make=make, scenes=(slower,), faster=by.time, to_the_bit=to_the_bit)


def _to_power_of_two(value: float) -> float:
    """Return the power of two that ``value`` is but for round-off; ``value`` itself where it is none."""
    nearest = 2.0 ** round(math.log2(value))
    return nearest if abs(value / nearest - 1.0) < 1e-12 else value


def apart(scene: Scene, at: int) -> Truth:
    """Compare with two chains that never meet, because contact ``at`` stays open; without walls and weight."""
    scenes = (
        _part(scene, "left", slice(None, at + 1), slice(None, at)),
        _part(scene, "right", slice(at + 1, None), slice(at + 1, None)),
    )

    def make(runs: Sequence[Trajectory]) -> Trajectory:
        left, right = runs
        nothing = {"contact_force": np.zeros((len(left.time), 1)), "peak_force": [0.0], "crossing_time": [math.nan]}
        parts: dict[str, Any] = {
            name: np.concatenate([getattr(left, name), other, getattr(right, name)], axis=-1)
            for name, other in nothing.items()
        }
        uncertainty: dict[str, Any] = {
            name: np.concatenate([left.uncertainty[name], [0.0], right.uncertainty[name]])
            for name in ("peak_force", "crossing_time")
        }
        for name in ("velocity", "displacement"):
            parts[name] = np.concatenate([getattr(left, name), getattr(right, name)], axis=1)
            uncertainty[name] = max(left.uncertainty[name], right.uncertainty[name])
        return replace(left, **parts, uncertainty=Uncertainty(**uncertainty))

    return Truth(says="its own runs of the two chains alone", make=make, scenes=scenes)


def shorter(scene: Scene, bodies: int, *, by_itself: bool = True) -> Truth:
    """Compare with the first ``bodies`` alone, by the judged code itself or by another.

    The front has not come further, so that the others stand still, as the last of these does.
    """

    def make(runs: Sequence[Trajectory]) -> Trajectory:
        run, more = runs[0], scene.n_body - bodies
        sampled = ("displacement", "velocity", "contact_force")
        still: dict[str, Any] = {name: np.pad(getattr(run, name), ((0, 0), (0, more))) for name in sampled}
        # ahead of a front forces fall from contact to contact, so no other has more than the last
        uncertainty = replace(
            run.uncertainty,
            peak_force=np.pad(run.uncertainty.peak_force, (0, more), constant_values=run.peak_force[-1]),
            crossing_time=np.pad(run.uncertainty.crossing_time, (0, more)),
        )
        return replace(
            run,
            **still,
            peak_force=np.pad(run.peak_force, (0, more)),
            crossing_time=np.pad(run.crossing_time, (0, more), constant_values=math.nan),
            uncertainty=uncertainty,
        )

    short = _part(scene, f"first-{bodies}", slice(bodies), slice(bodies - 1))
    says = f"its own run of the first {bodies} bodies"
    return Truth(says=says, make=make, scenes=(short,), by_itself=by_itself)


def _part(scene: Scene, name: str, bodies: slice, links: slice) -> Scene:
    """Return some neighbouring bodies of a scene, with the contacts between them."""
    return replace(
        scene,
        name=f"{scene.name}.{name}",
        mass=scene.mass[bodies],
        velocity=scene.velocity[bodies],
        stiffness=scene.stiffness[links],
        exponent=_each(scene.exponent)[links],
        gap=_each(scene.gap)[links],
    )


def back_again(forward: Trajectory, start: Scene) -> tuple[Scene, Truth]:
    """Return the scene in which ``start`` runs backwards from the end of ``forward``, and what it must do.

    The state at the end is known to the bars of ``forward``. The way back makes more of them by as much as it makes of
    the last digits of its input, which are what the bars of a reference consist of.
    """
    c, x, v = start.contacts, forward.displacement[-1], forward.velocity[-1]
    back = replace(
        start,
        name=f"{start.name}.back",
        velocity=tuple((-v).tolist()),
        gap=tuple((c.gap - (x[:-1] - x[1:])).tolist()),
    )

    def make(runs: Sequence[Trajectory]) -> Trajectory:
        digits = forward.uncertainty["velocity"] / (EPS * float(np.max(np.abs(forward.velocity))))
        known_values = ("velocity", "displacement", "peak_force")
        uncertainty = {name: (1.0 + digits) * forward.uncertainty[name] for name in known_values}
        return replace(
            forward,
            displacement=forward.displacement[::-1] - x,
            velocity=-forward.velocity[::-1],
            contact_force=forward.contact_force[::-1],
            # the first compression on the way back is the last on the way there, whose time is not recorded
            uncertainty=Uncertainty(**uncertainty, crossing_time=math.inf),
        )

    return back, Truth(says="the way there, backwards", make=make)


def two_bodies(scene: Scene) -> Truth:
    """Compare with two free bodies in closed form: before they meet and after they have parted."""
    (m1, m2), (v1, v2), gap = scene.mass, scene.velocity, float(scene.contacts.gap[0])
    hit = two_body_collision(
        masses=(m1, m2),
        velocities=(v1, v2),
        stiffness=float(scene.contacts.stiffness[0]),
        exponent=float(scene.contacts.exponent[0]),
    )
    meet = gap / (v1 - v2)
    times = Sampling(count=scene.samples).times(scene.duration)
    part = meet + hit.contact_time
    if gap < 0.0 or np.any((times > meet) & (times < part)):
        raise ValueError(f"{scene.name}: a sample falls between touch at {meet:g} s and parting at {part:g} s")
    after = (times >= part)[:, None]
    start = np.array([v1, v2])
    velocity = np.where(after, np.array(hit.exit_velocity), start)
    # the centre of mass flies on; after the collision the bodies part as fast as they came
    middle = (m1 * v1 + m2 * v2) / (m1 + m2) * times
    distance = (v1 - v2) * (times - part)
    apart_by = np.stack([-m2 / (m1 + m2) * (distance - gap), m1 / (m1 + m2) * (distance - gap)], axis=1)
    displacement = np.where(after, middle[:, None] + apart_by, start * times[:, None])
    largest = float(np.max(np.abs(displacement))) + abs(gap) + abs(v1 - v2) * scene.duration
    sizes = {"displacement": largest, "peak_force": hit.peak_force, "crossing_time": scene.duration}
    return _closed_form(
        "the closed form of two bodies",
        time=times,
        displacement=displacement,
        velocity=velocity,
        contact_force=np.zeros((len(times), 1)),
        peak_force=np.array([hit.peak_force]),
        crossing_time=np.array([meet + hit.half_time]),
        uncertainty={"velocity": _CLOSED * float(np.max(np.abs(velocity)))}
        | {name: _CLOSED * size for name, size in sizes.items()},
    )


def _closed_form(says: str, *, uncertainty: Mapping[str, Any], **samples: Floats) -> Truth:
    """Return a truth that needs no run."""
    provenance = {"backend": "closed form"}
    run = Trajectory(**samples, uncertainty=Uncertainty(**uncertainty), cost=FREE, provenance=provenance)
    return Truth(says=says, make=lambda runs: run)


def nothing_happens(scene: Scene) -> Truth:
    """Compare with bodies that fly on as they are; nothing presses that does not press at the start. Without weight."""
    times, v = Sampling(count=scene.samples).times(scene.duration), np.array(scene.velocity)
    c = scene.contacts
    force = c.force(np.maximum(-c.gap, 0.0), np.arange(scene.n_contact))
    way = times[:, None] * v
    digits = {"displacement": EPS * float(np.max(np.abs(way))), "peak_force": EPS * force}
    return _closed_form(
        "uniform flight",
        time=times,
        displacement=way,
        velocity=np.tile(v, (len(times), 1)),
        contact_force=np.tile(force, (len(times), 1)),
        peak_force=force,
        crossing_time=np.full(scene.n_contact, math.nan),
        uncertainty={"velocity": 0.0, "crossing_time": 0.0} | digits,
    )


def _each(values: tuple[float, ...] | float) -> tuple[float, ...]:
    assert isinstance(values, tuple)  # a scene has one per contact
    return values
