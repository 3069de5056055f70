"""First screen of the report: three numbers; question, method and result in points; and what is wrong in the paper.

All numbers follow from verdicts, claims, effects and runs.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.study import Claim, Headline, Points, Table
from dem_bridge.report.texts import Texts, fill
from dem_bridge.studies.paper.claims import by
from dem_bridge.studies.paper.claims_pulses import striker_shares
from dem_bridge.studies.paper.effects import AS_IS, Effect
from dem_bridge.studies.paper.measures import deviation, profiled
from dem_bridge.studies.paper.runs import ACCELERATING, DECELERATING, MAIN, OTHER_ACCURACY, Runs
from dem_bridge.studies.paper.summary import counted, failures
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.proved import largest_proved_error

TEXTS = Texts("overview", "dem_bridge.studies")
#: parts of the abstract in their order
PARTS = ("question", "method", "result", "effects", "criteria", "not_verified")
#: kinds of statements that miss their criterion, in the order of the table
WRONG = {"print": "wrong in print", "theory": "theory off", "limit": "beyond our limit"}
WRONG_COLUMNS = ("no.", "about", "found (criterion)", "kind")
#: outcomes of comparisons that can pass or fail
_JUDGED = (Outcome.PASS, Outcome.FAIL, Outcome.UNDECIDED, Outcome.BROKEN)
#: share of the largest part of an error from which on it is called the cause
_MOST = 0.9


def headlines(claims: Sequence[Claim], studies: Sequence[SceneStudy], runs: Runs) -> tuple[Headline, ...]:
    """Return the numbers shown large: error of LAMMPS, central result, arrival by BCA, statements that hold."""
    found = []
    of_main = [study for study in studies if study.scene.name in MAIN and study.budgets]
    of_main = [study for study in of_main if math.isfinite(study.budgets[0].found)]
    if of_main:
        worst = max(of_main, key=lambda study: study.budgets[0].found)
        found.append(Headline(number=f"{worst.budgets[0].found:.1e}", sentence=_error(worst)))
    by_id = {claim.id: claim for claim in claims}
    if (speeds_of_wave := _ratios(by_id)) is not None:
        low, high = speeds_of_wave
        found.append(Headline(number=f"{low:.2f} and {high:.2f}", sentence=TEXTS("wave")))
    away = _away(by_id)
    chains = [(runs.scenes[name], runs.run(name, "bca"), runs.truth(name)) for name in MAIN if runs.has(name)]
    speeds = [_middle_speed(scene, bca) / _middle_speed(scene, truth) for scene, bca, truth in chains if bca and truth]
    if math.isfinite(away) and speeds:
        words = TEXTS("arrival", velocity=max(speed - 1.0 for speed in speeds))
        found.append(Headline(number=f"{100.0 * away:.2g} %", sentence=words))
    if claims:
        holding = sum(claim.kind == "holds" for claim in claims)
        rest = [claim for claim in claims if claim.kind != "holds"]
        others = counted(rest) or "none is wrong"
        found.append(Headline(number=f"{holding} of {len(claims)}", sentence=TEXTS("statements", others=others)))
    return tuple(found)


def _error(study: SceneStudy) -> str:
    """Return the sentence of the largest error of LAMMPS, with its cause if one part makes nearly all of it."""
    budget, run = study.budgets[0], study.run(study.engine)
    cause, size = max(budget.parts.items(), key=lambda part: part[1])
    step = math.nan if run is None else float(run.provenance["settings"]["dt"])
    words = TEXTS("error", dt=step, cause=f"the {cause}" if size >= _MOST * budget.found else "several parts")
    return words + (TEXTS("halving") if cause == "time step" and size >= _MOST * budget.found else "")


def _middle_speed(scene: Any, run: Any) -> float:
    """Return the largest velocity of cylinder 20."""
    return float(OBSERVABLES["peak_velocity"].value(scene, run)[20])


def _away(by_id: Mapping[str, Claim]) -> float:
    """Return the largest error of the BCA in the arrival at the last cylinder, relative."""
    claim = by_id.get("arrival-by-bca")
    values = () if claim is None else claim.values
    return max((abs(value.value) for value in values if value.name.startswith("with T_0")), default=math.nan)


def abstract(
    claims: Sequence[Claim], effects: Sequence[Effect], studies: Sequence[SceneStudy], runs: Runs, accuracy: float
) -> tuple[Points, ...]:
    """Return question, method and result in three points each; then effects, criteria and what is not verified."""
    verdicts = Counter(verdict.outcome for study in studies for verdict in study.verdicts)
    sensitive = (n for n, claim in enumerate(claims, start=1) if claim.margin is not None and claim.margin.changes)
    values: dict[str, Any] = {
        "count": len(claims),
        "scenes": len(studies),
        "main": accuracy,
        "others": max(accuracy, OTHER_ACCURACY),
        "total": verdicts.total(),
        "judged": sum(verdicts[outcome] for outcome in _JUDGED),
        "passed": verdicts[Outcome.PASS],
        "theory": verdicts[Outcome.MODEL_DIFFERENCE],
        "missing": verdicts[Outcome.NOT_RUN],
        "errors": _errors(studies),
        "kinds": counted(claims) or "none was tested",
        "central": _central(claims, runs),
        "largest": _largest(effects, runs),
        "energy": _energy(runs),
        "numbers": _listed(sensitive),
    }
    parts = (TEXTS.data["parts"][part] for part in PARTS)
    return tuple(
        Points(heading=part["heading"], points=tuple(filter(None, (fill(p, **values) for p in part["points"]))))
        for part in parts
    )


def _within(key: str, **values: Any) -> str:
    return TEXTS(key, "within", **values)


def _errors(studies: Sequence[SceneStudy]) -> str:
    main = [study for study in studies if study.scene.name in MAIN and study.budgets]
    if not main:
        return ""
    proved = largest_proved_error(main)
    errors = _within("errors", error=max(study.budgets[0].found for study in main))
    return errors + ("" if math.isnan(proved) else _within("proved", error=proved))


def _ratios(by_id: Mapping[str, Claim]) -> tuple[float, float] | None:
    """Return V_out/V_in of the decelerating and of the accelerating chain; None unless both statements hold."""
    both = [by_id.get(id) for id in ("decelerates", "accelerates")]
    held = [claim for claim in both if claim is not None and claim.outcome is Outcome.PASS]
    return (by(held[0].values).value, by(held[1].values).value) if len(held) == len(both) else None


def _central(claims: Sequence[Claim], runs: Runs) -> str:
    """Return the central statement with its numbers; without them unless it holds."""
    by_id = {claim.id: claim for claim in claims}
    central = [by_id.get(id) for id in ("decelerates", "accelerates", "arrival-by-bca")]
    if any(claim is None or claim.outcome is not Outcome.PASS for claim in central):
        return _within("no_central")
    low, high = _ratios(by_id) or (math.nan, math.nan)
    chains = [(runs.scenes[name], runs.run(name, "bca"), runs.truth(name)) for name in MAIN]
    along = [deviation("arrival", scene, bca, truth) for scene, bca, truth in chains if bca and truth]
    ends = [(bca.crossing_time[2:38], truth.crossing_time[2:38]) for _, bca, truth in chains if bca and truth]
    return _within(
        "central",
        low=low,
        high=high,
        away=_away({claim.id: claim for claim in claims}),
        worst=max(float(np.max(np.abs(of_chain))) for of_chain in along),
        wide=max(float(np.max(np.abs(by_theory / exact - 1.0))) for by_theory, exact in ends),
    )


def _energy(runs: Runs) -> str:
    """Return which share of the striker's energy the fronts carry; empty where a chain has no run."""
    shares = {name: striker_shares(runs.scenes[name], truth) for name in MAIN if (truth := runs.truth(name))}
    if len(shares) < len(MAIN):
        return ""
    slow, fast = shares[DECELERATING], shares[ACCELERATING]
    return _within("energy", slow=slow, fast=fast, never=1.0 - slow["late"])


