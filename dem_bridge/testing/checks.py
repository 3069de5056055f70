"""Checks that any backend must pass, one for each promise of the protocol and each feature of scenes."""

from __future__ import annotations

import contextlib
import inspect
import math
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from tempfile import TemporaryDirectory

import numpy as np

from dem_bridge.backends.base import (
    Availability,
    Backend,
    Resolution,
    Sampling,
    backend,
    supports_of,
    unsupported_reason,
)
from dem_bridge.errors import DemBridgeError
from dem_bridge.physics.exact import two_body_collision
from dem_bridge.runs.case import Case
from dem_bridge.runs.uncertainty.estimate import solve
from dem_bridge.scene.features import FEATURES, GRADED_EXPONENTS, OTHER_EXPONENTS, Feature
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Support
from dem_bridge.testing.examples import DURATION, OTHER, example, plain_scene
from dem_bridge.trajectory.trajectory import PER_CONTACT, QUANTITIES, SAMPLED, VOCABULARY, Floats, Trajectory

#: largest difference from other codes and closed forms, relative to the largest value: a default step errs by 1e-4 and
#: less, and a feature that is ignored shows by 5 % and more (tests/test_testing.py)
TOLERANCE = 1e-2
#: time step of backends with a fixed step, s: 1/2000 of the time for which two bodies touch
STEP = DURATION / 3000
#: change of the total momentum where it is conserved, relative to the sum of the momenta at the start
MOMENTUM = 1e-9
#: round-off of a closed form and of its comparison, relative to the largest value
ROUND_OFF = 1e-13
#: ``equations`` of backends that solve the equations of motion; others have declared a model difference
HERTZ = "hertz"
#: codes that scenes are solved by for comparison, the first that is not the backend under test
REFERENCES = ("scipy", "verlet")


@dataclass(frozen=True)
class Check:
    """One requirement on one backend; a call raises AssertionError with a sentence if it is violated."""

    name: str
    test: Callable[[], None]

    def __call__(self) -> None:
        """Run the check."""
        try:
            self.test()
        except AssertionError as error:
            raise AssertionError(f"{self.name}: {error}") from None
        except Exception as error:
            raise AssertionError(f"{self.name}: {type(error).__name__} was raised: {error}") from error

    def __str__(self) -> str:
        return self.name


def check_backend(chosen: Backend) -> None:
    """Check that a backend keeps the promises of the protocol and of its own declaration of support.

    Parameters
    ----------
    chosen : Backend
        An object with the members of :class:`~dem_bridge.backends.base.Backend`; it need not be in the catalogue.

    Raises
    ------
    AssertionError
        With one line for each check that failed: its name and what was found.

    Examples
    --------
    >>> from dem_bridge.testing import ExactPair
    >>> class Untitled(ExactPair):
    ...     name = ""
    >>> check_backend(Untitled())
    Traceback (most recent call last):
    AssertionError: declaration: name = ''; required: text
    """
    failures = []
    for check in backend_checks(chosen):
        try:
            check()
        except AssertionError as error:
            failures.append(str(error))
    if failures:
        raise AssertionError("\n".join(failures))


def backend_checks(chosen: Backend) -> list[Check]:
    """Return the checks of a backend, for one test each.

    Checks of features follow from the declaration of the backend: a scene with each supported feature must be solved,
    and a scene with each other feature must be refused by name.

    Parameters
    ----------
    chosen : Backend
        As for :func:`check_backend`.

    Returns
    -------
    list of Check
        Functions without arguments; ``str(check)`` is the name.

    Examples
    --------
    >>> from dem_bridge.testing import ExactPair
    >>> names = [check.name for check in backend_checks(ExactPair())]
    >>> names[0], "solves gravity" in names, "refuses drag" in names
    ('declaration', True, True)
    """
    return list(_generate(chosen))


def _generate(chosen: Backend) -> Iterator[Check]:
    subject = _Subject(chosen)
    for name, test in vars(_Subject).items():
        if callable(test) and len(inspect.signature(test).parameters) == 1:
            yield Check(name.replace("_", " "), partial(test, subject))
    exponent = subject.base.contacts.exponent.tolist()[0] if subject.base.n_contact else 2.5
    for bodies, test_of in ((1, subject.free_flight), (2, subject.two_bodies)):
        plain = plain_scene(bodies, exponent)
        if chosen.equations == HERTZ and chosen.supports.covers(plain):
            yield Check(test_of.__name__.replace("_", " "), partial(test_of, plain))
    for feature in FEATURES:
        scene = example(feature, chosen.supports)
        if feature in chosen.supports.features:
            yield Check(f"solves {feature.label}", partial(subject.solves, feature, scene))
        elif scene is not None:
            yield Check(f"refuses {feature.label}", partial(subject.refuses, feature.label, scene))
    refused = next((n for n in OTHER if n not in chosen.supports.exponents), None)
    if refused is not None and subject.base.n_contact:
        plain = plain_scene(subject.base.n_body, refused)
        yield Check(f"refuses the exponent {refused:g}", partial(subject.refuses, f"exponent n = {refused!r}", plain))


