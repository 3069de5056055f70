"""Numbers of tables and files in exact small cases: units and powers of ten of columns, angles, boxes and defaults."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.formats.tables.render import as_json, as_markdown
from dem_bridge.formats.tables.table import Table
from dem_bridge.formats.writers import centres, format_of, text_of
from dem_bridge.physics.hertz import crossed_cylinders
from dem_bridge.scene.scene import Scene
from tests.helpers.columns import numbers, texts
from tests.helpers.export_chains import CROSSED
from tests.helpers.fake_runs import free_flight

QUARTZ: dict[str, Any] = {"radius": 9e-3, "youngs_modulus": 72e9, "poissons_ratio": 0.17}
TWO = Scene(name="two", duration=1.0, mass=(1.0, 2.0), stiffness=(1.0,), velocity=(1.0, 2.0))


def _written(unit: str, *values: float) -> tuple[str, list[str]]:
    """Return the heading and the cells of a column in Markdown."""
    table = Table(id="some", title="Some", columns=(numbers("x", "x", unit, list(values)),))
    heading, _, *rows = (line.strip("| ") for line in as_markdown(table).splitlines() if line[:1] == "|")
    return heading, rows


@pytest.mark.parametrize(
    ("unit", "values", "heading", "cells"),
    [
        # numbers without a unit and angles: as they are from 1e-3 up to 1e6, and with powers of their own beyond
        ("", (0.001,), "x", ["0.001"]),
        ("", (0.0009,), "x", ["9e-4"]),
        ("", (1e6,), "x", ["1e6"]),
        ("", (999998.0,), "x", ["1000000"]),
        ("deg", (20.0,), "x (°)", ["20"]),
        # of nothing but zeros
        ("N", (0.0,), "x (N)", ["0"]),
        # the power of the median, up to a ratio of 1e4
        ("N", (2e-9, 5e-9), "x (nN)", ["2", "5"]),
        ("N", (1.0, 1e4), "x (kN)", ["0.001", "10"]),
        ("N", (1.0, 1.1e4), "x (N)", ["1e0", "1.1e4"]),
        ("N", (1.0, 1.0, 1e4), "x (N)", ["1", "1", "10000"]),
        ("N", (1.0, 1.0, 2e3, 2e3, 2e3), "x (kN)", ["0.001", "0.001", "2", "2", "2"]),
        # without a prefix beyond pico and tera
        ("N", (2e-25,), "x (N)", ["2e-25"]),
        ("kg", (0.01, 0.02), "x (g)", ["10", "20"]),
        ("m", (3.0,), "x (m)", ["3"]),
        ("N/m^1.5", (2e10,), "x (10⁹ N/m^1.5)", ["20"]),
    ],
)
def test_a_column_has_the_power_of_ten_of_its_median(
    unit: str, values: tuple[float, ...], heading: str, cells: list[str]
) -> None:
    assert _written(unit, *values) == (heading, cells)


def test_json_is_indented_by_one_and_keeps_its_letters() -> None:
    table = Table(id="some", title="Größe", columns=(texts("word", "word", ["é"]),), notes=("µ",))
    text = as_json(table)
    assert text.splitlines()[1].startswith(' "')
    assert "Größe" in text
    assert '"é"' in text
    broken = replace(table, provenance={"x": float("nan")})
    with pytest.raises(ValueError, match="not JSON compliant"):
        as_json(broken)
    assert json.loads(text)["notes"] == ["µ"]


# angles


def test_angles_keep_the_stiffness_that_was_asked_for_and_a_per_cent_by_default() -> None:
    asked = [2e10, 1e10]
    found = db.angles_for(asked, **QUARTZ)
    assert found.stiffness.tolist() == asked
    assert found.within == 0.01
    for within in (0.0, 1.0, -0.1, 1.5):
        with pytest.raises(UsageError, match=rf"^within = {within}; allowed: a number above 0 and below 1$"):
            db.angles_for(asked, within=within, **QUARTZ)
        with pytest.raises(UsageError, match=rf"^within = {within}; allowed: a number above 0 and below 1$"):
            db.table_of(CROSSED, "angles", within=within)
    table = db.table_of(CROSSED, "angles")
    assert table.provenance["within"] == 0.01
    assert "angle tolerance for 1 % of stiffness" in {column.heading for column in table.columns}


def test_the_curve_has_its_angles_and_the_ratio_of_both_laws() -> None:
    frame = db.table_of(CROSSED, "stiffness-curve").to_pandas()
    assert frame["angle_deg"].tolist() == [0.1, 0.2, 0.5, *range(1, 91)]
    ratio = frame["stiffness_paper_N_per_m1_5"] / frame["stiffness_exact_N_per_m1_5"]
    np.testing.assert_allclose(frame["paper_over_exact"], ratio, rtol=1e-12)
    law: Any
    for law in ("paper", "exact"):
        elastic = {"radius": 9e-3, "young": 72e9, "poisson": 0.17}
        [value] = db.table_of(TWO, "stiffness-curve", angles=[30.0], **QUARTZ).to_pandas()[
            f"stiffness_{law}_N_per_m1_5"
        ]
        assert value == pytest.approx(crossed_cylinders(angle=30.0, law=law, **elastic).stiffness, rel=1e-12)


# trajectories


@pytest.mark.parametrize("name", ["extxyz", "lammpstrj", "csv"])
def test_a_format_can_be_named_whatever_the_ending_is(name: str) -> None:
    assert format_of(Path("run.txt"), name) == name
    assert format_of(Path(f"run.{name.upper()}")) == name
    with pytest.raises(UsageError, match=r"^format = 'pdf' is unknown; allowed: "):
        format_of(Path(f"run.{name}"), "pdf")


@pytest.mark.parametrize("spacing", [0.0, float("inf"), float("nan"), -1.0])
def test_a_spacing_is_a_finite_length(spacing: float) -> None:
    with pytest.raises(UsageError, match=rf"^spacing = {spacing}; allowed: a number above 0 \(m\)$"):
        centres(TWO, spacing)


def test_bodies_of_several_radii_touch_where_they_stand() -> None:
    quartz = db.Material(youngs_modulus=72e9, poissons_ratio=0.17, density=2200.0)
    bodies = [db.Body(shape="sphere", radius=radius, material=quartz) for radius in (1e-3, 3e-3, 2e-3, 5e-3)]
    scene = db.chain(name="spheres", duration=1e-4, bodies=bodies, velocity=0.5)
    positions, radii, physical = centres(scene)
    np.testing.assert_allclose(positions, [0.0, 4e-3, 9e-3, 16e-3], rtol=1e-12)
    np.testing.assert_allclose(radii, [1e-3, 3e-3, 2e-3, 5e-3], rtol=1e-15)
    assert physical
    # a box of two of the largest radii around all positions, whatever moves
    still = free_flight(bodies=4, contacts=3, samples=1, contact_force=np.zeros((2, 3)))
    still = replace(still, displacement=np.full_like(still.displacement, 0.25) * [-1.0, 1.0, 1.0, 1.0])
    lines = text_of(still, scene, "lammpstrj").splitlines()
    box = lines.index(next(line for line in lines if "BOX" in line)) + 1
    bounds = [[float(number) for number in line.split()[:2]] for line in lines[box : box + 3]]
    assert bounds[0] == pytest.approx([-0.25 - 0.01, 16e-3 + 0.25 + 0.01])
    assert bounds[1] == bounds[2] == pytest.approx([-0.01, 0.01])
    xyz = text_of(still, scene, "extxyz")
    lattice = [float(number) for number in xyz.split('Lattice="')[1].split('"')[0].split()]
    assert [lattice[0], lattice[4], lattice[8]] == pytest.approx([0.536, 0.02, 0.02])
    assert "spacing=physical" in xyz


def test_a_box_holds_bodies_that_all_move_to_one_side() -> None:
    run = free_flight(bodies=2, contacts=1, samples=1, contact_force=np.zeros((2, 1)))
    for away, low, high in ((3.0, -0.01, 3.02), (-3.0, -3.01, 0.02)):
        moved = replace(run, displacement=np.array([[0.0, 0.0], [away, away]]))
        lines = text_of(moved, TWO, "lammpstrj").splitlines()
        box = lines.index(next(line for line in lines if "BOX" in line)) + 1
        # bodies 10 mm apart, of 5 mm
        assert [float(number) for number in lines[box].split()[:2]] == pytest.approx([low, high])
    assert "spacing=nominal" in text_of(run, TWO, "extxyz")
    assert "spacing=physical" in text_of(run, replace(TWO, spacing=0.1), "extxyz")
