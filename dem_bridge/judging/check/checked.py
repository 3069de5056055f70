"""The check of one script or scene: its runs in order, and the answer that follows from them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dem_bridge.errors import BackendUnavailable, DemBridgeError, RunBroken, UnsupportedScene, UsageError
from dem_bridge.foundation.wording import number, share
from dem_bridge.judging.check.answer import Check, Pictures
from dem_bridge.judging.check.edits import Edit, applied
from dem_bridge.judging.check.laboratory import Laboratory, Progress
from dem_bridge.judging.check.law import EngineAnswer, LawAnswer, engine_of, law_by_steps, law_by_tables, law_of
from dem_bridge.judging.check.neighbours import SAFE_COMMAND, safe_edits
from dem_bridge.judging.check.plausible import LARGEST_OVERLAP_AT_START, plausibility_of, start_overlap
from dem_bridge.judging.check.step import StepAnswer, step_by_lammps, step_of
from dem_bridge.judging.check.subject import Subject, short_problem, subject_of, why_unread
from dem_bridge.judging.check.ties import ties_of
from dem_bridge.judging.deck import user_deck
from dem_bridge.judging.unit_test.recorded import recorded_of
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.known_defects import defects_of
from dem_bridge.lmp.process import probe
from dem_bridge.lmp.reader.script import logical_lines
from dem_bridge.observables.convergence import checked_accuracy
from dem_bridge.observables.verdict import Outcome
from dem_bridge.scene.scene import Scene

#: messages of LAMMPS on bodies that have left the box or have no place, or are closer than a table goes
_MESSAGES_ON_LOST_BODIES = re.compile(
    r"Lost atoms|Non-numeric|out of range atoms|no longer in the simulation box|leaves the box"
    r"|table (inner|outer) cutoff",
    re.IGNORECASE,
)
#: message on a run of which atoms come or go by a command
_ATOMS_CHANGE = re.compile(r"atom \d+ (appears|is removed) between")
#: factors by which steps are shortened until LAMMPS loses no body, and the work (steps times bodies) of the last one
_FACTORS_OF_RESCUE, _MOST_STEPS_TIMES_BODIES = (2, 10, 50, 250), 5e7
#: step, relative to 2/omega of the stiffest contact, at which a body that is lost is not lost by the step
_STEP_THAT_LOSES_NO_BODY = 0.1

#: callback that is told the expected time of a check, s; None where it cannot be known
Announce = Callable[[float | None], None]


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Law and step of one script."""

    law: LawAnswer
    step: StepAnswer
    version: int


def check_file(
    file: str | Path | Scene,
    *,
    accuracy: float = 1e-3,
    dt: float | None = None,
    variables: Mapping[str, str] | None = None,
    engine: Engine | None = None,
    time_limit: float = 600.0,
    progress: Progress | None = None,
    announce: Announce | None = None,
) -> Check:
    """Check a script or a scene, see :func:`dem_bridge.check`."""
    accuracy = checked_accuracy(accuracy)
    with subject_of(file, dt=dt, variables=variables) as subject:
        lab = Laboratory(subject=subject, engine=engine, time_limit=time_limit, progress=progress)
        if announce is not None:
            announce(lab.expected_cost())
        first = finding_of(lab, accuracy)
        law_edits = edits_of_law(subject, first)
        last, last_lab = first, lab
        if law_edits:
            # the lines of the steps follow from the script without what is wrong in it
            last_lab = replace(lab, subject=_changed(subject, law_edits))
            last_lab = Laboratory(subject=last_lab.subject, engine=engine, time_limit=time_limit, progress=progress)
            last = finding_of(last_lab, accuracy)
            if last.law.outcome is Outcome.BROKEN:  # these lines do not mend it
                law_edits, last = (), first
        edits = (*law_edits, *subject.added, *_list_edits(subject, last), *_step_edits(subject, last))
        return _answer(lab, first, last, _merged(edits), accuracy)


