"""Whether LAMMPS does what a script says: its run against our code at the same step, and defects of the release."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from dem_bridge.errors import DemBridgeError, RunBroken, UsageError
from dem_bridge.foundation.wording import number, release, share
from dem_bridge.judging.check.laboratory import Laboratory
from dem_bridge.judging.check.lammps_run import LammpsRun
from dem_bridge.judging.deck import UserDeck
from dem_bridge.judging.table_law import worst
from dem_bridge.lmp.known_defects import KnownDefect, defects_of
from dem_bridge.lmp.reader.evaluation import UNITS
from dem_bridge.lmp.reader.mixing import mixing_warning
from dem_bridge.observables.verdict import Outcome
from dem_bridge.physics.damped_impact import alpha_of_tsuji_without_sqrt2, restitution_of_alpha

#: relative difference of LAMMPS from our code at the same step that only round-off explains, and the multiple of what a
#: particle radius changes that counts as round-off, too
LARGEST_ROUNDOFF, MULTIPLE_OF_RADIUS_CHANGE = 1e-7, 20.0
#: how many times finer the steps are at which a difference is measured again, the part of it that must be gone then,
#: and the largest that may be left
_FACTOR_OF_FINER_STEPS, _LARGEST_SHARE_LEFT, _LARGEST_LEFT = 4, 0.5, 0.03
#: doublings of the points of a table that are tried for one that serves
_MOST_DOUBLINGS = 10
#: largest step, relative to the stability limit 2/omega, at which runs say something about a law
_LARGEST_STEP_OF_LIMIT = 0.25


@dataclass(frozen=True, kw_only=True)
class LawAnswer:
    """What is left of LAMMPS minus the scene of its script if the time step is removed; relative."""

    outcome: Outcome
    sentence: str
    difference: float = math.nan
    allowed: float = LARGEST_ROUNDOFF
    cause: str = ""
    """What is wrong: name of a known defect, "missed contacts", "mixing", or a cause of ``judge``."""


@dataclass(frozen=True, kw_only=True)
class EngineAnswer:
    """The release that ran the script, and its known defects that the script meets."""

    version: int
    defects: tuple[KnownDefect, ...]
    bite: bool | None
    """True if LAMMPS is wrong in this run, False if it is right in spite of them, None if this is not known."""
    of_release: int = 0
    """Number of known defects of the release."""

    @property
    def outcome(self) -> Outcome:
        """PASS where no defect is met, or none changes the run."""
        return Outcome.PASS if not self.defects or self.bite is False else Outcome.FAIL

    @property
    def sentence(self) -> str:
        """The defects in a sentence."""
        name = f"LAMMPS {release(self.version)}"
        if not self.defects:
            return f"{name}: none of its {self.of_release} known defects is met."
        told = "; ".join(f"{item.name}: {item.size}" for item in self.defects)
        effect = {True: " and suffers from", False: " and does not suffer from in this run", None: ""}[self.bite]
        what = "a known defect" if len(self.defects) == 1 else "known defects"
        return f"{name} has {what} that the script meets{effect}: {told}."

    def as_json(self) -> dict[str, object]:
        """Return the release and its defects."""
        names = ("name", "symptom", "size", "instead", "upstream")
        entries = [{key: getattr(item, key) for key in names} | {"bites": self.bite} for item in self.defects]
        return {"release": self.version, "outcome": self.outcome.value, "sentence": self.sentence, "defects": entries}


def engine_of(deck: UserDeck, version: int, law: Outcome) -> EngineAnswer:
    """Return the known defects of a release that a script meets; they bite where the law is wrong."""
    text = "\n".join(command.text for command in deck.commands)
    bite = {Outcome.PASS: False, Outcome.FAIL: True}.get(law)
    return EngineAnswer(
        version=version, defects=defects_of(version, text), bite=bite, of_release=len(defects_of(version))
    )


def law_of(lab: Laboratory, factor: int = 1) -> LawAnswer:
    """Return the answer on the law of a script with a scene, whose run with steps so many times shorter ended.

    The difference is that from our code at the step of the script, with its particle radius. Where that is more than
    round-off, finer steps tell a difference that falls with the step, such as that of a touch, from a wrong law.
    """
    deck = lab.subject.deck
    assert deck.dt is not None  # see ``Laboratory.problem``
    name = law_name(deck)
    try:
        factor = max(factor, _resolving(lab, deck.dt))
        run = lab.lammps(factor)
    except (UsageError, RunBroken) as error:
        return _unsure(name, math.inf, LARGEST_ROUNDOFF, str(error))
    if not run.finite:
        return _wrong(lab, run, math.inf)
    dt = deck.dt / factor
    closes = lab.prescan is None or float(np.max(lab.prescan.peak_overlap, initial=0.0)) > 0.0
    if not closes:
        return LawAnswer(outcome=Outcome.UNDECIDED, sentence="no contact closes during the run, so no law acts.")
    difference, allowed = _difference(lab, run, dt)
    if difference <= allowed:
        step = "the same step" if factor == 1 else f"{number(dt)} s, which resolves the contacts"
        said = f"{name}: LAMMPS and our code differ by {share(difference)} of the largest velocity at {step}."
        return LawAnswer(outcome=Outcome.PASS, sentence=said, difference=difference, allowed=allowed)
    try:
        finer, allowed = _difference(lab, lab.lammps(_FACTOR_OF_FINER_STEPS * factor), dt / _FACTOR_OF_FINER_STEPS)
    except (UsageError, RunBroken) as error:
        return _unsure(name, difference, allowed, str(error))
    if finer <= max(allowed, min(_LARGEST_SHARE_LEFT * difference, _LARGEST_LEFT)):
        said = f"{name}: the difference from our code falls with the step, from {share(difference)} to {share(finer)}."
        return LawAnswer(outcome=Outcome.PASS, sentence=said, difference=finer, allowed=allowed)
    return _wrong(lab, run, finer)


def law_by_tables(lab: Laboratory, accuracy: float, factor: int = 1) -> LawAnswer:
    """Return the answer on the tables of a script: what they err in forces, and in velocities with the step removed.

    The error of velocities is LAMMPS with the tables minus our code with the laws that they mean, at the same step.
    """
    deck = lab.subject.deck
    assert deck.dt is not None  # see ``Laboratory.problem``
    length = UNITS.get(deck.state.units, (1.0, 1.0, 1.0))[0]
    deepest = 0.0 if lab.prescan is None else float(np.max(lab.prescan.peak_overlap, initial=0.0)) / length
    if not deepest > 0.0:
        return LawAnswer(outcome=Outcome.UNDECIDED, sentence="no contact closes during the run, so no table acts.")
    table = worst(deck.tables, deepest)
    name = f"table {table.style} {table.points} ({table.name}), which means {table.model}"
    try:
        factor = max(factor, _resolving(lab, deck.dt))
        run = lab.lammps(factor)
    except (UsageError, RunBroken) as error:
        return _unsure(name, math.inf, accuracy, str(error))
    difference = _difference(lab, run, deck.dt / factor)[0] if run.finite else math.inf
    force = table.force_error(deepest)
    said = (
        f"{name}: over the overlaps of this run, up to {number(deepest * length)} m, its force errs by {share(force)}"
        f" of the largest, which changes velocities by {share(difference)} of the largest at the same step"
        f" ({share(accuracy)} allowed)"
    )
    if difference <= accuracy:
        return LawAnswer(outcome=Outcome.PASS, sentence=f"{said}.", difference=difference, allowed=accuracy)
    more = (2**k * table.points if table.style != "bitmap" else table.points + k for k in range(1, _MOST_DOUBLINGS + 1))
    errors = ((points, table.force_error(deepest, points)) for points in more)
    enough = next((points for points, error in errors if 2.0 * error * difference <= accuracy * force), 0)
    rest = (
        f"; with {enough} points it would be within it"
        if enough
        else "; more points do not help: its lines are wrong or too far apart"
    )
    return LawAnswer(
        outcome=Outcome.FAIL, sentence=f"{said}{rest}.", difference=difference, allowed=accuracy, cause="table"
    )


def _resolving(lab: Laboratory, dt: float) -> int:
    """Return by what to divide a step so that it resolves the contacts."""
    if lab.prescan is None or not lab.prescan.frequency > 0.0:
        return 1
    return max(1, math.ceil(dt * lab.prescan.frequency / (2.0 * _LARGEST_STEP_OF_LIMIT)))


def law_by_steps(lab: Laboratory, base: int = 1) -> LawAnswer:
    """Return the answer on the law by LAMMPS at finer and finer steps against the reference, without our code.

    ``base``: the coarsest of these runs has steps so many times shorter than those of the script.
    """
    run = lab.lammps(base)
    if not run.finite:
        return _wrong(lab, run, math.inf)
    name = law_name(lab.subject.deck)
    try:
        errors = [lab.error(lab.lammps(factor * base)) for factor in (1, 2, _FACTOR_OF_FINER_STEPS)]
    except (UsageError, RunBroken) as error:
        return _unsure(name, lab.error(run), LARGEST_ROUNDOFF, str(error))
    if errors[2] <= max(_LARGEST_SHARE_LEFT * errors[0], LARGEST_ROUNDOFF):
        sizes = ", ".join(map(share, errors))
        said = f"{name}: LAMMPS nears the reference with the step, {sizes} away at 1, 1/2 and 1/4 of it."
        return LawAnswer(outcome=Outcome.PASS, sentence=said, difference=errors[2])
    return _wrong(lab, run, errors[2])


def _difference(lab: Laboratory, run: LammpsRun, dt: float) -> tuple[float, float]:
    """Return the difference of LAMMPS from our code at a step, and what round-off of positions explains."""
    plain = lab.twin(dt)
    radius = lab.subject.deck.radius
    positional = plain if radius is None else lab.twin(dt, radius)
    rows = min(len(plain), len(run.velocity))
    columns = list(run.bodies)
    with np.errstate(all="ignore"):
        apart = np.abs(run.velocity[:rows] - positional[:rows, columns])
        round_off = float(np.max(np.abs(positional - plain))) / lab.speed
        nearest = min(float(np.max(apart)), float(np.max(np.abs(run.velocity[:rows] - plain[:rows, columns]))))
    difference = max(nearest, lab.apart_while_active(run, dt, radius)) / lab.speed
    return difference if math.isfinite(difference) else math.inf, max(
        LARGEST_ROUNDOFF, MULTIPLE_OF_RADIUS_CHANGE * round_off
    )


def _unsure(name: str, difference: float, allowed: float, why: str) -> LawAnswer:
    size = f"LAMMPS is {share(difference)} of the largest velocity away"
    said = f"{name}: {size}, and finer steps cannot be tried: {why.rstrip('.')}."
    return LawAnswer(outcome=Outcome.UNDECIDED, sentence=said, difference=difference, allowed=allowed)


def _wrong(lab: Laboratory, run: LammpsRun, difference: float) -> LawAnswer:
    """Return the answer for a run that no step explains, with what is known of its cause."""
    deck, name = lab.subject.deck, law_name(lab.subject.deck)
    size = (
        "velocities are not numbers" if math.isinf(difference) else f"LAMMPS is off by {share(difference)} at any step"
    )
    cause, why = "unknown", "the cause is not known; judge the script with the scene that you mean"
    defects = engine_of(deck, run.version, Outcome.FAIL).defects
    if defects:
        cause, why = defects[0].name, f"known defect {defects[0].name}: {_restitution(lab)}{defects[0].symptom}"
    elif deck.overlooked or run.dangerous:
        cause = "missed contacts"
        why = "contacts are missed between rebuilds of the neighbour list"
    elif deck.read is not None and mixing_warning(deck.read.mixed, run.version):
        cause, why = (
            "mixing",
            f"LAMMPS {release(run.version)} mixes the coefficients of two types otherwise than later ones",
        )
    elif not math.isinf(difference):
        cause, why = cause_by_judge(lab)
    return LawAnswer(outcome=Outcome.FAIL, sentence=f"{name}: {size}; {why}.", difference=difference, cause=cause)


def _restitution(lab: Laboratory) -> str:
    """Return which restitution is asked for and which is obtained, for the first contact of ``damping tsuji``."""
    damping = None if lab.scene is None else lab.scene.damping
    if damping is None or damping.law != "tsuji":
        return ""
    asked = float(np.atleast_1d(damping.coefficient)[0])
    n = float(lab.scene.contacts.exponent[0]) if lab.scene is not None else 2.5
    obtained = restitution_of_alpha(alpha_of_tsuji_without_sqrt2(asked), clip=bool(damping.clip), exponent=n)
    return f"you ask for e = {asked:g} and get {obtained:.3f}; "


def cause_by_judge(lab: Laboratory) -> tuple[str, str]:
    """Return the cause by which ``judge`` explains the run, and its evidence."""
    from dem_bridge.judging.beside import judge_decks

    assert lab.scene is not None
    lab.say("search for the cause")
    try:
        judgement = judge_decks(
            lab.scene,
            [],
            [lab.subject.path],
            time_limit=lab.time_limit,
            engine=lab.engine,
            variables=lab.subject.variables or None,
        )
    except DemBridgeError as error:
        return "unknown", f"the cause is not known ({error})"
    return judgement.cause, judgement.evidence.rstrip(".")


def law_name(deck: UserDeck) -> str:
    """Return the contact law of a script in a few words: model and damping of its pairs, or its pair style."""
    models = dict.fromkeys(c.rest[2] for c in deck.commands if c.name == "pair_coeff" and len(c.rest) > 2)
    dampings = dict.fromkeys(
        match[1]
        for c in deck.commands
        if c.name in ("pair_coeff", "fix") and (match := re.search(r" damping (\S+)", c.text))
    )
    style = deck.last("pair_style")
    if not models or style is None or style.rest[:1] != ("granular",):
        return " ".join(style.rest[:1]) if style is not None else "no pair_style"
    damped = " and ".join(dampings) or "viscoelastic"
    if deck.read is not None:  # the lines of a deck have more laws than act
        law = deck.read.scene.damping
        damped = damped if law is None or law.law not in dampings else law.law
    undamped = deck.read is not None and deck.read.scene.damping is None
    return f"{' and '.join(models)}, {'no damping' if undamped else f'damping {damped}'}"