class _Subject:
    """The backend under test, a base scene that it supports, and the run of it, which is made once.

    Each method without parameters is a check of every backend, in the order of their definition.
    """

    def __init__(self, chosen: Backend) -> None:
        self.backend = chosen
        exponent = next((n for n in (2.5, *OTHER) if n in chosen.supports.exponents), 2.5)
        candidates = [plain_scene(bodies, exponent) for bodies in (3, 2, 1)]
        self.base = next((scene for scene in candidates if chosen.supports.covers(scene)), candidates[0])
        self.first_run = cache(lambda: self.run(self.base))

    def run(self, scene: Scene, samples: int | None = None, dt: float | None = STEP) -> Trajectory:
        """Solve a scene; ``dt`` in s, None: the default step of the backend."""
        # a copy, so that a backend that changes its scene spoils no other check
        return self.backend.run(replace(scene), Resolution(dt=dt), Sampling(count=samples or scene.samples))

    def run_with_uncertainty(self, scene: Scene) -> Trajectory:
        """Solve a scene and estimate the uncertainty, which is that of the run for a backend outside this package."""
        sampling = Sampling(count=scene.samples)
        case = Case(scene=replace(scene), backend=self.backend.name, resolution=Resolution(), sampling=sampling)
        return solve(case, code=self.backend)

    def declaration(self) -> None:
        chosen, order = self.backend, self.backend.order
        for name in ("name", "equations"):
            value = getattr(chosen, name)
            _require(isinstance(value, str) and value, f"{name} = {value!r}; required: text")
        is_order = order is None or (isinstance(order, int) and order >= 1)
        _require(is_order, f"order = {order!r}; allowed: None, 1, 2, ...")
        _require(isinstance(chosen.supports, Support), f"supports = {chosen.supports!r}; required: a Support")
        reason = chosen.supports.unsupported_reason(self.base)
        _require(reason is None, f"no chain of one to three bodies without any feature is supported: {reason}")

    def availability(self) -> None:
        answer = self.backend.availability()
        _require(isinstance(answer, Availability), f"availability() returns {answer!r}; required: an Availability")
        _require(
            answer.available == (not answer.reason), "a reason is required exactly if the backend is not available"
        )
        _require(
            answer.available, f"the backend is not available here, and nothing else can be checked: {answer.reason}"
        )

    def shapes(self) -> None:
        run, scene = self.first_run(), self.base
        sizes = {"time": scene.samples + 1, "body": scene.n_body, "contact": scene.n_contact}
        for name, axes in {"time": ("time",), **{name: axes for name, (_, _, axes) in VOCABULARY.items()}}.items():
            values, shape = np.asarray(getattr(run, name)), tuple(sizes[axis] for axis in axes)
            _require(values.shape == shape, f"{name} has the shape {values.shape}; required: {shape}")
            _require(values.dtype == np.float64, f"{name} has the type {values.dtype}; required: float64")
        for name in SAMPLED:
            _require(np.all(np.isfinite(getattr(run, name))), f"{name} has values that are not finite")

    def time_axis(self) -> None:
        times = np.linspace(0.0, self.base.duration, self.base.samples + 1)
        _require(np.array_equal(self.first_run().time, times), "the times are not equal steps from 0 to the duration")

    def start_values(self) -> None:
        run = self.first_run()
        _require(np.array_equal(run.velocity[0], self.base.velocity), "the first velocities are not those of the scene")
        _require(not np.any(run.displacement[0]), "the first displacements are not 0")
        _require(not np.any(run.contact_force[0] > 0.0), "bodies that only touch have a contact force at the start")

    def provenance(self) -> None:
        provenance = self.first_run().provenance
        for key, value in {
            "backend": self.backend.name,
            "equations": self.backend.equations,
            "scene": self.base.name,
            "scene_hash": self.base.content_hash,
        }.items():
            _require(provenance.get(key) == value, f"{key} = {provenance.get(key)!r}; required: {value!r}")

    def uncertainty(self) -> None:
        estimate = self.run_with_uncertainty(self.base).uncertainty
        _require(set(estimate) == set(QUANTITIES), f"quantities are {sorted(estimate)}; required: {sorted(QUANTITIES)}")
        for name in QUANTITIES:
            _require(np.all(np.asarray(estimate[name]) >= 0.0), f"the uncertainty of {name} is negative or nan")
        for name in PER_CONTACT:
            shape, contacts = np.shape(estimate[name]), self.base.n_contact
            _require(shape == (contacts,), f"the uncertainty of {name} has the shape {shape}; required: ({contacts},)")

    def cost(self) -> None:
        cost = self.first_run().cost
        for name in ("wall", "cpu", "steps", "force_evaluations"):
            _require(getattr(cost, name) >= 0.0, f"{name} = {getattr(cost, name)}; required: a number >= 0")

    def sampling(self) -> None:
        count = self.base.samples // 5
        few, many = self.run(self.base, samples=count), self.first_run()
        _require(len(few.time) == count + 1, f"{count} samples were asked for, and the run has {len(few.time) - 1}")
        _assert_close("velocity", few.velocity, many.velocity[::5], "the same run with more samples")

    def determinism(self) -> None:
        first, second = self.first_run(), self.run(self.base)
        for name in ("time", *VOCABULARY):
            same = getattr(first, name).tobytes() == getattr(second, name).tobytes()
            _require(same, f"{name} differs between two runs of one scene")

    def scene_unchanged(self) -> None:
        scene = replace(self.base)
        before = repr(scene), repr(scene.contacts)
        self.backend.run(scene, Resolution(), Sampling(count=scene.samples))
        _require(before == (repr(scene), repr(scene.contacts)), "the run changed the scene")

    def working_directory(self) -> None:
        with TemporaryDirectory() as folder, contextlib.chdir(folder):
            self.run(self.base)
            written = sorted(os.listdir(folder))
        _require(not written, f"the run wrote {', '.join(written)} into the working directory")

    def coarse_resolution(self) -> None:
        try:
            run = self.run(self.base, samples=1, dt=self.base.duration)
        except DemBridgeError:
            return
        except Exception as error:
            message = f"a time step of the whole duration raises {type(error).__name__}; allowed: RunBroken, UsageError"
            raise AssertionError(message) from error
        _require(np.all(np.isfinite(run.velocity)), "velocities are not finite, which must raise RunBroken")

    def free_flight(self, scene: Scene) -> None:
        run = self.run(scene)
        _assert_close("velocity", run.velocity[:, 0], np.full(len(run.time), scene.velocity[0]), "the closed form")
        _assert_close("displacement", run.displacement[:, 0], scene.velocity[0] * run.time, "the closed form")

    def two_bodies(self, scene: Scene) -> None:
        run = self.run_with_uncertainty(scene)
        exact = two_body_collision(
            masses=(scene.mass[0], scene.mass[1]),
            velocities=(scene.velocity[0], scene.velocity[1]),
            stiffness=scene.stiffness[0],
            exponent=float(scene.contacts.exponent[0]),
        )
        for name, value, closed in (
            ("velocity", run.velocity[-1], exact.exit_velocity),
            ("peak_force", run.peak_force, [exact.peak_force]),
            ("crossing_time", run.crossing_time, [exact.half_time]),
        ):
            _assert_close(name, value, np.array(closed), "the closed form", float(np.max(run.uncertainty[name])))

    def solves(self, feature: Feature, scene: Scene | None) -> None:
        if scene is None:
            raise AssertionError("the feature is listed, but the rest of the declaration excludes every example of it")
        run = self.run(scene)
        if scene.conserves_momentum:
            momentum, scale = run.velocity @ np.array(scene.mass), np.abs(run.velocity) @ np.array(scene.mass)
            change = float(np.max(np.abs(momentum - momentum[0])) / np.max(scale))
            _require(change <= MOMENTUM, f"the total momentum changes by {change:.2g} of the momenta")
        others = [name for name in REFERENCES if name != self.backend.name and supports_of(name).covers(scene)]
        if self.backend.equations == HERTZ and others:
            reference = _solution(others[0], scene)
            for name in ("velocity", "displacement", "peak_force", "crossing_time"):
                _assert_close(name, getattr(run, name), getattr(reference, name), others[0])
            # at the start bodies only touch, and there a dashpot's force jumps
            _assert_close("contact_force", run.contact_force[1:], reference.contact_force[1:], others[0])
        else:
            exponents = [] if feature in (OTHER_EXPONENTS, GRADED_EXPONENTS) else scene.contacts.exponent.tolist()[:1]
            plain = self.run(plain_scene(scene.n_body, *exponents))
            same = all(np.array_equal(getattr(run, name), getattr(plain, name)) for name in SAMPLED)
            _require(not same, "the motion is the same as without the feature")

    def refuses(self, what: str, scene: Scene) -> None:
        reason = unsupported_reason(self.backend, scene)
        if reason is None:
            raise AssertionError("the scene is not refused")
        _require(what in reason, f"the reason does not name {what!r}: {reason}")
        _require("\n" not in reason, "the reason has more than one line")


def _require(condition: object, sentence: str) -> None:
    """Raise AssertionError unless the condition holds; an assert statement would be skipped by ``python -O``."""
    if not condition:
        raise AssertionError(sentence)


@cache
def _solution(name: str, scene: Scene) -> Trajectory:
    """Return the solution of a code of this package."""
    return backend(name).run(scene, Resolution(), Sampling(count=scene.samples))


def _assert_close(name: str, values: Floats, expected: Floats, source: str, stated: float = math.inf) -> None:
    """Raise AssertionError where values differ by more than the stated uncertainty, or than ``TOLERANCE``."""
    _require(values.shape == expected.shape, f"{name} has the shape {values.shape}; required: {expected.shape}")
    scale = float(np.nanmax(np.abs(expected), initial=0.0))
    allowed = min(stated, TOLERANCE * scale) + ROUND_OFF * scale
    nan = np.isnan(values) != np.isnan(expected)
    error = float(np.nanmax(np.abs(values - expected), initial=0.0))
    _require(not np.any(nan), f"{name} is nan where {source} has a value, or the reverse")
    _require(error <= allowed, f"{name} differs from {source} by {error:.3g}; allowed: {allowed:.3g}")