def finding_of(lab: Laboratory, accuracy: float) -> Finding:
    """Return law and step of a script; BROKEN where LAMMPS fails for another reason than the step."""
    deck = lab.subject.deck
    nothing = StepAnswer(dt=deck.dt, accuracy=accuracy, why="the script has no run that can be read")
    if deck.state.run is None and lab.scene is None:
        law = LawAnswer(outcome=Outcome.UNDECIDED, sentence=f"{why_unread(lab.subject)}.")
        return Finding(law=law, step=nothing, version=_version(lab))
    factor = 1
    try:
        run = lab.lammps()
    except RunBroken as error:
        if lab.scene is None and _ATOMS_CHANGE.search(str(error)):
            law = LawAnswer(outcome=Outcome.UNDECIDED, sentence=f"{why_unread(lab.subject)}.")
            return Finding(law=law, step=replace(nothing, why=f"{error}: no runs are compared"), version=_version(lab))
        lost = _finer_runs(lab, str(error))
        if lost.factor is None:
            broken = replace(nothing, outcome=Outcome.BROKEN, why="LAMMPS did not end its run")
            return Finding(law=_broken(lab, str(error), lost.tried), step=broken, version=_version(lab))
        factor, run = lost.factor, lab.lammps(lost.factor)
    if lab.scene is None:
        law = LawAnswer(outcome=Outcome.UNDECIDED, sentence=f"{why_unread(lab.subject)}.")
        return Finding(law=law, step=_alone(lab, accuracy, run.finite, factor), version=run.version)
    try:
        _ = lab.reference
    except UnsupportedScene as error:
        law = LawAnswer(outcome=Outcome.UNDECIDED, sentence=f"{error}.")
        return Finding(law=law, step=_alone(lab, accuracy, run.finite, factor), version=run.version)
    if lab.problem:
        law = law_by_steps(lab, factor)
        return Finding(law=law, step=_alone(lab, accuracy, run.finite, factor), version=run.version)
    law = law_by_tables(lab, accuracy, factor) if deck.tables else law_of(lab, factor)
    step = step_of(lab, accuracy, law_is_right=law.outcome is Outcome.PASS, lost=factor > 1)
    return Finding(law=law, step=step, version=run.version)


def _alone(lab: Laboratory, accuracy: float, finite: bool, base: int) -> StepAnswer:
    """Return the answer on the step by LAMMPS alone, or why there is none."""
    unknown = StepAnswer(dt=lab.subject.deck.dt, accuracy=accuracy, unit=lab.subject.time_unit)
    if not finite:
        return replace(unknown, why="velocities of LAMMPS are not numbers")
    try:
        return step_by_lammps(lab, accuracy, base)
    except (UsageError, RunBroken) as error:
        return replace(unknown, why=f"finer steps cannot be tried: {error}")


@dataclass(frozen=True, kw_only=True)
class Rescue:
    """What finer runs show of a body that is lost."""

    factor: int | None = None
    """By what steps must be divided so that no body is lost; None if this was not found."""
    tried: int = 0
    """The finest run that lost a body, too, as a factor; 0 if none was made."""


def _finer_runs(lab: Laboratory, message: str) -> Rescue:
    """Run LAMMPS with finer steps, which show whether the step is the reason why it lost a body."""
    if not _MESSAGES_ON_LOST_BODIES.search(message):
        return Rescue()
    dt, state, tried = lab.subject.deck.dt, lab.subject.deck.state, 0
    work = state.steps * max(1, len(state.particles.atoms))
    frequency = 0.0 if lab.prescan is None else lab.prescan.frequency
    for factor in _FACTORS_OF_RESCUE:
        if tried and factor * work > _MOST_STEPS_TIMES_BODIES:
            break
        try:
            lab.lammps(factor)
        except RunBroken:
            tried = factor
        except UsageError:
            break
        else:
            return Rescue(factor=factor)
        if dt is not None and 0.0 < 0.5 * frequency * dt / factor < _STEP_THAT_LOSES_NO_BODY:
            break  # so fine a step loses no body
    return Rescue(tried=tried)


def _broken(lab: Laboratory, message: str, tried: int) -> LawAnswer:
    """Return what LAMMPS said, and what that may mean."""
    hint, cause = "", ""
    if tried and "cutoff" in message:
        hint = f"; steps {tried} times shorter do not help: the table does not begin at a small enough distance"
    elif tried:
        hint, cause = _leaving(lab, tried)
    elif _MESSAGES_ON_LOST_BODIES.search(message):
        hint = "; a run with finer steps, which would show whether the step is the reason, cannot be made"
    if "time limit" in message:
        steps = lab.subject.deck.state.steps
        hint = f"; of {steps} steps neither law nor step is checked: give a longer --time-limit, or check a shorter run"
    if lab.scene is None and lab.subject.deck.problems:
        hint = f"{hint}; {why_unread(lab.subject)}"
    said = re.sub(r" For more information see \S+", "", message.removeprefix("LAMMPS: "))
    said = f"LAMMPS stopped: {said}" if message.startswith("LAMMPS: ") else said
    return LawAnswer(outcome=Outcome.BROKEN, sentence=f"{said}{hint}.", cause=cause)


