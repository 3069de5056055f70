"""The verification study: its verdicts on real runs, and that each of its checks can fail."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends import scipy_dop853
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.verlet import Verlet
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.foundation.beside import packed
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.svg import svg_of_data
from dem_bridge.runs.campaign import Result
from dem_bridge.runs.case import Case
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.features import DRAG
from dem_bridge.scene.scene import Damping, Scene, Wall
from dem_bridge.scene.support import Support
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification import checks, pictures
from dem_bridge.verification.assess import SceneStudy, assess_scene
from dem_bridge.verification.budget import Budget
from dem_bridge.verification.panels import maps_of, motion_of
from dem_bridge.verification.pictures import begin_budget, begin_motion
from dem_bridge.verification.reference_choice import BLANES_MOAN, REFERENCE, SCIPY
from dem_bridge.verification.roles import TABLE, THEORY, TWIN, Runs, assign_roles
from dem_bridge.verification.verify import plan_scene, verify_scenes
from tests.helpers.fake_runs import free_flight

SHORT = Scene(
    name="short",
    duration=1.5e-4,
    mass=(8.1e-3, 1.01e-2, 1.01e-2, 1.01e-2),
    stiffness=(3.98e9, 7e9, 5e9),
    velocity=(0.8, 0.0, 0.0, 0.0),
    samples=50,
    spacing=18e-3,
)
ACCURACY, ROLES = 1e-4, assign_roles(SHORT)
ENGINE = ROLES.engine


@pytest.fixture(scope="module")
def results() -> Runs[Result]:
    """All runs of the short scene, with the twin standing in for LAMMPS: judging needs no engine."""

    def run(case: Case) -> Result:
        backend = TWIN if case.backend == ENGINE else case.backend
        settings = case.resolution
        run = db.solve(
            SHORT,
            backend=backend,
            dt=settings.dt,
            uncertainty=case.uncertainty,
            surrogate_radius=settings.surrogate_radius,
        )
        return Result(case=case, trajectory=run)

    runs = plan_scene(SHORT, ACCURACY).runs
    assert runs is not None
    return runs.map(run)


def _with(results: Runs[Result], backend: str, **changes: Any) -> Runs[Result]:
    """Return the results with something planted in every run of one backend."""
    return results.map(
        lambda r: (
            replace(r, trajectory=replace(r.trajectory, **changes))
            if r.case.backend == backend and r.trajectory is not None
            else r
        )
    )


def _outcome(verdicts: tuple[Verdict, ...], quantity: str, backend: str, reference: str) -> Outcome:
    [verdict] = [v for v in verdicts if (v.quantity, v.backend, v.reference) == (quantity, backend, reference)]
    return verdict.outcome


def test_runs_without_a_fault_pass_everything(results: Runs[Result]) -> None:
    verdicts = assess_scene(ROLES, results, ACCURACY).verdicts
    outcomes = {v.outcome for v in verdicts}
    assert outcomes == {Outcome.PASS, Outcome.MODEL_DIFFERENCE}, [v.sentence for v in verdicts]
    assert {v.quantity for v in verdicts if v.backend == ENGINE} == {
        "velocity", "displacement", "contact_force", "peak_force", "crossing_time", "residence_time", "order",
        "momentum", "energy",
    }  # fmt: skip


def _main_run(results: Runs[Result], backend: str) -> Trajectory:
    run = next(r for r in results if r.case.backend == backend).trajectory
    assert run is not None
    return run


def test_a_late_velocity_fails_against_twin_and_reference_and_says_where(results: Runs[Result]) -> None:
    velocity = _main_run(results, ENGINE).velocity.copy()
    velocity[30:, 2] += 2e-4 * 0.8
    verdicts = assess_scene(ROLES, _with(results, ENGINE, velocity=velocity), ACCURACY).verdicts
    assert _outcome(verdicts, "velocity", ENGINE, TWIN) is Outcome.FAIL
    assert _outcome(verdicts, "velocity", ENGINE, REFERENCE) is Outcome.FAIL
    assert _outcome(verdicts, "velocity", TWIN, REFERENCE) is Outcome.PASS
    [verdict] = [v for v in verdicts if (v.quantity, v.reference) == ("velocity", TWIN)]
    assert verdict.first_divergence == (pytest.approx(30 * SHORT.duration / 50), 2)


@pytest.mark.parametrize(
    ("changed", "quantity"),
    [
        ("peak_force", "peak_force"),
        ("crossing_time", "crossing_time"),
        ("displacement", "displacement"),
        ("crossing_time", "residence_time"),
    ],
)
def test_a_wrong_quantity_fails_under_its_own_name(results: Runs[Result], changed: str, quantity: str) -> None:
    wrong = getattr(_main_run(results, ENGINE), changed).copy()
    wrong[..., 1] *= 1.0 + 10 * ACCURACY
    verdicts = assess_scene(ROLES, _with(results, ENGINE, **{changed: wrong}), ACCURACY).verdicts
    assert _outcome(verdicts, quantity, ENGINE, REFERENCE) is Outcome.FAIL
    assert _outcome(verdicts, "velocity", ENGINE, REFERENCE) is Outcome.PASS


def test_a_lost_crossing_fails(results: Runs[Result]) -> None:
    lost = _main_run(results, ENGINE).crossing_time.copy()
    lost[2] = np.nan
    verdicts = assess_scene(ROLES, _with(results, ENGINE, crossing_time=lost), ACCURACY).verdicts
    assert _outcome(verdicts, "crossing_time", ENGINE, REFERENCE) is Outcome.FAIL


def test_momentum_that_leaks_fails(results: Runs[Result]) -> None:
    velocity = _main_run(results, ENGINE).velocity * np.linspace(1.0, 1.0 + 1e-9, 51)[:, None]
    verdicts = assess_scene(ROLES, _with(results, ENGINE, velocity=velocity), ACCURACY).verdicts
    assert _outcome(verdicts, "momentum", ENGINE, "its own start") is Outcome.FAIL


def test_energy_that_grows_fails(results: Runs[Result]) -> None:
    velocity = _main_run(results, ENGINE).velocity * np.linspace(1.0, 1.001, 51)[:, None]
    verdicts = assess_scene(ROLES, _with(results, ENGINE, velocity=velocity), ACCURACY).verdicts
    assert _outcome(verdicts, "energy", ENGINE, "its own start") is Outcome.FAIL


def test_a_first_order_code_fails_the_order(results: Runs[Result]) -> None:
    truth = _main_run(results, REFERENCE).velocity

    def first_order(run: Trajectory) -> Trajectory:
        shift = np.zeros_like(truth)
        shift[25:, 1] = 1e3 * run.provenance["settings"]["dt"]
        return replace(run, velocity=truth + shift)

    planted = results.map(
        lambda r: replace(r, trajectory=first_order(r.trajectory)) if r.case.backend == ENGINE and r.trajectory else r
    )
    verdicts = assess_scene(ROLES, planted, ACCURACY).verdicts
    assert _outcome(verdicts, "order", ENGINE, "exact 2") is Outcome.FAIL
    assert _outcome(verdicts, "order", TWIN, "exact 2") is Outcome.PASS


DASHPOT = Damping(law="dashpot", coefficient=1.0)


@pytest.mark.parametrize(
    ("changes", "errors", "outcome", "words"),
    [
        ({}, lambda h: h**2, Outcome.PASS, "velocity-Verlet has order 2, tolerance +- 0.05"),
        ({}, lambda h: h, Outcome.FAIL, "fall as dt^1.000"),
        (
            {"drag": 1.0},
            lambda h: h,
            Outcome.PASS,
            "evaluated at the half step, which makes the order 1, tolerance +- 0.1",
        ),
        ({"damping": DASHPOT}, lambda h: h**0.95, Outcome.PASS, "fall as dt^0.950"),
        ({"damping": DASHPOT}, lambda h: h**0.85, Outcome.FAIL, "fall as dt^0.850"),
        # an error that does not fall to 0: forces that are wrong
        ({"damping": DASHPOT}, lambda h: 1.0 + 0.02 * h, Outcome.FAIL, "fall as dt^0.06"),
        # a sound run with next to no damping
        ({"damping": DASHPOT}, lambda h: h**1.95, Outcome.NOT_RUN, "little is damped"),
        # touch anywhere within a step; 8 % of scatter moves the order between two neighbours by 0.2
        ({"damping": DASHPOT}, lambda h: h * (1.08 if h in (1.0, 4.0) else 1.0), Outcome.NOT_RUN, "scatter by"),
        # errors of both orders, with different signs: 0.86 over all, but on its way to 1
        ({"damping": DASHPOT}, lambda h: h - 0.035 * h**2, Outcome.NOT_RUN, "there is no asymptotic range"),
    ],
    # the name of a function without a name is another in each process
    ids=lambda change: "error" if callable(change) else str(change),
)
def test_the_order_is_two_and_of_forces_that_depend_on_velocities_one(
    changes: dict[str, Any], errors: Callable[[float], float], outcome: Outcome, words: str
) -> None:
    steps = [8.0, 4.0, 2.0, 1.0, 0.8]
    refinement = ([1e-8 * h for h in steps], [1e-6 * errors(h) for h in steps])
    verdict = checks.order(assign_roles(replace(SHORT, **changes)), TWIN, refinement, free_flight())
    assert (verdict.outcome, verdict.reference) == (outcome, f"exact {1 if changes else 2}"), verdict.sentence
    assert words in verdict.sentence


@pytest.mark.slow
@pytest.mark.lammps
@pytest.mark.parametrize(
    "changes",
    [{"damping": Damping(law="kuwabara-kono", coefficient=1e-5)}, {"drag": 5e3}],
    ids=["damped", "dragged"],
)
def test_a_damped_scene_is_verified_to_the_end_and_its_page_says_so(changes: dict[str, Any], tmp_path: Path) -> None:
    scene = replace(SHORT, name="lossy", **changes)
    verification = db.verify(scene, accuracy=ACCURACY, folder=tmp_path)
    assert verification.exit_code == 0, [v.sentence for v in verification.verdicts]
    left = {(v.quantity, v.backend) for v in verification.verdicts if v.outcome is Outcome.NOT_RUN}
    # no second reference, no theory
    assert left == {("velocity", SCIPY), ("velocity", THEORY)}
    for name in (TWIN, ENGINE):
        assert _outcome(verification.verdicts, "order", name, "exact 1") is Outcome.PASS
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    # the answer stands first, what has none behind it
    assert "the velocity error of LAMMPS is at most" in " ".join(page.split())
    assert "NOT_RUN: reference on lossy was answered by scipy" in page
    assert "dt²" not in page


def test_a_reference_with_a_wide_bar_decides_nothing(results: Runs[Result]) -> None:
    unsure = replace(_main_run(results, REFERENCE).uncertainty, velocity=1.0)
    verdicts = assess_scene(ROLES, _with(results, REFERENCE, uncertainty=unsure), ACCURACY).verdicts
    assert _outcome(verdicts, "velocity", ENGINE, REFERENCE) is Outcome.UNDECIDED


def test_a_broken_run_is_a_verdict_and_the_others_go_on(results: Runs[Result]) -> None:
    failure = RunBroken("LAMMPS: ERROR: Lost atoms")
    broken = results.map(lambda r: Result(case=r.case, failure=failure) if r.case.backend == ENGINE else r)
    verdicts = assess_scene(ROLES, broken, ACCURACY).verdicts
    assert _outcome(verdicts, "velocity", ENGINE, REFERENCE) is Outcome.BROKEN
    assert "Lost atoms" in next(v.sentence for v in verdicts if v.outcome is Outcome.BROKEN)
    assert _outcome(verdicts, "velocity", TWIN, REFERENCE) is Outcome.PASS


def test_a_model_difference_is_never_pass_or_fail(results: Runs[Result]) -> None:
    verdicts = assess_scene(ROLES, results, ACCURACY).verdicts
    assert {v.outcome for v in verdicts if v.backend == THEORY} == {Outcome.MODEL_DIFFERENCE}


def test_a_pulse_that_does_not_arrive_by_theory_is_said_to_be_one(results: Runs[Result]) -> None:
    late = _with(results, THEORY, crossing_time=np.array([1e-5, np.nan, np.nan]))
    said = {v.quantity: v.sentence for v in assess_scene(ROLES, late, ACCURACY).verdicts if v.backend == THEORY}
    assert "do not both have the arrival of body 2 within the duration" in said["arrival"]
    assert "do not both have the residence time of body 1 within the duration" in said["residence_time"]
    assert not any("inf %" in sentence for sentence in said.values())


def test_the_main_run_comes_first_and_the_ladder_spans_a_factor_eight() -> None:
    cases = [case for case in plan_scene(SHORT, ACCURACY).cases if case.backend == ENGINE]
    steps = [case.resolution.dt or 0.0 for case in cases]
    assert steps[0] == min(steps)
    assert max(steps[1:]) / min(steps[1:]) == pytest.approx(8.0)


def test_two_scenes_of_one_name_are_refused() -> None:
    with pytest.raises(UsageError, match="same name"):
        db.verify([SHORT, SHORT])


@pytest.mark.slow
@pytest.mark.lammps
def test_lammps_is_verified_on_a_short_scene_in_two_processes(tmp_path: Path) -> None:
    reports: list[tuple[float, int, str]] = []
    verification = db.verify(
        SHORT, accuracy=ACCURACY, folder=tmp_path, jobs=2, progress=lambda *news: reports.append(news)
    )
    assert verification.exit_code == 0, [v.sentence for v in verification.verdicts]
    assert reports[-1][0] == reports[-1][1] == 14
    assert {file.name for file in tmp_path.iterdir()} == {"index.html", "verdicts.json", "tables"}


@pytest.mark.lammps
def test_a_scene_that_lammps_cannot_express_is_not_run_with_the_reason() -> None:
    steep = replace(SHORT, exponent=5.5, stiffness=(4e22, 4e22, 4e22))
    verification = db.verify(steep, accuracy=1e-3)
    [refused] = [v for v in verification.verdicts if v.outcome is Outcome.NOT_RUN and v.backend == TABLE]
    assert "exponent n = 5.5; allowed exponents: 2 to 5" in refused.sentence
    assert verification.exit_code == 0


#: no pair_style granular has n = 3, and a wall of another exponent takes a second table
STEEP = replace(
    SHORT, name="steep", exponent=3.0, stiffness=(4e13, 7e13, 5e13), wall_right=Wall(stiffness=3e9, exponent=2.2)
)


@pytest.mark.parametrize(
    ("changes", "engine"),
    [
        ({}, "lammps-granular"),
        ({"exponent": (2.0, 2.5, 2.0)}, "lammps-granular"),
        ({"exponent": (2.0, 2.5, 3.0)}, "lammps-table"),
        ({"wall_left": Wall(stiffness=1e9, exponent=2.2)}, "lammps-table"),
        ({"exponent": 6.0}, "lammps-table"),
    ],
    ids=str,
)
def test_tables_are_verified_where_granular_has_not_the_laws(changes: dict[str, Any], engine: str) -> None:
    assert assign_roles(replace(SHORT, **changes)).engine == engine


@pytest.mark.slow
@pytest.mark.lammps
def test_a_table_is_verified_and_is_part_of_the_budget(tmp_path: Path) -> None:
    verification = db.verify(STEEP, accuracy=ACCURACY, folder=tmp_path)
    assert verification.exit_code == 0, [v.sentence for v in verification.verdicts]
    [study] = verification.studies
    for quantity in ("table", "table_energy"):
        assert _outcome(verification.verdicts, quantity, TABLE, "contact laws") is Outcome.PASS
    for budget in study.budgets:
        assert 0.0 < budget.parts["table"] < budget.parts["time step"]
        # the twin with the same tables in positions is the same algorithm, bit for bit
        assert budget.unexplained == 0.0
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    for words in (
        "LAMMPS interpolates forces in tables here",
        "on 1 rank: pair_style table spline, fix nve",
        "and the interpolation of the force tables (",
    ):
        assert words in page


@pytest.mark.lammps
def test_a_contact_that_pulls_in_lammps_alone_fails_with_the_reason() -> None:
    scene = replace(STEEP, name="pulling", wall_right=None, damping=Damping(law="dashpot", coefficient=40.0))
    verification = db.verify(scene, accuracy=1e-3)
    [verdict] = [
        v for v in verification.verdicts if (v.quantity, v.backend, v.reference) == ("velocity", TABLE, REFERENCE)
    ]
    assert verdict.outcome is Outcome.FAIL
    assert re.search(
        r"damped contacts are tensile, by up to [\d.]+ N: their damping is added to a table", verdict.sentence
    )
    # all the rest is sound, and says that it is the table; no order can be told of an error that no step changes
    failed = {(v.backend, v.reference) for v in verification.verdicts if v.outcome is Outcome.FAIL}
    assert failed == {(TABLE, REFERENCE)}
    velocity = verification.studies[0].budgets[0]
    assert velocity.parts["table"] > 0.5 * velocity.found > velocity.parts["time step"]
    assert not velocity.is_finding


def test_a_scene_that_the_twin_cannot_do_is_not_run_with_the_reason_and_the_others_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # the twin supports all features: here one without drag
    monkeypatch.setattr(Verlet, "supports", Support(Verlet.supports.features - {DRAG}))
    verification = verify_scenes([replace(SHORT, name="dragged", drag=1.0)], accuracy=1e-3)
    [verdict] = verification.verdicts
    assert (verdict.scene, verdict.outcome) == ("dragged", Outcome.NOT_RUN)
    assert "the scene has drag;" in verdict.sentence


@pytest.mark.parametrize(
    ("changes", "quantities"),
    [
        ({}, {"momentum", "energy"}),
        ({"precompression": 5.0}, {"momentum", "energy"}),
        ({"precompression": 5.0, "wall_left": Wall(stiffness=1e9)}, {"energy"}),
        ({"damping": Damping(law="dashpot", coefficient=1.0)}, {"momentum"}),
        ({"drag": 1.0}, set()),
        ({"drive": Drive(shape="sine", force=1.0, frequency=1e3)}, {"energy less work"}),
        ({"drive": Drive(shape="sine", force=1.0, frequency=1e3), "drag": 1.0}, set()),
    ],
    # the order of a set is another in each process
    ids=lambda change: "-".join(sorted(change)) or "none",
)
def test_only_what_a_scene_conserves_is_asked_of_its_runs(changes: dict[str, Any], quantities: set[str]) -> None:
    # the run itself does not matter here
    scene = replace(SHORT, **changes)
    verdicts = checks.conserved(assign_roles(scene), free_flight(bodies=SHORT.n_body, contacts=scene.n_contact), 1e-3)
    assert {verdict.quantity for verdict in verdicts} == quantities


def test_cases_name_what_they_run() -> None:
    case = Case(scene=SHORT, backend=TWIN, resolution=Resolution(dt=1e-8), sampling=Sampling(count=5))
    assert case.label == "short: verlet at dt = 1e-08 s"


def test_where_no_step_decides_velocities_what_is_conserved_is_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond a horizon: one UNDECIDED on velocities with the reason, and verdicts on momentum and energy."""

    def none(*_: Any) -> None:
        raise UsageError("accuracy = 1e-13 on short cannot be had")

    listed: list[Case] = []

    def run(groups: list[list[Case]], *, ended: Callable[[int, list[Result]], None], **_: Any) -> None:
        cases, moving = groups
        assert not moving
        listed.extend(cases)
        ended(0, [Result(case=cases[0], trajectory=engine_run)])

    monkeypatch.setattr("dem_bridge.verification.verify.main_resolution", none)
    monkeypatch.setattr("dem_bridge.verification.verify.run_groups", run)
    engine_run = db.solve(SHORT, backend=TWIN, uncertainty=False)
    verification = verify_scenes([SHORT], accuracy=1e-13)
    assert [(case.backend, case.uncertainty) for case in listed] == [(ENGINE, False)]
    assert [(v.quantity, v.outcome) for v in verification.verdicts] == [
        ("velocity", Outcome.UNDECIDED), ("momentum", Outcome.PASS), ("energy", Outcome.PASS),
    ]  # fmt: skip
    assert verification.exit_code == 4
    # planted: a run that loses a part in 10,000 of its energy
    engine_run = replace(
        engine_run, velocity=engine_run.velocity * np.linspace(1.0, 1.0 - 5e-5, len(engine_run.time))[:, None]
    )
    assert verify_scenes([SHORT], accuracy=1e-13).exit_code == 1


