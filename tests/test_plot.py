"""Pictures for notebooks: the run's own numbers on Axes that a person can change, and no display needed."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure

import dem_bridge as db
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.observables.front import arrival, residence_time, residence_time_uncertainty
from dem_bridge.report.drawing_styles import style_of
from dem_bridge.scene.scene import Scene
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.budget import Budget
from dem_bridge.verification.roles import assign_roles
from dem_bridge.verification.verification import Verification, verification_of
from dem_bridge.verification.verify import study_without_runs
from tests.conftest import Solve
from tests.helpers.legibility import assert_legible

SCENE = db.Scene(
    name="six",
    duration=2e-4,
    mass=(8.1e-3,) + (10.1e-3,) * 5,
    stiffness=(4e9, 7e10, 5e10, 3e10, 1e10),
    velocity=(0.8,) + (0.0,) * 5,
    samples=100,
)


@pytest.fixture(autouse=True)
def closed() -> Iterator[None]:
    yield
    pyplot.close("all")


@pytest.fixture(name="runs", scope="module")
def _runs(solved: Solve) -> dict[str, Any]:
    return {name: solved(SCENE, name, **more) for name, more in (("reference", {}), ("verlet", {"dt": 1e-6}))}


def test_spacetime_has_all_velocities_until_the_front_has_passed(runs: dict[str, Any]) -> None:
    run = runs["verlet"]
    ax = db.plot.spacetime(run)
    shown = ax.collections[0].get_array()
    assert shown is not None
    rows = shown.shape[0]
    np.testing.assert_array_equal(shown, run.velocity[:rows])
    assert run.time[rows - 1] <= 1.15 * run.crossing_time[-1] < run.time[rows]
    assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_title(loc="left")) == ("body", "time (ms)", "six (verlet)")
    [bar] = [one for one in ax.figure.axes if one is not ax]
    assert bar.get_ylabel() == "velocity (m/s)"
    whole = db.plot.spacetime(run, until=SCENE.duration).collections[0].get_array()
    assert whole is not None
    assert whole.shape == run.velocity.shape


def test_a_theory_is_drawn_where_it_says_that_the_front_is(runs: dict[str, Any], solved: Solve) -> None:
    [line] = db.plot.spacetime(runs["verlet"], theory="bca", scene=SCENE).get_lines()
    front = 1e3 * arrival(SCENE, solved(SCENE, "bca"))[1:]
    np.testing.assert_array_equal(np.asarray(line.get_xydata()).T, [[1, 2, 3, 4, 5], front])


def test_velocities_of_several_runs_are_the_same_bodies_by_colour_and_runs_by_form(runs: dict[str, Any]) -> None:
    ax = db.plot.velocity(list(runs.values()), bodies=[1, 4])
    lines = ax.get_lines()
    assert [line.get_label() for line in lines] == [
        "body 1, reference",
        "body 4, reference",
        "body 1, verlet",
        "body 4, verlet",
    ]
    for line, (run, body) in zip(lines, [(run, body) for run in runs.values() for body in (1, 4)], strict=True):
        np.testing.assert_array_equal(np.asarray(line.get_xydata()).T, [1e3 * run.time, run.velocity[:, body]])
    colours = [line.get_color() for line in lines]
    assert colours[:2] == colours[2:]
    assert colours[0] != colours[1]
    assert lines[0].get_linewidth() > 3.0 * lines[2].get_linewidth()
    ends = np.concatenate([line.get_xdata() for line in db.plot.velocity(runs["verlet"], until=1e-4).get_lines()])
    assert ends.max() == pytest.approx(0.1)
    assert len(db.plot.velocity(runs["verlet"]).get_lines()) == 5


def test_residence_times_are_those_of_the_observables_with_their_bars(runs: dict[str, Any]) -> None:
    ax = db.plot.residence(runs, theory="bca", scene=SCENE)
    drawn = {line.get_label(): line for line in ax.get_lines()}
    assert list(drawn) == ["reference", "verlet", "BCA"]
    for name, run in runs.items():
        np.testing.assert_array_equal(drawn[name].get_ydata(), 1e6 * residence_time(SCENE, run)[1:-1])
    bars: Any = ax.collections[1]  # of the second run
    segments = bars.get_segments()
    lengths = [segment[1, 1] - segment[0, 1] for segment in segments]
    # from the ends of bars, whose last digit is that of a residence time
    np.testing.assert_allclose(lengths, 2e6 * residence_time_uncertainty(SCENE, runs["verlet"])[1:-1], rtol=1e-9)
    assert ax.get_ylabel() == "residence time (µs)"


def test_runs_of_one_code_are_told_apart_by_step_or_number(solved: Solve) -> None:
    coarse, fine = (solved(SCENE, "verlet", dt=dt) for dt in (2e-6, 1e-6))
    labels = [line.get_label() for line in db.plot.residence([coarse, fine]).get_lines()]
    assert labels == ["verlet, dt = 2e-06 s", "verlet, dt = 1e-06 s"]
    labels = [line.get_label() for line in db.plot.residence([fine, fine]).get_lines()]
    assert labels == ["verlet, dt = 1e-06 s (1)", "verlet, dt = 1e-06 s (2)"]


def _verified(*scenes: Scene) -> Verification:
    parts = {"time step": 1e-6, "table": 0.0, "round-off": 2e-10, "sampling": float("inf"), "reference": 1e-12}
    one = Budget(
        quantity="velocity",
        found=1.1e-6,
        parts=parts,
        unexplained=3e-13,
        allowed=1e-12,
        scale_name="largest |velocity|",
    )
    studies = tuple(SceneStudy(roles=assign_roles(scene), verdicts=(), budgets=(one,)) for scene in scenes)
    return verification_of(studies, accuracy=1e-6, wall=1.0)


def test_a_budget_has_a_bar_for_each_part_and_its_numbers_beside() -> None:
    ax = db.plot.budget(_verified(SCENE))
    names = [tick.get_text() for tick in ax.get_yticklabels()]
    assert names == ["total error", "time step", "table", "round-off", "sampling", "reference", "unexplained"]
    assert [text.get_text() for text in ax.texts] == [
        "1.1e-06",
        "1.0e-06",
        "0",
        "2.0e-10",
        "unknown",
        "1.0e-12",
        "3.0e-13",
    ]
    widths = [patch.get_width() for patch in ax.patches]  # type: ignore[attr-defined]
    assert widths[0] == 1.1e-6
    assert widths[-1] == 3e-13
    assert ax.get_lines()[0].get_xdata()[0] == 1e-12  # type: ignore[index]
    assert ax.yaxis_inverted()


def test_every_picture_is_drawn_on_the_axes_given_and_can_be_saved(runs: dict[str, Any]) -> None:
    figure = Figure(figsize=(12, 8), layout="constrained")
    axes = figure.subplots(2, 2).ravel()
    assert db.plot.spacetime(runs["verlet"], axes[0]) is axes[0]
    assert db.plot.velocity(runs["verlet"], ax=axes[1]) is axes[1]
    assert db.plot.residence(runs, axes[2]) is axes[2]
    assert db.plot.budget(_verified(SCENE), axes[3]) is axes[3]
    assert_legible(figure)


@pytest.mark.parametrize("theory", [None, "bca", pytest.param("adiabatic", marks=pytest.mark.slow)])
def test_nothing_hides_anything(runs: dict[str, Any], theory: str | None) -> None:
    for ax in (
        db.plot.spacetime(runs["verlet"], theory=theory, scene=SCENE),
        db.plot.velocity(runs),
        db.plot.residence(runs, theory=theory, scene=SCENE),
        db.plot.budget(_verified(SCENE)),
    ):
        figure = ax.figure
        assert isinstance(figure, Figure)
        assert_legible(figure)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda run: db.plot.velocity(run, bodies=[6]), "the chain has no body 6; allowed: 0 to 5"),
        (lambda run: db.plot.velocity([]), "t = []; allowed: a Trajectory, a sequence of them"),
        (lambda run: db.plot.spacetime([run, run]), "t has 2 runs; allowed: one run per space-time plot"),
        (lambda run: db.plot.spacetime(run, theory="bca"), "'six' is not a shipped scene; give scene"),
        (lambda run: db.plot.spacetime(run, theory="ode45"), "theory = 'ode45'; allowed: bca or adiabatic"),
        (
            lambda run: db.plot.residence(run, theory="bca", scene="decelerating-40"),
            "the run is of a scene six that differs from the scene decelerating-40",
        ),
        (lambda run: db.plot.budget(_verified(SCENE), quantity="energy"), "quantity = 'energy'; allowed: velocity, "),
        (
            lambda run: db.plot.budget(_verified(SCENE), scene="other"),
            "scene = 'other'; allowed (scenes that were verified): six",
        ),
        (
            lambda run: db.plot.budget(study_without_runs(assign_roles(SCENE), RunBroken("it fell"))),
            "six has no error budget",
        ),
    ],
)
def test_what_cannot_be_drawn_is_refused_in_a_line(runs: dict[str, Any], call: Any, said: str) -> None:
    before = pyplot.get_fignums()
    with pytest.raises(UsageError) as caught:
        call(runs["verlet"])
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert pyplot.get_fignums() == before, "an empty figure is left"


def test_two_bodies_have_no_residence_time(two_bodies: Any) -> None:
    run = db.solve(two_bodies.scene, backend="verlet", dt=1e-6, uncertainty=False)
    with pytest.raises(UsageError, match="2 bodies; allowed: at least three"):
        db.plot.residence(run)


def test_no_display_is_needed_even_where_windows_are_asked_for() -> None:
    code = (
        "import dem_bridge as db, sys;"
        "assert 'matplotlib' not in sys.modules;"
        "run = db.solve('accelerating-40', backend='bca');"
        "ax = db.plot.spacetime(run); ax.figure.savefig(sys.stdout.buffer, format='png')"
    )
    bare = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run([sys.executable, "-c", code], env={**bare, "MPLBACKEND": "TkAgg"}, capture_output=True)
    assert done.returncode == 0, done.stderr.decode()
    assert done.stdout.startswith(b"\x89PNG")


def test_a_front_that_never_comes_is_no_line_and_no_error(solved: Solve) -> None:
    apart = db.Scene(
        name="apart", duration=1e-5, mass=(1e-2,) * 4, stiffness=(1e9,) * 3, gap=1.0, velocity=(0.8, 0.0, 0.0, 0.0)
    )
    run = solved(apart, "verlet", dt=1e-6)
    [line] = db.plot.residence(run).get_lines()
    assert np.isnan(line.get_ydata()).all()
    shown = db.plot.spacetime(run).collections[0].get_array()
    assert shown is not None
    assert shown.shape == run.velocity.shape


def test_bars_do_not_reach_into_the_legend(solved: Solve) -> None:
    run = solved(SCENE, "verlet", dt=4e-6)
    ax = db.plot.residence(run)
    legend = ax.get_legend()
    assert legend is not None
    assert isinstance(ax.figure, Figure)
    ax.figure.draw_without_rendering()
    bottom = ax.transData.inverted().transform(legend.get_window_extent())[0, 1]
    assert bottom > 1e6 * (residence_time(SCENE, run)[1:-1] + residence_time_uncertainty(SCENE, run)[1:-1]).max()


def test_runs_of_one_code_have_numbered_styles_and_others_those_of_the_report(solved: Solve) -> None:
    exact = solved(SCENE, "reference")
    coarse, fine = (solved(SCENE, "verlet", dt=dt) for dt in (2e-6, 1e-6))
    one, other = db.plot.residence([coarse, fine]).get_lines()
    assert [line.get_color() for line in (one, other)] == [style_of(f"nth/{k}/{k}")["color"] for k in range(2)]
    alone, theory = db.plot.residence([exact], theory="bca", scene=SCENE).get_lines()
    for line, name in ((alone, "reference"), (theory, "bca")):
        assert (line.get_color(), line.get_marker()) == (style_of(name)["color"], style_of(name).get("marker", "None"))


def test_a_run_of_a_code_without_a_style_of_its_own_has_a_numbered_one(solved: Solve) -> None:
    run = solved(SCENE, "verlet", dt=1e-6)
    other = replace(run, provenance={**run.provenance, "backend": "a-code-of-mine"})
    for runs, place in (([other], 0), ([run, other], 1), ([other, run], 0)):
        line = db.plot.residence(runs).get_lines()[place]
        assert (line.get_label(), line.get_color()) == ("a-code-of-mine", style_of(f"nth/{place}/{place}")["color"])