def _leaving(lab: Laboratory, tried: int) -> tuple[str, str]:
    """Return why a body leaves the box at any step, and the cause "box" if another boundary may mend it."""
    deck = lab.subject.deck
    hint = f"; with steps {tried} times shorter, too: "
    if (start := start_overlap(deck)) is not None and start.part > LARGEST_OVERLAP_AT_START:
        return f"{hint}{start.sentence}, which drives them apart", ""
    if deck.last("minimize") is not None:
        return f"{hint}a body leaves the box after `minimize`", ""
    box = deck.last("boundary")
    if box is not None and "f" in "".join(box.rest):
        return f"{hint}a body leaves the box (`boundary m m m` lets the box follow)", "box"
    return f"{hint}a body leaves the box", ""


def _version(lab: Laboratory) -> int:
    """Return the release of the engine; 0 if it does not say."""
    try:
        return probe(lab.engine or Engine.chosen()).version
    except BackendUnavailable:
        return 0


# ---------------------------------------------------------------- lines to write
def edits_of_law(subject: Subject, finding: Finding) -> tuple[Edit, ...]:
    """Return the lines that mend what is wrong in the law of a script, as far as lines can."""
    law = finding.law
    if subject.of_scene or law.outcome is Outcome.PASS:
        return ()
    edits: dict[tuple[str, int], Edit] = {}
    texts = subject.texts()
    commands = "\n".join(command.text for command in subject.deck.commands)
    for file, text in texts.items():
        for line, raw in logical_lines(text):
            new = raw
            for defect in defects_of(finding.version, commands):
                new = defect.mended(new)
            if law.cause == "missed contacts" and raw.split()[:1] == ["neigh_modify"]:
                new = SAFE_COMMAND
            if law.cause == "box" and raw.split()[:1] == ["boundary"]:
                new = raw.replace("f", "m")
            if new != raw:
                edits[file, line] = Edit(file=file, line=line, new=new.strip())
    if law.cause == "mixing" and subject.deck.read is not None:
        last = subject.deck.last("pair_coeff")
        assert last is not None  # types mix by their lines
        raw = dict(logical_lines(texts[last.file]))[last.line]
        lines = "\n".join((raw.strip(), *subject.deck.read.mixed))
        edits[last.file, last.line] = Edit(file=last.file, line=last.line, new=lines)
    return tuple(edits.values())


def _changed(subject: Subject, edits: tuple[Edit, ...]) -> Subject:
    """Return a script with other lines."""
    changed = {**subject.changed, **applied(subject.texts(), edits)}
    deck = user_deck(subject.path, variables=subject.variables, changed=changed)
    scene = None if deck.read is None else deck.read.scene
    return replace(subject, deck=deck, scene=scene, changed=changed)


def _list_edits(subject: Subject, finding: Finding) -> tuple[Edit, ...]:
    """Return the line of a neighbour list that misses no contact, if that of the script may at its own step."""
    if not finding.step.list_limit < (finding.step.dt or 0.0):
        return ()
    return safe_edits(subject.deck)


def _step_edits(subject: Subject, finding: Finding) -> tuple[Edit, ...]:
    """Return the lines of finer steps, if the answer has some."""
    if finding.step.outcome is not Outcome.FAIL or finding.step.factor < 2 or subject.of_scene:
        return ()
    if finding.step.only_coarse:
        return subject.edits_of_coarse(finding.step.factor)
    try:
        return subject.edits(finding.step.factor)
    except UsageError:
        return ()


def _merged(edits: tuple[Edit, ...]) -> tuple[Edit, ...]:
    """Return edits of which the last counts for each line, in the order of the lines.

    An edit of a line that the script does not have yet is that line with other words.
    """
    lacking = {(edit.file, edit.line) for edit in edits if edit.added and edit.new.startswith("run ")}
    by_place: dict[tuple[str, int, str], Edit] = {}
    for edit in edits:
        added = edit.added or (edit.file, edit.line) in lacking
        by_place[edit.file, edit.line, edit.new.split()[0] if added else ""] = replace(edit, added=added)
    return tuple(sorted(by_place.values(), key=lambda e: (e.file, e.line, not e.added, e.new.startswith("run "))))


