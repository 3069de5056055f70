"""A single collision is compared with its closed form, and nothing else is."""

from __future__ import annotations

from dataclasses import replace

import pytest

import dem_bridge as db
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.report.drawing import draw_figure
from dem_bridge.report.study import Panel
from dem_bridge.runs.campaign import Result
from dem_bridge.runs.case import Case
from dem_bridge.scene.scene import Adhesion, Damping, Scene, Wall
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.chains import error_scale
from dem_bridge.verification.closed_form import closed_form, closed_form_table
from dem_bridge.verification.panels import motion_of
from dem_bridge.verification.reference_choice import REFERENCE
from dem_bridge.verification.roles import assign_roles
from tests.helpers.legibility import assert_legible

PAIR = Scene(name="pair", duration=1.5e-4, mass=(8.1e-3, 10.1e-3), stiffness=(3.98e9,), velocity=(0.8, 0.0), samples=50)
RIGHT = Scene(
    name="right",
    duration=1.5e-4,
    mass=(8.1e-3,),
    stiffness=(),
    velocity=(0.8,),
    wall_right=Wall(stiffness=3.98e9, gap=1e-6),
    samples=50,
)
LEFT = replace(RIGHT, name="left", velocity=(-0.8,), wall_left=RIGHT.wall_right, wall_right=None)


def _study(scene: Scene, run: Trajectory | None = None) -> SceneStudy:
    run = db.solve(scene, backend=REFERENCE) if run is None else run
    case = Case(scene=scene, backend=REFERENCE, resolution=Resolution(), sampling=Sampling(count=scene.samples))
    return SceneStudy(roles=assign_roles(scene), others=(Result(case=case, trajectory=run),), verdicts=())


def _panels(study: SceneStudy) -> tuple[Panel, ...]:
    """Return the panels of the figure of a scene, which is legible."""
    figure = motion_of([study])
    assert figure is not None
    assert_legible(draw_figure(figure))
    return figure.panels


@pytest.mark.parametrize("scene", [PAIR, RIGHT, LEFT], ids=lambda scene: scene.name)
def test_the_reference_agrees_with_the_closed_form_of_a_pair_and_of_walls(scene: Scene) -> None:
    table = closed_form_table([_study(scene)])
    assert table is not None
    assert len(table.rows) == 2 + scene.n_body
    for _, name, exact, reference, difference, *lammps in table.rows:
        # ten times the accuracy of the reference, 1e-13 of the peak, at any scale of these values
        assert abs(float(difference)) <= 1e-12 * abs(float(exact)), name
        assert float(reference) - float(exact) == difference
        assert all(value != value for value in lammps)  # LAMMPS has not run


@pytest.mark.parametrize(
    ("scene", "damping"),
    [
        (PAIR, Damping(law="coeff_restitution", coefficient=0.6)),
        (replace(PAIR, velocity=(0.5, -0.3)), Damping(law="tsuji", coefficient=0.6, clip=True)),
        (RIGHT, Damping(law="kuwabara-kono", coefficient=2e-6)),
        (replace(LEFT, wall_left=Wall(stiffness=1e7, exponent=2.0)), Damping(law="mass_velocity", coefficient=1e4)),
    ],
    ids=["coeff_restitution", "tsuji", "kuwabara-kono", "mass_velocity"],
)
def test_a_damped_collision_is_compared_by_its_velocities(scene: Scene, damping: Damping) -> None:
    scene = replace(scene, damping=damping, duration=4e-4)
    study = _study(scene)
    table = closed_form_table([study])
    assert table is not None
    assert [row[1] for row in table.rows] == [f"velocity of body {k} at the end (m/s)" for k in range(scene.n_body)]
    # scipy's accuracy, relative to the speed of approach
    assert all(abs(float(row[4])) < 1e-11 for row in table.rows)
    # the planted fault: a little more damping
    assert not isinstance(damping.coefficient, tuple)
    more = replace(scene, damping=replace(damping, coefficient=0.99 * damping.coefficient))
    wrong = closed_form_table([_study(scene, db.solve(more, backend=REFERENCE))])
    assert wrong is not None
    assert max(abs(float(row[4])) for row in wrong.rows) > 1e-4
    assert "closed form" not in [line.label for line in _panels(study)[1].series]


