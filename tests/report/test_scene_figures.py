"""Figures of a scene: each number stands at its own body, contact, time and step."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import dem_bridge as db
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.runs.campaign import Result
from dem_bridge.runs.case import Case
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.budget import Budget
from dem_bridge.verification.chains import error_scale
from dem_bridge.verification.figures import (
    convergence,
    error_budget,
    front_along_chain,
    motion,
    spacetime_maps,
)
from dem_bridge.verification.panels import residence_panel
from dem_bridge.verification.roles import assign_roles


def _chain(name: str, *stiffness: float, **more: Any) -> Scene:
    """Return a striker on as many equal bodies as there are contacts."""
    count = len(stiffness)
    fields: dict[str, Any] = {"duration": 2e-4, "samples": 100, "spacing": 0.018} | more
    velocity = (0.8,) + (0.0,) * count
    return Scene(name=name, mass=(8.1e-3,) + (10.1e-3,) * count, stiffness=stiffness, velocity=velocity, **fields)


SIX, TEN = _chain("six", 4e9, 7e10, 5e10, 3e10, 1e10), _chain("ten", *(4e10,) * 9)
PAIR = Scene(name="pair", duration=1e-4, mass=(0.01, 0.03), stiffness=(4e9,), velocity=(0.8, 0.0), samples=40)


def _run(scene: Scene, backend: str, **settings: Any) -> Result:
    """Return a result of a code; that of LAMMPS is made by its twin."""
    code = "verlet" if backend.startswith("lammps") else backend
    run = db.solve(scene, backend=code, uncertainty=code != "bca" and not settings.get("dt"), **settings)
    case = Case(scene=scene, backend=backend, resolution=Resolution(**settings), sampling=Sampling(count=scene.samples))
    return Result(case=case, trajectory=replace(run, provenance={**run.provenance, "backend": backend}))


def _study(scene: Scene, *backends: str, **more: Any) -> SceneStudy:
    settings: dict[str, Any] = {"lammps-granular": {"dt": 1e-7}, "verlet": {"dt": 1e-7}}
    runs = tuple(_run(scene, name, **settings.get(name, {})) for name in backends)
    return SceneStudy(roles=assign_roles(scene), others=runs, verdicts=(), **more)


@pytest.fixture(scope="module", name="six")
def _six() -> SceneStudy:
    return _study(SIX, "reference", "lammps-granular", "bca")


def _panels(figure: Figure | None) -> list[Axes]:
    """Return the axes with a title, which are those of panels."""
    assert figure is not None
    return [ax for ax in figure.axes if ax.get_title(loc="left") or ax.get_title()]


def _points(ax: Axes) -> dict[str, np.ndarray]:
    return {str(line.get_label()): np.asarray(line.get_xydata()) for line in ax.get_lines()}


def test_residence_times_stand_at_the_body_that_the_impulse_passes(six: SceneStudy) -> None:
    run = six.run("reference")
    assert run is not None
    [series] = residence_panel({"reference": run}, "six").series
    # contact k is between bodies k and k + 1: body k holds the impulse between the times of contacts k - 1 and k
    expected = {k: 1e6 * (run.crossing_time[k] - run.crossing_time[k - 1]) for k in range(1, 5)}
    assert dict(zip(series.x.tolist(), series.y.tolist(), strict=True)) == pytest.approx(expected, rel=1e-12)
    assert series.bar is not None
    assert np.all((series.bar > 0.0) & (series.bar < 1e-3 * series.y))


def test_the_front_along_a_chain_has_the_time_and_the_speed_of_each_body(six: SceneStudy) -> None:
    run = six.run("reference")
    assert run is not None
    residence, speed = (_points(ax) for ax in _panels(front_along_chain([six])))
    assert set(residence) == set(speed) == {"reference", "LAMMPS", "BCA"}
    time = np.diff(run.crossing_time)
    np.testing.assert_allclose(residence["reference"], np.stack([np.arange(1.0, 5.0), 1e6 * time], axis=1), rtol=1e-12)
    np.testing.assert_allclose(speed["reference"], np.stack([np.arange(1.0, 5.0), 0.018 / time], axis=1), rtol=1e-12)
    # of two chains each quantity has one axis
    both = _panels(front_along_chain([six, _study(TEN, "reference")]))
    assert [ax.get_ylabel() for ax in both] == ["residence time (µs)"] * 2 + ["wave speed (m/s)"] * 2
    assert [ax.get_title(loc="left") for ax in both] == ["six", "ten"] * 2
    assert both[0].get_ylim() == both[1].get_ylim() != both[2].get_ylim() == both[3].get_ylim()


def test_chains_without_a_front_or_a_spacing_are_left_out(six: SceneStudy) -> None:
    four, three = _chain("four", 4e9, 7e10, 5e10), _chain("three", 4e9, 7e10)
    assert front_along_chain([_study(three, "reference")]) is None
    assert len(_panels(front_along_chain([_study(four, "reference")]))) == 2
    assert front_along_chain([_study(SIX, "bca")]) is None
    # a speed of the front needs a spacing of every chain
    bare = _study(replace(SIX, spacing=None), "reference")
    assert [ax.get_ylabel() for ax in _panels(front_along_chain([six, bare]))] == ["residence time (µs)"] * 2


def test_maps_show_each_velocity_at_its_body_and_time(six: SceneStudy) -> None:
    run = six.run("lammps-granular")
    assert run is not None
    [ax] = _panels(spacetime_maps([six]))
    assert ax.get_title(loc="left") == "six (LAMMPS)"
    mesh: Any = ax.collections[0]
    shown, corners = np.asarray(mesh.get_array()), mesh.get_coordinates()
    centres = 0.25 * (corners[1:, 1:] + corners[:-1, 1:] + corners[1:, :-1] + corners[:-1, :-1])
    # the striker is left out; the map ends shortly after the front has reached the last body
    last = 1.15 * run.crossing_time[-1]
    np.testing.assert_array_equal(shown, run.velocity[run.time <= last, 1:])
    np.testing.assert_allclose(centres[0, :, 0], np.arange(1.0, 6.0), rtol=1e-12)
    np.testing.assert_allclose(centres[:, 0, 1], 1e3 * run.time[run.time <= last], rtol=1e-9, atol=1e-12)
    theory = six.run("bca")
    assert theory is not None
    # the front is at body k + 1 when contact k is compressed most
    front = np.stack([np.arange(1.0, 6.0), 1e3 * theory.crossing_time], axis=1)
    np.testing.assert_allclose(_points(ax)["front by BCA"], front, rtol=1e-12)
    assert spacetime_maps([_study(PAIR, "reference")]) is None
    [alone] = _panels(spacetime_maps([_study(SIX, "reference")]))
    assert alone.get_title(loc="left") == "six (reference)"


def test_maps_of_chains_of_similar_duration_share_their_axes(six: SceneStudy) -> None:
    ten = _study(TEN, "reference")
    first, second = _panels(spacetime_maps([six, ten]))
    assert first.get_ylim()[1] == pytest.approx(second.get_ylim()[1], rel=0.02)
    assert first.collections[0].get_clim() == second.collections[0].get_clim()
    # one that takes more than twice as long has a time of its own
    slow = _study(_chain("slow", *(0.01 * k for k in SIX.stiffness), duration=1e-3), "reference")
    first, second = _panels(spacetime_maps([six, slow]))
    assert second.get_ylim()[1] > 2.0 * first.get_ylim()[1]


def test_convergence_has_the_errors_of_each_step_and_a_line_of_the_order() -> None:
    steps, errors = (4e-7, 2e-7, 1e-7), (1.6e-3, 4e-4, 1e-4)
    refinement: Any = {"lammps-granular": (steps, errors), "verlet": (steps, tuple(2.0 * e for e in errors))}
    verdict = Verdict(
        scene="six", quantity="velocity", backend="lammps-granular", reference="verlet", outcome=Outcome.PASS,
        sentence="", difference=3e-9,
    )  # fmt: skip
    runs = _study(SIX, "lammps-granular").others
    study = SceneStudy(roles=assign_roles(SIX), others=runs, verdicts=(verdict,), refinement=refinement)
    [ax] = _panels(convergence([study]))
    points = _points(ax)
    np.testing.assert_allclose(points["LAMMPS - reference"], np.stack([steps, errors], axis=1))
    np.testing.assert_allclose(points["twin - reference"], np.stack([steps, 2.0 * np.array(errors)], axis=1))
    assert points["LAMMPS - twin"].tolist() == [[1e-7, 3e-9]]
    # the order of velocity-Verlet through the first point
    np.testing.assert_allclose(points["slope 2"], [[4e-7, 1.6e-3], [1e-7, 1e-4]], rtol=1e-12)
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    exact: Any = {"verlet": (steps, (0.0, 0.0, 0.0))}
    assert convergence([replace(study, refinement=exact)]) is None
    assert convergence([replace(study, refinement={})]) is None


def _budget(quantity: str, found: float, **parts: float) -> Budget:
    shared = {"time step": 1e-6, "table": 0.0, "round-off": 2e-10, "sampling": math.inf, "reference": 1e-12}
    return Budget(
        quantity=quantity, found=found, parts=shared | parts, unexplained=3e-13, allowed=1e-12, scale_name="largest"
    )


def test_a_budget_has_a_bar_of_each_part_on_one_axis() -> None:
    budgets = (_budget("velocity", 1.1e-6), _budget("peak_force", 4e-5, table=3e-5), _budget("crossing_time", 2e-6))
    figure = error_budget([SceneStudy(roles=assign_roles(SIX), verdicts=(), budgets=budgets)])
    panels = _panels(figure)
    assert [ax.get_title() for ax in panels] == ["velocity", "peak force", "crossing time"]
    low, high = 0.3 * 3e-13, 300.0 * 4e-5
    for ax, budget in zip(panels, budgets, strict=True):
        assert ax.get_xlim() == pytest.approx((low, high), rel=1e-12, abs=0.0)
        bars: list[Any] = list(ax.patches)
        ends = [bar.get_x() + bar.get_width() for bar in bars]
        values = [budget.found, *budget.parts.values(), budget.unexplained]
        # no part and an unknown one are at the ends of the axis, and said in words
        assert ends == pytest.approx([min(max(value, low), high) for value in values], rel=1e-9, abs=0.0)
        words = ["0" if value == 0.0 else f"{value:.1e}" if math.isfinite(value) else "unknown" for value in values]
        assert [text.get_text() for text in ax.texts] == words
        assert [text.xy[1] for text in ax.texts] == list(range(len(values)))  # type: ignore[attr-defined]
        assert np.asarray(ax.get_lines()[0].get_xdata()).tolist() == [1e-12] * 2
        assert ax.yaxis_inverted()
    names = [tick.get_text() for tick in panels[0].get_yticklabels()]
    assert names == ["total error", *budgets[0].parts, "unexplained"]
    nothing = Budget(quantity="velocity", found=0.0, parts={}, unexplained=0.0, allowed=0.0, scale_name="largest")
    assert error_budget([SceneStudy(roles=assign_roles(SIX), verdicts=(), budgets=(nothing,))]) is None


def test_few_bodies_are_lines_with_their_closed_form() -> None:
    study = _study(PAIR, "reference")
    run = study.run("reference")
    assert run is not None
    velocity, force = (_points(ax) for ax in _panels(motion([study])))
    for k in range(2):
        np.testing.assert_array_equal(velocity[f"body {k}"], np.stack([1e3 * run.time, run.velocity[:, k]], axis=1))
    np.testing.assert_array_equal(force["contact 0"], np.stack([1e3 * run.time, run.contact_force[:, 0]], axis=1))
    # an elastic collision: (m1 - m2) / (m1 + m2) and 2 m1 / (m1 + m2) of the speed; forces 5/4 mu v^2 over the overlap
    levels = [
        np.asarray(line.get_ydata())
        for line in _panels(motion([study]))[0].get_lines()
        if line.get_label() == "closed form"
    ]
    np.testing.assert_allclose(levels, [[-0.4, -0.4], [0.4, 0.4]], rtol=1e-9)
    overlap = (1.25 * 0.0075 * 0.64 / 4e9) ** 0.4
    np.testing.assert_allclose(force["closed form"], [[0.0, 4e9 * overlap**1.5], [0.1, 4e9 * overlap**1.5]], rtol=1e-9)
    damped = _study(replace(PAIR, wall_left=Wall(stiffness=4e9), wall_right=Wall(stiffness=4e9)), "reference")
    names = list(_points(_panels(motion([damped]))[1]))
    assert names == ["contact 0", "wall left", "wall right"]


def test_many_bodies_are_maps(six: SceneStudy) -> None:
    ten = _study(TEN, "reference")
    run = ten.run("reference")
    assert run is not None
    velocity, force = _panels(motion([ten]))
    for ax, values in ((velocity, run.velocity[:, 1:]), (force, run.contact_force)):
        shown = np.asarray(ax.collections[0].get_array())
        np.testing.assert_array_equal(shown, values[: len(shown)])
        assert run.time[len(shown) - 1] <= 1.15 * run.crossing_time[-1] < run.time[len(shown)]
    assert motion([SceneStudy(roles=assign_roles(SIX), verdicts=())]) is None
    # of a chain in which nothing meets the whole run is shown
    still = _study(replace(TEN, name="still", velocity=(0.0,) * 10), "reference")
    assert [len(np.asarray(ax.collections[0].get_array())) for ax in _panels(motion([still]))] == [101, 101]


def test_errors_stand_on_one_scale_in_their_own_rows() -> None:
    verdicts = tuple(
        Verdict(
            scene="six", quantity="velocity", backend=backend, reference="reference", outcome=Outcome.PASS, sentence="",
            difference=difference, tolerance=tolerance,
        )
        for backend, difference, tolerance in (("lammps-granular", 1e-6, 1e-5), ("scipy", 5e-11, 1e-7))
    )  # fmt: skip
    study = SceneStudy(roles=assign_roles(SIX), verdicts=verdicts, budgets=(_budget("velocity", 1.1e-6),))
    panel = error_scale([study])
    assert panel is not None
    errors, tolerance = panel.series
    shown = dict(zip(panel.rows, errors.x.tolist(), strict=True))
    # what is nothing, or unknown, has no row; the tolerance is that of the least strict check
    assert shown == {
        "reference (estimate)": 1e-12, "reference, second method": 5e-11, "LAMMPS, round-off": 2e-10,
        "LAMMPS, time step": 1e-6,
    }  # fmt: skip
    assert panel.row_kinds == ("round-off", "round-off", "round-off", "time step")
    assert errors.y.tolist() == [0.0, 1.0, 2.0, 3.0]
    assert (tolerance.x.tolist(), tolerance.y.tolist()) == ([1e-5, 1e-5], [-0.5, 3.5])
    assert error_scale([SceneStudy(roles=assign_roles(SIX), verdicts=())]) is None


def test_velocities_are_those_of_the_bodies_that_are_named() -> None:
    run: Trajectory = db.solve(SIX, backend="verlet", dt=1e-6, uncertainty=False)
    for body in (0, 3, 5):
        [line] = db.plot.velocity(run, bodies=body, until=1e-4).get_lines()
        early = run.time <= 1e-4
        np.testing.assert_array_equal(
            line.get_xydata(), np.stack([1e3 * run.time, run.velocity[:, body]], axis=1)[early]
        )


def test_a_budget_alone_has_an_axis_from_below_its_least_part_to_above_its_largest() -> None:
    study = SceneStudy(roles=assign_roles(SIX), verdicts=(), budgets=(_budget("velocity", 1.1e-6),))
    ax = db.plot.budget(study)
    # a third of the unexplained part, and 300 times the total
    assert ax.get_xlim() == pytest.approx((0.3 * 3e-13, 300.0 * 1.1e-6), rel=1e-12, abs=0.0)
    nothing = Budget(quantity="velocity", found=0.0, parts={}, unexplained=0.0, allowed=1e-12, scale_name="largest")
    ax = db.plot.budget(SceneStudy(roles=assign_roles(SIX), verdicts=(), budgets=(nothing,)))
    assert ax.get_xlim() == pytest.approx((3e-17, 3e-14), rel=1e-12, abs=0.0)