# ---------------------------------------------------------------- the answer
def _answer(lab: Laboratory, first: Finding, last: Finding, edits: tuple[Edit, ...], accuracy: float) -> Check:
    subject, step = lab.subject, replace(first.step, assumed=lab.subject.assumed)
    engine: EngineAnswer = engine_of(subject.deck, first.version, first.law.outcome)
    texts = subject.texts()
    text = texts[subject.path.name]
    if last is not first:
        step = last.step if step.outcome is not Outcome.PASS else step
    lab.say("ties")
    ties, no_ties = ties_of(subject.deck)
    recorded = None
    if subject.test is not None:
        recorded = recorded_of(subject.test, subject.deck, ties, lab.engine, lab.time_limit)
    command = ""
    if subject.of_scene and step.factor > 1 and step.dt is not None:
        command = f"dem-bridge deck {subject.of_scene} --dt {step.dt / step.factor:.6g} -o DIR  # {_relation(step)}"
    originals = {file: body for file, body in texts.items() if file not in subject.changed} | {
        file: (subject.path.parent / file).read_text(encoding="utf-8-sig") for file in subject.changed
    }
    return Check(
        name=subject.name,
        title=_title(lab),
        accuracy=accuracy,
        law_answer=first.law,
        step_answer=step,
        engine_answer=engine,
        plausible=plausibility_of(lab, text),
        edits=edits,
        command=command,
        unsupported=tuple(map(short_problem, subject.deck.problems)) if lab.scene is None else (),
        notes=(*_notes(lab, last is not first), *([f"Ties were not looked for: {no_ties}."] if no_ties else [])),
        text=text,
        corrected=applied(originals, edits) if edits else {},
        companions=subject.companions() if edits else {},
        pictures=_pictures(lab, first),
        tie_answers=ties,
        recorded_answer=recorded,
    )


def _relation(step: StepAnswer) -> str:
    """Return what the step of a command is beside the step that was checked and the largest one for the accuracy."""
    tried = f": LAMMPS errs by {share(step.confirmed)}" if math.isfinite(step.confirmed) else ""
    largest = step.largest_for_accuracy
    most = f"; at most {number(largest)} {step.unit} gives {share(step.accuracy)}" if largest > 0.0 else ""
    return f"1/{step.factor} of {step.step}{tried}{most}"


def _title(lab: Laboratory) -> str:
    """Return name and size of what was checked."""
    scene, state = lab.scene, lab.subject.deck.state
    bodies = scene.n_body if scene is not None else len(state.particles.atoms)
    many = f"{bodies} bodies" if bodies != 1 else "1 body"
    contacts = f", {scene.n_contact} contact{'s' * (scene.n_contact != 1)}" if scene is not None else ""
    return f"{lab.subject.name}: {many}{contacts}" if bodies else lab.subject.name


def _notes(lab: Laboratory, mended: bool) -> list[str]:
    """Return how the numbers were found."""
    subject = lab.subject
    notes = list(subject.deck.read.notes) if subject.deck.read is not None and not subject.of_scene else []
    if subject.added:
        notes.append(
            f"The script has no run: it was checked with `{subject.added[0].new}`, in which a front passes all bodies."
        )
    if subject.test is not None:
        notes.append(f"The script {subject.path.name} has the commands of the unit test in the order of LAMMPS.")
    if subject.of_scene:
        notes.append(f"The script is the deck of the scene at {number(subject.deck.dt)} s.")
    notes += [f"Without effect on the scene: {short_problem(problem)}." for problem in subject.deck.overlooked]
    if lab.scene is None:
        notes.append("The law was not checked; the step by runs of LAMMPS at the step, a half and a quarter of it.")
    elif lab.resolves:
        notes.append(
            "Errors are the largest of the whole run: while forces act, no velocity changes by more than about 2 % of"
            " the largest between two samples."
        )
    if lab.scene is not None:
        notes.append(
            "Errors are those of velocities, largest over all bodies and samples, relative to the largest velocity of"
            " the reference. The law is LAMMPS minus our velocity-Verlet code at the same step."
        )
    if mended:
        notes.append("The step to write is that of the script with the other lines written.")
    return notes


def _pictures(lab: Laboratory, finding: Finding) -> Pictures | None:
    """Return the samples for the page; None where there is no reference."""
    if lab.scene is None or lab.problem or finding.law.outcome is Outcome.BROKEN or math.isinf(finding.step.error):
        return None
    try:
        run, reference = lab.lammps(), lab.reference
        if not run.finite:
            return None
        exact = lab.exact(lab.times)
        rows = min(len(run.velocity), len(exact))
        error = (run.velocity[:rows] - exact[:rows, list(run.bodies)]) / lab.speed
    except DemBridgeError:
        return None
    if not np.all(np.isfinite(error)):
        return None
    sources = [("reference", reference.uncertainty["velocity"] / lab.speed)]
    sources.append(("law", finding.law.difference))
    deck = lab.subject.deck
    assert deck.dt is not None  # see ``Laboratory.problem``
    if deck.radius is not None:
        round_off = float(np.max(np.abs(lab.twin(deck.dt, deck.radius) - lab.twin(deck.dt)))) / lab.speed
        sources.append(("round-off", round_off))
    sources.append(("time step", lab.twin_error(deck.dt)[1]))
    return Pictures(time=lab.times[:rows], error=error, sources=tuple(sources))
