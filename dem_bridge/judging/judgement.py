"""The judgement of files: errors, order, floor, cause and outcome."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, cast

from dem_bridge.judging.diagnosis import Diagnosis, Fault
from dem_bridge.judging.order import Convergence
from dem_bridge.judging.reference import UNITS, FileErrors, QuantityErrors
from dem_bridge.observables.largest_step import ACCURACIES, StepError, accuracy_key
from dem_bridge.observables.verdict import Outcome, exit_code, judge, plain
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats

if TYPE_CHECKING:
    from dem_bridge.report.study import FigureData, Study, Table


class KeyedAnswer(Mapping[str, Any]):
    """A mapping whose values are the attributes that ``answer_keys`` names, in this order."""

    answer_keys: ClassVar[tuple[str, ...]] = ()

    def __getitem__(self, key: str) -> Any:
        if key not in self.answer_keys:
            raise KeyError(key)
        return getattr(self, key)

    def __iter__(self) -> Iterator[str]:
        return iter(self.answer_keys)

    def __len__(self) -> int:
        return len(self.answer_keys)


#: keys of a judgement, in their order
KEYS = (
    *("outcome", "error", "first_divergence", "order", "floor"),
    *("cause", "alternatives", "where", "evidence", "recognised"),
    *("step", "alternative_causes", "faults", "needed"),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Addition:
    """Further contents of the page of a judgement of runs that were made for it."""

    lines: tuple[tuple[str, str], ...] = ()
    """Name and text of further lines."""
    tables: tuple[Table, ...] = ()
    figures: tuple[FigureData, ...] = ()
    notes: tuple[str, ...] = ()


#: what files without contact forces cannot show
COMMON_FACTOR = "One factor on all masses and stiffnesses changes no velocity; contact forces would show it."
#: the diagnosis of files without an error that can be seen
EXPLAINED = Diagnosis(cause="none", evidence="Digits and reference explain all values.")


@dataclass(frozen=True, kw_only=True, eq=False)
class Judgement(KeyedAnswer):
    """The judgement of one or several files of one scene: a mapping with the keys :data:`KEYS`, all JSON-able.

    The keys are attributes, too. Errors, scales and uncertainties are in SI units; the tolerance and ``floor`` are
    relative to the scale.
    """

    answer_keys: ClassVar[tuple[str, ...]] = KEYS

    scene: Scene
    files: tuple[FileErrors, ...]
    """Errors of each file."""
    convergence: tuple[Convergence, ...]
    """Errors against the time step; empty for fewer than two files with a time step."""
    diagnosis: Diagnosis
    tolerance: float | None
    """Permissible error relative to the scale of each quantity; None: the cause decides the outcome."""
    assumed: tuple[str, ...] = ()
    """Sentences on what was assumed in judging, beside those of the readers."""
    step_curve: StepError | None = None
    """Errors by the time step; None if the method has none, or if nothing is known of it."""
    addition: Addition = Addition()
    """Work-precision of a foreign code, or the limits of a deck."""
    by_step: Mapping[str, Floats] | None = None
    """Errors of the code's method and step in the scene, for each quantity of the judged file; None: unknown."""
    time_unit: float = 1.0
    """Unit in which the times of the files must be for the errors, s: not 1 if the files state another one."""

    @property
    def judged(self) -> tuple[FileErrors, ...]:
        """The files that decide the outcome: the one with the finest time step, or all if none has a time step."""
        steps = [math.inf if file.record.dt is None else file.record.dt for file in self.files]
        finest = min(steps)
        return self.files if math.isinf(finest) else (self.files[steps.index(finest)],)

    @property
    def worst(self) -> dict[str, tuple[FileErrors, QuantityErrors]]:
        """The file with the largest error of each quantity, among those that decide, with its errors."""
        names = [name for name in UNITS if any(name in file.quantities for file in self.judged)]
        having = {name: [file for file in self.judged if name in file.quantities] for name in names}
        files = {name: max(some, key=lambda file: file.quantities[name].value) for name, some in having.items()}
        return {name: (file, file.quantities[name]) for name, file in files.items()}

    @property
    def outcomes(self) -> dict[str, Outcome]:
        """Outcome of each quantity against the tolerance; empty without a tolerance."""
        if self.tolerance is None:
            return {}
        if self.time_unit != 1.0:
            return dict.fromkeys(self.worst, Outcome.FAIL)
        return {
            name: judge(part.value, part.uncertainty, self.tolerance * part.scale)
            for name, (_, part) in self.worst.items()
        }

    @property
    def outcome(self) -> str:
        """PASS, FAIL or UNDECIDED, by the tolerance, or without one by the cause."""
        if self.tolerance is None:
            outcomes = {"none": Outcome.PASS, "unknown": Outcome.UNDECIDED}
            return outcomes.get(self.cause, Outcome.FAIL).value
        by_quantity = set(self.outcomes.values())
        ordered = (Outcome.FAIL, Outcome.UNDECIDED, Outcome.PASS)
        return next(outcome for outcome in ordered if outcome in by_quantity).value

    @property
    def exit_code(self) -> int:
        """Exit code of the command line: 0 for PASS, 1 for FAIL, 4 for UNDECIDED."""
        return exit_code([Outcome(self.outcome)])

    @property
    def error(self) -> dict[str, dict[str, float]]:
        """Largest error of each quantity, its scale (largest magnitude of the reference) and its uncertainty; SI."""
        return {
            name: {key: getattr(part, key) for key in ("value", "scale", "uncertainty")}
            for name, (_, part) in self.worst.items()
        }

    @property
    def first_divergence(self) -> dict[str, Any] | None:
        """Time, body and quantity of the first error that time step, digits and reference do not explain, or None.

        Where the step is unknown, only digits and reference explain errors.
        """
        if self.cause == "none" and self.diagnosis.step is not None:
            return None
        if self.by_step is not None:
            return self.judged[0].first_divergence(self.scene, self.by_step)
        divergences = [first for file in self.judged if (first := file.first_divergence(self.scene)) is not None]
        return min(divergences, key=lambda first: float(first["time"]), default=None)

    @property
    def seen(self) -> bool:
        """True if digits and reference do not explain all values."""
        return any(file.first_divergence(self.scene) is not None for file in self.judged)

    @property
    def order(self) -> dict[str, dict[str, float]]:
        """Observed order of each quantity and its uncertainty; empty where it cannot be determined."""
        return {
            part.quantity: {"value": part.order.value, "uncertainty": part.order.uncertainty}
            for part in self.convergence
            if part.order is not None
        }

    @property
    def floor(self) -> float | None:
        """Error below which nothing can be judged, relative to the scale: digits, reference, and round-off if visible.

        It is that of velocities, or of the first quantity that the files have.
        """
        name, (_, part) = next(iter(self.worst.items()))
        flat = [item.flat for item in self.convergence if item.quantity == name and not math.isnan(item.flat)]
        return cast("float | None", plain(part.relative(max([part.floor, *flat]))))

    @property
    def cause(self) -> str:
        """The likely cause of the errors, one of :data:`~dem_bridge.judging.cause.CAUSES`."""
        return self.diagnosis.cause

    @property
    def alternatives(self) -> list[str]:
        """What the data cannot tell from the cause, in sentences with numbers."""
        return list(self.diagnosis.sentences or (f"or: {name}" for name in self.diagnosis.alternatives))

    @property
    def alternative_causes(self) -> list[str]:
        """Names of the causes that the data cannot tell from the cause."""
        return list(self.diagnosis.alternatives)

    @property
    def faults(self) -> list[dict[str, str]]:
        """Cause, place and sentence of each fault, the larger one first; empty where no cause is named."""
        if self.cause in ("none", "unknown"):
            return []
        single = (Fault(self.cause, self.where, self.evidence),)
        return [asdict(fault) for fault in self.diagnosis.faults or single]

    @property
    def needed(self) -> str:
        """Which files would tell the cause from its alternatives, or show what these cannot; else empty."""
        common = self.cause == "none" and _has_common_factor(self.scene)
        unseen = common and not any("contact_force" in file.quantities for file in self.files)
        return COMMON_FACTOR if unseen else self.diagnosis.needed

    @property
    def step(self) -> dict[str, Any]:
        """Time step, s, its error, and the largest steps for errors of 1e-2, 1e-3, 1e-4 and the tolerance.

        Errors are relative to the largest value of the first quantity; None: unknown.
        """
        accuracies = ACCURACIES if self.tolerance is None else (*ACCURACIES, self.tolerance)
        if self.step_curve is not None:
            return self.step_curve.as_json(dict.fromkeys(accuracies))
        return {
            "dt": self.judged[0].record.dt,
            "error": None,
            "largest_for": {accuracy_key(a): None for a in accuracies},
        }

    @property
    def where(self) -> str:
        """Body or contact of the cause; empty if it concerns the whole chain."""
        return self.diagnosis.where

    @property
    def evidence(self) -> str:
        """The evidence for the cause, in one sentence."""
        return self.diagnosis.evidence

    @property
    def recognised(self) -> list[str]:
        """Assumptions in reading and judging the files, as sentences."""
        read = [f"{file.record.name}: {text}" for file in self.files for text in file.record.recognised]
        return [*read, *self.assumed]

    def as_json(self) -> dict[str, Any]:
        """Return the keys :data:`KEYS` with JSON types; a number that is not finite becomes null."""
        error = {name: {key: plain(value) for key, value in part.items()} for name, part in self.error.items()}
        return {key: self[key] for key in KEYS} | {"error": error}

    @property
    def study(self) -> Study:
        """The judgement as a study: sentences, tables, figures and verdicts of its page."""
        from dem_bridge.judging.shown import judgement_study  # it is built on judgements

        return judgement_study(self)

    def save(self, folder: str | Path) -> None:
        """Write the page, ``verdicts.json``, tables and figures into ``folder``, which is created if need be."""
        self.study.save(folder)

    def __repr__(self) -> str:
        from dem_bridge.judging.sentences import text_of  # they are built on judgements

        return text_of(self)

    def _repr_html_(self) -> str:
        return self.study._repr_html_()


def _has_common_factor(scene: Scene) -> bool:
    """Return True if one factor on all masses and stiffnesses changes no motion of a scene."""
    forces = (scene.adhesion, scene.drive, scene.law)
    constant = scene.damping is not None and scene.damping.law == "dashpot"
    return not constant and scene.precompression == 0.0 and all(part is None for part in forces)
