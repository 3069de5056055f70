"""Panels of scenes: which runs, bodies, times and tolerances they show, by numbers that are written here."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.drawing import WIDTH
from dem_bridge.report.drawing_styles import style_of
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.budget import Budget
from dem_bridge.verification.chains import body_noun, error_scale
from dem_bridge.verification.figures import (
    budget_on,
    convergence,
    error_budget,
    front_along_chain,
    motion,
    spacetime_maps,
)
from dem_bridge.verification.roles import assign_roles
from tests.report.test_scene_figures import SIX, TEN, _budget, _chain, _panels, _points, _study


@pytest.fixture(autouse=True)
def _closed() -> Iterator[None]:
    yield
    pyplot.close("all")


def _mesh(ax: Axes) -> np.ndarray:
    return np.asarray(ax.collections[0].get_array())


def _with_crossings(study: SceneStudy, last: float) -> SceneStudy:
    """Return a study whose reference has the front at the last body at a time, s."""
    [result] = study.others
    run = result.trajectory
    assert run is not None
    crossing = run.crossing_time * (last / run.crossing_time[-1])
    return replace(study, others=(replace(result, trajectory=replace(run, crossing_time=crossing)),))


@pytest.fixture(scope="module", name="long")
def _long() -> SceneStudy:
    return _study(_chain("long", *(4e10,) * 4, duration=4e-4), "reference")


@pytest.mark.parametrize(("second", "together"), [(1.9e-4, True), (2.1e-4, False)])
def test_maps_share_their_time_unless_one_takes_twice_as_long(long: SceneStudy, second: float, together: bool) -> None:
    studies = [_with_crossings(long, last / 1.15) for last in (1e-4, second)]
    first, other = (_mesh(ax) for ax in _panels(spacetime_maps(studies)))
    time = long.others[0].trajectory.time  # type: ignore[union-attr]
    assert len(other) == np.sum(time <= second * (1.0 + 1e-9))
    assert len(first) == (len(other) if together else np.sum(time <= 1e-4 * (1.0 + 1e-9)))
    # no map ends later than its run
    beyond = _with_crossings(long, 3.9e-4)
    assert len(_mesh(_panels(spacetime_maps([beyond]))[0])) == len(time)


def test_three_bodies_have_a_map_and_two_have_none() -> None:
    three = _study(_chain("three", 4e9, 7e10), "reference")
    [ax] = _panels(spacetime_maps([three]))
    assert _mesh(ax).shape[1] == 2
    assert ax.get_xlabel() == "body"


def test_bodies_are_named_by_the_shape_of_all_but_the_first() -> None:
    def noun(*shapes: str) -> str:
        bodies = [SimpleNamespace(shape=shape) for shape in shapes]
        return body_noun(SimpleNamespace(geometry=SimpleNamespace(bodies=bodies)))  # type: ignore[arg-type]

    assert noun("sphere", "cylinder", "cylinder") == "cylinder"
    assert noun("cylinder", "sphere", "sphere") == "sphere"
    assert noun("sphere", "sphere", "cylinder") == noun("sphere") == body_noun(SIX) == "body"


def test_the_first_body_of_a_driven_chain_is_shown_and_a_striker_is_not() -> None:
    driven = replace(TEN, velocity=(0.0,) * 10, drive=Drive(shape="sine", force=50.0, frequency=2e4))
    study, struck = _study(driven, "lammps-granular"), _study(TEN, "lammps-granular")
    for ax, first in (
        (_panels(spacetime_maps([study]))[0], 0.0),
        (_panels(motion([study]))[0], 0.0),
        (_panels(spacetime_maps([struck]))[0], 1.0),
        (_panels(motion([struck]))[0], 1.0),
    ):
        assert ax.get_xlim() == pytest.approx((first - 0.5, 9.5))
        assert _mesh(ax).shape[1] == 10 - first
    # a driven chain has no single front
    assert front_along_chain([_study(driven, "reference")]) is None


def test_convergence_of_several_scenes_has_a_legend_for_each_order() -> None:
    steps, errors = (4e-7, 1e-7), (1.6e-3, 1e-4)
    refinement: Any = {"lammps-granular": (steps, errors)}
    verdicts = tuple(
        Verdict(
            scene="six", quantity="velocity", backend=backend, reference=reference, outcome=Outcome.PASS, sentence="",
            difference=difference,
        )
        for backend, reference, difference in (("lammps-granular", "reference", 7.0), ("scipy", "verlet", 8.0))
    )  # fmt: skip
    runs = _study(SIX, "lammps-granular").others
    first = SceneStudy(roles=assign_roles(SIX), others=runs, verdicts=verdicts, refinement=refinement)
    figure = convergence([first, replace(first, others=(), verdicts=())])
    assert figure is not None
    assert tuple(figure.get_size_inches()) == pytest.approx((WIDTH, 2.8))
    left, right = figure.axes
    # no difference of LAMMPS from its twin is known
    assert set(_points(left)) == set(_points(right)) == {"LAMMPS - reference", "slope 2"}
    assert [ax.get_legend() is None for ax in figure.axes] == [True, False]
    assert left.get_ylabel() == "velocity difference / largest velocity"
    assert (right.get_ylabel(), right.get_xlabel()) == ("", "time step (s)")
    assert left.xaxis.get_major_formatter()(1e-7, 0) == "10⁻⁷"
    assert left.xaxis.get_minor_formatter()(3e-7, 0) == ""
    # of a difference without a run the step is unknown
    twins = tuple(replace(verdict, backend="lammps-granular", reference="verlet") for verdict in verdicts[:1])
    assert "LAMMPS - twin" not in _points(convergence([replace(first, others=(), verdicts=twins)]).axes[0])  # type: ignore[union-attr]
    # a scene with another order has a slope and a legend of its own
    soft = replace(SIX, name="soft", exponent=1.2)
    other = replace(first, roles=assign_roles(soft))
    both = convergence([first, first, other])
    assert both is not None
    slopes = [next(name for name in _points(ax) if name.startswith("slope")) for ax in both.axes]
    if len(set(slopes)) > 1:
        assert [ax.get_legend() is None for ax in both.axes] == [False] * 3
    alike = convergence([first, first, first])
    assert alike is not None
    assert [ax.get_legend() is None for ax in alike.axes] == [True, True, False]


@pytest.mark.parametrize(("count", "columns", "rows"), [(1, 1, 1), (2, 2, 1), (3, 2, 2), (4, 2, 2)])
def test_budgets_stand_in_two_columns(count: int, columns: int, rows: int) -> None:
    names = ("velocity", "peak_force", "crossing_time", "displacement")[:count]
    study = SceneStudy(roles=assign_roles(SIX), verdicts=(), budgets=tuple(_budget(name, 1e-6) for name in names))
    figure = error_budget([study])
    assert figure is not None
    assert tuple(figure.get_size_inches()) == pytest.approx((columns * 0.5 * WIDTH, rows * 2.0))
    assert len(figure.axes) == count
    assert figure.get_supxlabel() == "six: difference / scale of the quantity"
    # each row has one axis of names, which is turned once
    assert all(ax.yaxis_inverted() for ax in figure.axes)
    for ax in figure.axes:
        place = ax.get_subplotspec()
        assert place is not None
        shown = any(label.get_visible() and label.get_text() for label in ax.get_yticklabels())
        assert shown is (place.colspan.start == 0)


def test_numbers_stand_at_the_ends_of_their_bars() -> None:
    budget = Budget(
        quantity="velocity", found=1e-3, parts={"time step": 1e-25, "table": math.inf, "round-off": 0.0},
        unexplained=1e-9, allowed=1e-8, scale_name="largest",
    )  # fmt: skip
    ax = Figure().add_subplot()
    budget_on(ax, budget)
    low, high = 0.3e-18, 0.3  # no axis begins below 0.3e-18
    assert ax.get_xlim() == pytest.approx((low, high), rel=1e-12, abs=0.0)
    ends = [1e-3, low, high, low, 1e-9]
    assert [text.xy[0] for text in ax.texts] == pytest.approx(ends, rel=1e-12, abs=0.0)  # type: ignore[attr-defined]
    assert [bar.get_width() for bar in ax.patches] == pytest.approx(ends, rel=1e-12, abs=0.0)  # type: ignore[attr-defined]
    assert [text.get_text() for text in ax.texts] == ["1.0e-03", "1.0e-25", "unknown", "0", "1.0e-09"]
    assert {text.get_fontsize() for text in ax.texts} == {8.0}
    assert ax.xaxis.get_major_locator().numticks == 5  # type: ignore[attr-defined]
    assert ax.xaxis.get_major_formatter()(1e-9, 0) == "10⁻⁹"
    assert ax.get_xscale() == "log"
    figure = error_budget([SceneStudy(roles=assign_roles(SIX), verdicts=(), budgets=(budget,))])
    assert figure is not None
    assert figure.axes[0].get_xlim() == pytest.approx((low, high), rel=1e-12, abs=0.0)


# the figure with which the report of a scene opens


@pytest.mark.parametrize(
    ("contacts", "velocity_map", "force_map"), [(6, False, False), (7, True, False), (8, True, True)]
)
def test_up_to_seven_bodies_or_contacts_are_lines(contacts: int, velocity_map: bool, force_map: bool) -> None:
    study = _study(_chain("row", *(4e10,) * contacts), "reference")
    figure = motion([study])
    velocity, force = _panels(figure)
    assert (bool(velocity.collections), bool(force.collections)) == (velocity_map, force_map)
    # side by side
    places = [ax.get_subplotspec() for ax in (velocity, force)]
    assert [(place.rowspan.start, place.colspan.start) for place in places if place] == [(0, 0), (0, 1)]
    run = study.run("reference")
    assert run is not None
    if force_map:
        mesh: Any = force.collections[0]
        corners = mesh.get_coordinates()
        centres = 0.5 * (corners[:-1, 0, 1] + corners[1:, 0, 1])
        np.testing.assert_allclose(centres, 1e3 * run.time[: len(centres)], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(0.5 * (corners[0, 1:, 0] + corners[0, :-1, 0]), np.arange(8.0), atol=1e-12)
        assert force.get_ylabel() == "time (ms)"
    else:
        lines = force.get_lines()
        assert [line.get_label() for line in lines] == [f"contact {k}" for k in range(contacts)]
        # neighbours differ in the form of their lines, and again from the fifth on
        forms = [style_of(f"line/{k}/{form}") for k, form in enumerate((0, 3, 4, 5, 0, 3, 4)[:contacts])]
        assert [line.get_color() for line in lines] == [form["color"] for form in forms]
        assert [line.get_linewidth() for line in lines] == [form["linewidth"] for form in forms]
        styles = [("-", "--", ":", "-.", "-", "--", ":")[k] for k in range(contacts)]
        assert [line.get_linestyle() for line in lines] == styles


def test_velocities_and_forces_stand_side_by_side() -> None:
    figure = motion([_study(SIX, "reference")])
    assert figure is not None
    assert [ax.get_title(loc="left") for ax in figure.axes] == ["Velocity of the bodies", "Force of the contacts"]
    places = [ax.get_subplotspec() for ax in figure.axes]
    assert [(place.rowspan.start, place.colspan.start) for place in places if place] == [(0, 0), (0, 1)]


def _verdict(difference: float, tolerance: Any = None, **more: Any) -> Verdict:
    fields: dict[str, Any] = {
        "scene": "six", "quantity": "velocity", "backend": "scipy", "reference": "reference", "outcome": Outcome.PASS,
        "sentence": "", "difference": difference, "tolerance": tolerance,
    } | more  # fmt: skip
    return Verdict(**fields)


@pytest.mark.parametrize("found", [0.0, math.inf, 2e-6])
@pytest.mark.parametrize("value", [0.0, math.inf, 3e-7])
def test_only_errors_that_are_known_and_not_zero_have_rows(found: float, value: float) -> None:
    budget = replace(
        _budget("velocity", found), parts=dict.fromkeys(("reference", "round-off", "table", "time step"), value)
    )
    panel = error_scale([SceneStudy(roles=assign_roles(SIX), verdicts=(_verdict(value),), budgets=(budget,))])
    expected = ["reference (estimate)", "reference, second method", "LAMMPS, round-off", "LAMMPS, force tables"]
    expected = [*expected, "LAMMPS, time step"] if value == 3e-7 else []
    assert (panel is None) is (not expected)
    if panel is not None:
        assert list(panel.rows) == expected
        assert panel.series[0].x.tolist() == [value] * len(expected)
        assert (panel.x_label, panel.y_label, len(panel.series)) == ("relative error", "", 1)


def test_an_error_that_no_part_explains_has_a_row() -> None:
    budget = replace(_budget("velocity", 1e-6), unexplained=1e-7)
    panel = error_scale([SceneStudy(roles=assign_roles(SIX), verdicts=(), budgets=(budget,))])
    assert panel is not None
    assert dict(zip(panel.rows, panel.series[0].x.tolist(), strict=True))["LAMMPS, unexplained"] == 1e-7
    known = replace(_verdict(1e-6), backend=assign_roles(SIX).engine, known_defect="tsuji-prefactor")
    panel = error_scale([SceneStudy(roles=assign_roles(SIX), verdicts=(known,), budgets=(budget,))])
    assert panel is not None
    assert {"LAMMPS, known defect", "LAMMPS, unexplained"} & set(panel.rows) == {"LAMMPS, known defect"}


def test_the_tolerance_is_the_largest_of_those_that_are_numbers() -> None:
    verdicts = (
        _verdict(1e-9, None), _verdict(2e-9, math.inf), _verdict(2e-9, 0.0), _verdict(2e-9, 1e-7), _verdict(2e-9, 3e-8),
        _verdict(2e-9, 1.0, quantity="displacement"), _verdict(2e-9, 1.0, reference="verlet"),
    )  # fmt: skip
    panel = error_scale([SceneStudy(roles=assign_roles(SIX), verdicts=verdicts)])
    assert panel is not None
    assert panel.series[1].x.tolist() == [1e-7, 1e-7]
    # without one, or where no run was compared
    for verdict in (_verdict(1e-9, math.nan), _verdict(1e-9, 0.0), _verdict(1e-9, None)):
        lone = error_scale([SceneStudy(roles=assign_roles(SIX), verdicts=(verdict,))])
        assert lone is not None
        assert len(lone.series) == 1
    assert (
        error_scale([SceneStudy(roles=assign_roles(SIX), verdicts=(_verdict(1e-9, 1.0, outcome=Outcome.NOT_RUN),))])
        is None
    )


# figures of notebooks


def _verlet(scene: Scene, **settings: Any) -> Trajectory:
    return db.solve(scene, backend="verlet", uncertainty=False, **{"dt": 1e-6} | settings)


def _labels(ax: Axes) -> list[str]:
    return [str(line.get_label()) for line in ax.get_lines()]


def test_bodies_of_a_run_are_spread_over_its_chain() -> None:
    six, ten = _verlet(SIX), _verlet(TEN)
    assert _labels(db.plot.velocity(ten)) == [f"body {k}" for k in (0, 2, 4, 7, 9)]
    # of several runs three bodies, all of which each has
    both = db.plot.velocity({"a": six, "b": ten})
    assert _labels(both) == [f"body {body}, {name}" for name in "ab" for body in (0, 2, 5)]
    assert _labels(db.plot.velocity(ten, bodies=np.int64(9))) == ["body 9"]  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="no body 6; allowed: 0 to 5"):
        db.plot.velocity([six, ten], bodies=6)
    with pytest.raises(UsageError, match="no body -1; allowed: 0 to 9"):
        db.plot.velocity(ten, bodies=[0, -1])
    # lines of runs end with the longest; the first of several is wide and pale
    longer = _verlet(replace(SIX, duration=3e-4))
    lines = db.plot.velocity([six, longer], bodies=1).get_lines()
    assert [line.get_xdata()[-1] for line in lines] == pytest.approx([0.2, 0.3])  # type: ignore[index]
    forms = [style_of(f"line/0/{form}") for form in (1, 2)]
    assert [line.get_linewidth() for line in lines] == [form["linewidth"] for form in forms]
    assert db.plot.velocity(six, bodies=1).get_lines()[0].get_linewidth() == style_of("line/0/0")["linewidth"]
    # a last time that is a sample belongs to the line
    [line] = db.plot.velocity(six, bodies=1, until=float(six.time[7])).get_lines()
    assert len(np.asarray(line.get_xdata())) == 8


def test_titles_name_the_scenes_and_the_run_of_one() -> None:
    six, ten = _verlet(SIX), _verlet(TEN)
    titles = [db.plot.velocity(runs).get_title(loc="left") for runs in (six, [six, _verlet(SIX, dt=5e-7)], [six, ten])]
    assert titles == ["six (verlet)", "six", "six, ten"]
    bare = replace(six, provenance={})
    assert db.plot.velocity(bare).get_title(loc="left") == "a chain (run)"
    assert _labels(db.plot.velocity([bare, bare], bodies=0)) == ["body 0, run (1)", "body 0, run (2)"]
    with pytest.raises(UsageError, match="allowed: a Trajectory, a sequence of them"):
        db.plot.velocity([six, "six"])  # type: ignore[list-item]


def test_three_bodies_have_one_residence_time() -> None:
    three = _verlet(_chain("three", 4e9, 7e10), dt=1e-7)
    [line] = db.plot.residence(three).get_lines()
    assert np.asarray(line.get_xdata()).tolist() == [1.0]
    assert line.get_ydata()[0] == pytest.approx(1e6 * (three.crossing_time[1] - three.crossing_time[0]))  # type: ignore[index]


def test_runs_without_a_style_of_their_own_are_numbered() -> None:
    six = _verlet(SIX)
    own = {name: replace(six, provenance={**six.provenance, "backend": name}) for name in ("reference", "bca", "scipy")}
    colours = lambda *names: [line.get_color() for line in db.plot.residence([own[name] for name in names]).get_lines()]  # noqa: E731
    assert colours("reference", "bca") == [style_of(name)["color"] for name in ("reference", "bca")]
    assert colours("reference", "scipy") == [style_of(f"nth/{k}/{k}")["color"] for k in range(2)]
    assert colours("bca", "bca") == [style_of(f"nth/{k}/{k}")["color"] for k in range(2)]


def test_a_budget_that_is_missing_is_explained_by_what_did_not_run() -> None:
    verdicts = (
        _verdict(0.0, outcome=Outcome.BROKEN, sentence="It fell."),
        _verdict(0.0, outcome=Outcome.NOT_RUN, sentence="It is away."),
        _verdict(0.0, sentence="It passed."),
    )  # fmt: skip
    with pytest.raises(UsageError) as error:
        db.plot.budget(SceneStudy(roles=assign_roles(SIX), verdicts=verdicts))
    assert str(error.value).endswith("some of its runs are missing; It fell. It is away.")
    ax = db.plot.budget(
        SceneStudy(roles=assign_roles(SIX), verdicts=(), budgets=(_budget("peak_force", 1e-6),)), quantity="peak_force"
    )
    assert ax.get_title(loc="left") == "six: error of the peak force"
    assert ax.get_xlabel() == "difference / largest\ndotted: allowed unexplained error"


def test_a_front_of_two_chains_has_axes_side_by_side() -> None:
    studies = [_study(SIX, "reference"), _study(TEN, "reference")]
    figure = front_along_chain(studies)
    places = [ax.get_subplotspec() for ax in _panels(figure)]
    assert [(place.rowspan.start, place.colspan.start) for place in places if place] == [(0, 0), (0, 1), (1, 0), (1, 1)]