def _listed(numbers: Iterable[int]) -> str:
    """Return numbers as text: "7, 11 and 15"."""
    *most, last = [str(number) for number in numbers] or ["none"]
    return " and ".join(filter(None, [", ".join(most), last]))


def _largest(effects: Sequence[Effect], runs: Runs) -> str:
    """Return the largest effects of the model in words."""

    def largest_of(id: str) -> tuple[float, str]:
        changes = [(abs(change), name) for item in effects if item.id == id for name, change in item.changes.items()]
        return max((change for change in changes if math.isfinite(change[0])), default=(math.nan, ""))

    (law, law_name), (striker, _), (exponent, _) = map(largest_of, ("exact-stiffness", "striker-mass", "exponent-1um"))
    single = _single_cylinders(runs)
    if not math.isfinite(law + striker + exponent + single["first"]):
        return _within("no_effects")
    of_law = _within("largest", law=law, law_name=law_name, **single)
    return f"{of_law} {_within('supposed', striker=striker, exponent=exponent)}"


def _single_cylinders(runs: Runs) -> dict[str, float]:
    """Return the largest change of the wave speed by the exact stiffness: from cylinder 5 on, and at cylinder 1."""
    changes = []
    for name in MAIN:
        names = [f"{name}.{variant}" for variant in (AS_IS, "exact-stiffness")]
        if all(runs.has(of) for of in names):
            scene = runs.scenes[name]
            times = OBSERVABLES["residence_time"].value
            base, exact = (times(scene, run) for of in names if (run := runs.truth(of)))
            off = np.abs(base / exact - 1.0)
            changes.append((np.max(off[profiled(scene)]), off[1]))
    inner, first = np.max(changes, axis=0) if changes else (math.nan, math.nan)
    return {"inner": float(inner), "first": float(first)}


def wrong_table(claims: Sequence[Claim]) -> Table:
    """Return the table of the statements that miss their criterion, by kind, and of theories without one."""
    numbers = {claim.id: number for number, claim in enumerate(claims, start=1)}
    listed = [(claim, what) for claim, _, what in failures(claims)]
    listed += [(c, c.id.replace("-", " ")) for c in claims if c.outcome is Outcome.MODEL_DIFFERENCE]
    listed.sort(key=lambda item: list(WRONG).index(item[0].kind))  # the order within a kind stays
    rows = [(numbers[claim.id], what, claim.short, WRONG[claim.kind]) for claim, what in listed]
    return TEXTS.table("wrong", WRONG_COLUMNS, rows)


__all__ = ["abstract", "headlines", "wrong_table"]