@pytest.mark.slow
@pytest.mark.lammps
def test_where_scipy_is_the_reference_another_method_stands_beside_it(monkeypatch: pytest.MonkeyPatch) -> None:
    softer = tuple(beta * 5e-6**0.1 for beta in SHORT.stiffness)
    scene = replace(SHORT, name="softer", exponent=2.4, stiffness=softer)
    verification = db.verify(scene, accuracy=ACCURACY, store=False)
    assert _outcome(verification.verdicts, "velocity", BLANES_MOAN, REFERENCE) is Outcome.PASS
    [verdict] = [v for v in verification.verdicts if v.backend == BLANES_MOAN]
    assert 0.0 < verdict.difference <= verdict.tolerance < 1e-7
    # the planted fault: a scipy that is off by a little more than both bars
    sound = scipy_dop853.ScipyDop853.run

    def wrong(self: Any, scene: Scene, *settings: Any) -> Any:
        run = sound(self, scene, *settings)
        return replace(run, velocity=run.velocity * (1.0 + 2.0 * verdict.tolerance))

    monkeypatch.setattr(scipy_dop853.ScipyDop853, "run", wrong)
    verification = db.verify(scene, accuracy=ACCURACY, store=False)
    assert _outcome(verification.verdicts, "velocity", BLANES_MOAN, REFERENCE) is Outcome.FAIL
    assert verification.exit_code == 1