def test_a_collision_with_adhesion_has_a_largest_force_and_loses_nothing() -> None:
    scene = replace(PAIR, velocity=(0.05, 0.0), adhesion=Adhesion(law="dmt", pull_off=2.0))
    table = closed_form_table([_study(scene)])
    assert table is not None
    assert table.rows[0][1] == "largest force (N)"
    assert len(table.rows) == 3
    assert all(abs(float(row[4])) < 1e-11 * abs(float(row[2])) for row in table.rows)  # scipy's accuracy
    # the planted fault: the pull-off of JKR, three quarters
    wrong = replace(scene, adhesion=Adhesion(law="dmt", pull_off=1.5))
    other = closed_form_table([_study(scene, db.solve(wrong, backend=REFERENCE))])
    assert other is not None
    assert abs(float(other.rows[0][4])) > 0.1
    assert closed_form(replace(scene, damping=Damping(law="dashpot", coefficient=1.0, clip=False))) is None


def test_a_run_of_another_stiffness_is_caught_by_the_closed_form() -> None:
    other = replace(PAIR, stiffness=(1.01 * 3.98e9,))
    table = closed_form_table([_study(PAIR, db.solve(other, backend=REFERENCE))])
    assert table is not None
    force = table.rows[0]
    assert force[1] == "largest force (N)"
    # forces go as beta^(2/5)
    assert float(force[4]) / float(force[2]) == pytest.approx(1.01**0.4 - 1.0, rel=1e-6)


@pytest.mark.parametrize(
    "scene",
    [
        replace(PAIR, damping=Damping(law="dashpot", coefficient=1.0)),
        replace(PAIR, damping=Damping(law="kuwabara-kono", coefficient=1e-3)),
        replace(PAIR, gravity=9.81),
        replace(PAIR, drag=1.0),
        replace(PAIR, mass=(8.1e-3,) * 3, stiffness=(4e9,) * 2, velocity=(0.8, 0.0, 0.0), exponent=2.5, gap=0.0),
        replace(PAIR, velocity=(0.0, 0.8)),
    ],
    ids=["damped", "beyond the series", "heavy", "drag", "three", "apart"],
)
def test_what_is_no_single_collision_of_a_power_law_has_no_closed_form(scene: Scene) -> None:
    assert closed_form(scene) is None
    assert closed_form_table([_study(scene, db.solve(PAIR, backend=REFERENCE))]) is None


def test_the_figure_of_a_collision_has_its_closed_form_beside_velocities_and_forces() -> None:
    study = _study(PAIR)
    exact = closed_form(PAIR)
    assert exact is not None
    velocities, forces = _panels(study)
    levels = [line.y[0] for line in velocities.series if line.label == "closed form"]
    assert levels == list(exact.exit_velocity)
    assert [line.label for line in forces.series] == ["contact 0", "closed form"]
    run = study.run(REFERENCE)
    assert run is not None
    assert forces.series[1].y[0] == pytest.approx(run.peak_force[0], rel=1e-12)
    assert error_scale([study]) is None
    assert motion_of([replace(study, others=())]) is None


def test_many_bodies_are_a_map_and_a_wall_has_its_name() -> None:
    chain = replace(
        PAIR, name="ten", mass=(8e-3,) * 10, stiffness=(4e9,) * 9, velocity=(0.8,) + (0.0,) * 9, exponent=2.5, gap=0.0
    )
    assert all(panel.map is not None for panel in _panels(_study(chain)))
    assert [line.label for line in _panels(_study(RIGHT))[1].series] == ["wall right", "closed form"]