#: what is imported until the runs of a scene are planned, and why a backend does not run is asked
IMPORTED = """
import sys
import dem_bridge as db
from dem_bridge.backends.base import backend, unsupported_reason
from dem_bridge.verification import verify

def planned(scenes, **settings):
    reason = unsupported_reason(backend("bca"), scenes[0])
    heavy = ("dem_bridge.judging.deck", "dem_bridge.formats.readers", "dem_bridge.backends.adiabatic")
    print(reason.split("; ")[-1], [name for name in heavy if name in sys.modules])
    sys.exit(77)

verify.verify_scenes = planned
db.verify("decelerating-40-on-base")
"""


def test_a_scene_is_verified_without_the_readers_of_files_and_backends_that_do_not_run() -> None:
    done = subprocess.run([sys.executable, "-c", IMPORTED], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout) == (77, "use backend = 'scipy' []\n"), done.stderr


def test_motion_and_budget_are_drawn_as_soon_as_they_are_there(monkeypatch: pytest.MonkeyPatch) -> None:
    events: list[str] = []
    begun: list[SceneStudy] = []

    def run(groups: list[list[Case]], *, ended: Callable[[int, list[Result]], None], **_: Any) -> None:
        cases, moving = groups
        assert [case.backend for case in moving] == ["bca", ENGINE]
        assert all(case in cases for case in moving)
        runs = {case: Result(case=case, trajectory=twin, key=case.label) for case in cases}
        ended(1, [runs[case] for case in moving])
        events.append("further runs")
        ended(0, [runs[case] for case in cases])

    def begin(study: SceneStudy) -> None:
        events.append("motion")
        begun.append(study)

    def begin_of_verdicts(study: SceneStudy) -> None:
        events.append("budget")

    twin = db.solve(SHORT, backend=TWIN, dt=1e-6)
    monkeypatch.setattr(
        "dem_bridge.verification.verify.assess_scene",
        lambda roles, results, accuracy: SceneStudy(roles=roles, runs=results, verdicts=()),
    )
    monkeypatch.setattr("dem_bridge.verification.verify.run_groups", run)
    monkeypatch.setattr("dem_bridge.verification.verify.begin_motion", begin)
    monkeypatch.setattr("dem_bridge.verification.verify.begin_budget", begin_of_verdicts)
    [study] = verify_scenes([SHORT], accuracy=1e-4, dt=1e-6).studies
    assert events == ["motion", "further runs", "budget"]
    # it is the picture that the page shows
    for figure in (motion_of, maps_of):
        early, late = (figure([each]) for each in (*begun, study))
        assert early is not None
        assert late is not None
        assert packed(svg_of_data, early) == packed(svg_of_data, late)
    drawn: list[bytes | None] = []
    monkeypatch.setattr(pictures, "drawn", lambda *what: drawn.append(packed(*what)))
    begin_motion(study)
    assert drawn == []  # no process draws
    monkeypatch.setattr(pictures, "is_drawing_beside", lambda: True)
    begin_motion(study)
    assert drawn == [packed(svg_of_data, figure([study])) for figure in (motion_of, maps_of)]
    drawn.clear()
    begin_budget(study)
    assert drawn == []  # there is none
    budget = Budget(quantity="velocity", found=1e-6, parts={}, unexplained=0.0, allowed=1e-12, scale_name="largest")
    begin_budget(replace(study, budgets=(budget,)))
    # the question is that of the page, which has another object with the same content
    pictures.begin_of_verdicts("error_budget", [replace(study, budgets=(budget,))])
    assert len(drawn) == 2
    assert drawn[0] == drawn[1] is not None
