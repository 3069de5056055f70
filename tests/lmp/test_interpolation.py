"""LAMMPS' internal tables: the emulation against scipy's splines and, bit for bit, against LAMMPS itself."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.lmp.binary_dump import read_binary_dump
from dem_bridge.lmp.force_table import ContactTable, Style, contact_table, finds_all_cells, zero_table
from dem_bridge.lmp.interpolation import Interpolation, interpolated, interpolation_error
from dem_bridge.lmp.process import run_deck
from dem_bridge.lmp.table_cell import pair_force
from dem_bridge.physics.contact_law import ContactLaw, Floats, law_of, power_law

DATE = "2026-11-21"
GAUGE = (2.0**-14, 2.0**-16)
PHYSICAL = (0.018, 1.5e-5)
KINK = 5e-6

LAWS = {
    "linear": power_law(1e6, 2.0),
    "nearly linear": power_law(1e7, 2.05),
    "Hertz": power_law(1e9, 2.5),
    "steep": power_law(1e22, 5.0),
    "Hertz and linear": law_of(lambda d: 1e6 * d + 1e9 * d**1.5, reach=GAUGE[1]),
    "bilinear": law_of(lambda d: 1e6 * (d + 3.0 * np.maximum(d - KINK, 0.0)), reach=GAUGE[1], kinks=[KINK]),
}

STYLES: tuple[Style, ...] = get_args(Style)


def table(law: ContactLaw, geometry: tuple[float, float] = GAUGE, points: int = 1000) -> ContactTable:
    diameter, reach = geometry
    return contact_table(law, keyword="LAW", diameter=diameter, reach=reach, points=points)


def distances(geometry: tuple[float, float]) -> Floats:
    """Where the two are compared: at touch, in the first cells, around the kink, all over, an ulp inside touch."""
    diameter, reach = geometry
    overlap = np.concatenate(
        [
            np.geomspace(1e-9, 1.0 / 1.1, 500) * reach,
            np.linspace(0.0, 20e-3, 500) * reach,
            KINK + np.linspace(-2e-3, 2e-3, 200) * reach,
            np.random.default_rng(4).uniform(0.0, reach / 1.1, 300),
        ]
    )
    return np.concatenate([diameter - overlap, diameter * (1.0 - np.arange(-2, 20) * 2.0**-53)])


def error(law: ContactLaw, geometry: tuple[float, float], distance: Floats, force: Floats) -> float:
    """Measured error of forces, over the largest force."""
    diameter, reach = geometry
    exact = law.force(np.maximum(diameter - distance, 0.0))
    return float(abs(force - exact).max() / law.force(np.array(reach / 1.1)))


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("style", STYLES)
def test_the_emulation_is_the_mathematics_that_lammps_documents(name: str, style: Style) -> None:
    made, points = table(LAWS[name]), 1000
    ours = interpolated(made, style=style, points=points)
    # the same with scipy's splines and exact grids
    low, high = made.slopes
    file = CubicSpline(made.distance, made.force, bc_type=((1, low), (1, high)))
    inner, cut = made.distance[[0, -1]]
    squared = np.linspace(inner**2, cut**2, points)
    ratio = file(np.sqrt(squared)) / np.sqrt(squared)
    distance = np.linspace(inner * (1.0 + 1e-15), cut * (1.0 - 1e-15), 5000)
    if style == "linear":
        expected = distance * np.interp(distance**2, squared, ratio)
    else:
        ends = [
            (slope / r - force / r**2) / (2.0 * r)
            for slope, r, force in ((low, inner, made.force[0]), (high, cut, 0.0))
        ]
        expected = distance * CubicSpline(squared, ratio, bc_type=((1, ends[0]), (1, ends[1])))(distance**2)
    # conditioning: an ulp of r^2, which both round, over the table's range of r^2 (a half of it), some operations each
    np.testing.assert_allclose(ours.force(distance), expected, rtol=0.0, atol=1e-13 * made.force[0])


@pytest.mark.parametrize(("name", "style"), [(name, style) for name in LAWS for style in STYLES])
@pytest.mark.parametrize("geometry", [GAUGE, PHYSICAL])
def test_the_predicted_error_is_the_measured_one(name: str, style: Style, geometry: tuple[float, float]) -> None:
    law, r = LAWS[name], distances(geometry)
    made = interpolated(table(law, geometry), style=style, points=1000)
    predicted, measured = interpolation_error(law, made, reach=geometry[1]), error(law, geometry, r, made.force(r))
    # below 1e-12 both are round-off of r^2, and of the places looked at
    assert measured / 2.0 <= predicted <= 2.0 * measured or max(predicted, measured) < 1e-12


@pytest.mark.parametrize(
    ("exponent", "spline", "linear"),
    # measured, and rounded up by a half
    [(2.0, 1e-14, 4e-9), (2.05, 3e-7, 2e-6), (2.5, 1.2e-8, 3e-7), (3.0, 1e-12, 1.2e-8), (5.0, 2.3e-9, 5e-8)],
)
def test_splines_of_the_chosen_size_are_this_good(exponent: float, spline: float, linear: float) -> None:
    law = power_law(1e9, exponent)
    made = table(law, points=10_000)
    for style, most in zip(STYLES, (linear, spline), strict=True):
        assert interpolation_error(law, interpolated(made, style=style, points=10_000), reach=GAUGE[1]) < most


@pytest.mark.parametrize(("exponent", "gain"), [(2.05, 40.0), (2.25, 9.0), (2.5, 5.0)])
def test_the_slope_at_touch_is_worth_its_fit(exponent: float, gain: float) -> None:
    law = power_law(1e9, exponent)
    made = table(law, points=2000)
    exact = replace(made, slopes=(made.slopes[0], 0.0))
    fitted, unfitted = (
        interpolation_error(law, interpolated(one, style="spline", points=2000), reach=GAUGE[1])
        for one in (made, exact)
    )
    assert unfitted > gain * fitted


@pytest.mark.parametrize("exponent", [2.25, 2.5, 2.75])
def test_the_error_falls_as_the_force_at_the_first_cell(exponent: float) -> None:
    law = power_law(1e9, exponent)
    few, many = (
        interpolation_error(law, interpolated(table(law, points=n), style="spline", points=n), reach=GAUGE[1])
        for n in (1000, 8000)
    )
    # a cell is not of the same overlap all through the table, hence the tenth
    assert math.log(few / many) / math.log(8.0) == pytest.approx(exponent - 1.0, rel=0.1)


@pytest.mark.parametrize(
    ("fault", "least"),
    [
        (lambda made: replace(made, force=made.force * (1.0 + 1e-6)), 9e-7),
        (lambda made: replace(made, force=np.append(made.force[1:], 0.0)), 1e-3),
        (lambda made: replace(made, slopes=(made.slopes[0], 10.0 * made.slopes[1])), 1e-7),
    ],
    ids=["factor", "shift", "slope"],
)
def test_a_table_that_is_wrong_has_a_large_predicted_error(
    fault: Callable[[ContactTable], ContactTable], least: float
) -> None:
    law = LAWS["Hertz"]
    sound = table(law, points=10_000)
    found = interpolation_error(law, interpolated(fault(sound), style="spline", points=10_000), reach=GAUGE[1])
    # the sound one: 8e-9
    assert found > least


def test_there_is_no_force_from_the_cutoff_on_and_none_inside_the_table() -> None:
    made = table(LAWS["Hertz"])
    ours = interpolated(made, style="spline", points=1000)
    diameter = GAUGE[0]
    assert ours.force(np.array([diameter, 1.1 * diameter])).tolist() == [0.0, 0.0]
    with pytest.raises(ValueError, match="where the table begins"):
        ours.force(np.array([math.nextafter(float(made.distance[0]), 0.0)]))


#: a diameter, a reach and a number of points with which LAMMPS stops an ulp below touch
UNLUCKY = (2.644410318960502e-05, 0.442907813571317 * 2.644410318960502e-05, 1000)


def _unlucky() -> tuple[ContactTable, ContactTable]:
    """The table as made, and with the innermost distance that was asked for."""
    diameter, reach, points = UNLUCKY
    made = table(LAWS["Hertz"], (diameter, reach), points)
    distance = made.distance.copy()
    distance[0] = diameter - reach
    assert not finds_all_cells(float(distance[0]), diameter, points)
    return made, replace(made, distance=distance)


def test_a_table_that_would_stop_lammps_at_touch_is_found_out() -> None:
    made, unlucky = _unlucky()
    interpolated(made, style="spline", points=UNLUCKY[2])
    with pytest.raises(UsageError, match="LAMMPS would stop just below the cutoff; make the table for points=1000"):
        interpolated(unlucky, style="spline", points=UNLUCKY[2])


# with the engine


def lammps_forces(folder: Path, made: ContactTable, distance: Floats, style: Style, points: int) -> Floats:
    """LAMMPS' force (N) on the far atom of pairs along x, each out of reach of the others."""
    apart = 4.0 * float(made.distance[-1])
    side = math.isqrt(len(distance)) + 1
    atoms = [
        f"{2 * k + end} 1 {x!r} {apart * (k % side)!r} {apart * (k // side)!r}"
        for k, r in enumerate(distance.tolist())
        for end, x in ((1, 0.0), (2, r))
    ]
    wide = f"{-apart!r} {apart * (side + 1)!r}"
    (folder / "data.pairs").write_text(
        f"# pairs\n\n{len(atoms)} atoms\n1 atom types\n{wide} xlo xhi\n{wide} ylo yhi\n{wide} zlo zhi\n\n"
        "Masses\n\n1 1.0\n\nAtoms # atomic\n\n" + "\n".join(atoms) + "\n"
    )
    (folder / "law.table").write_text(made.text)
    (folder / "in.pairs").write_text(
        "units si\nboundary f f f\natom_style atomic\natom_modify map array sort 0 0.0\nread_data data.pairs\n"
        f"neighbor {0.01 * apart!r} bin\npair_style table {style} {points}\npair_coeff * * law.table {made.keyword}\n"
        "fix motion all nve\ndump forces all custom 1 dump.bin id fx\ndump_modify forces sort id\nrun 0\n"
    )
    run_deck(folder, "in.pairs", time_limit=60.0)
    return np.asarray(read_binary_dump(folder / "dump.bin", 2)[1][0, 1::2, 1])


@pytest.mark.lammps
@pytest.mark.parametrize(("style", "points"), [("linear", 1000), ("spline", 10_000)])
@pytest.mark.parametrize(
    ("name", "geometry"),
    [
        ("Hertz", GAUGE),
        ("Hertz", PHYSICAL),
        *(pytest.param(name, GAUGE, marks=pytest.mark.slow) for name in LAWS if name != "Hertz"),
        pytest.param("bilinear", PHYSICAL, marks=pytest.mark.slow),
    ],
)
def test_lammps_has_the_same_forces_bit_for_bit(
    name: str, geometry: tuple[float, float], style: Style, points: int, tmp_path: Path
) -> None:
    law = LAWS[name]
    made, r = table(law, geometry, points), distances(geometry)
    ours: Interpolation = interpolated(made, style=style, points=points)
    theirs = lammps_forces(tmp_path, made, r, style, points)
    np.testing.assert_array_equal(ours.force(r), theirs)
    log = (tmp_path / "log.lammps").read_text()
    assert f"law.table with DATE: {DATE}" in log
    assert "WARNING" not in log
    predicted, measured = interpolation_error(law, ours, reach=geometry[1]), error(law, geometry, r, theirs)
    assert measured / 2.0 <= predicted <= 2.0 * measured or max(predicted, measured) < 1e-12


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("squared", [0.0, -1e300, 1e300, math.inf, math.nan])
def test_any_distance_is_looked_up_within_the_table(squared: float, style: Style) -> None:
    # bodies of a run beyond stability pass through each other; memory beside the table would end the program
    found = interpolated(table(LAWS["Hertz"], points=100), style=style, points=100)
    here = pair_force(found.inner_squared * (1.0 + 1e-9), *found.arguments)
    assert here > 0.0
    pair_force(squared, *found.arguments)


@pytest.mark.lammps
def test_lammps_stops_beyond_the_reach_and_not_before(tmp_path: Path) -> None:
    made = table(LAWS["Hertz"])
    inner = float(made.distance[0])
    assert lammps_forces(tmp_path, made, np.array([inner]), "spline", 1000)[0] > 0.0
    with pytest.raises(RunBroken, match="Pair distance < table inner cutoff"):
        lammps_forces(tmp_path, made, np.array([math.nextafter(inner, 0.0)]), "spline", 1000)


@pytest.mark.lammps
def test_lammps_passes_touch_in_a_table_whose_innermost_distance_is_moved(tmp_path: Path) -> None:
    made, unlucky = _unlucky()
    touch = np.array([math.nextafter(UNLUCKY[0], 0.0)])
    assert lammps_forces(tmp_path, made, touch, "spline", UNLUCKY[2])[0] > 0.0
    with pytest.raises(RunBroken, match="Pair distance > table outer cutoff"):
        lammps_forces(tmp_path, unlucky, touch, "spline", UNLUCKY[2])


@pytest.mark.lammps
def test_bodies_without_a_contact_that_meet_stop_lammps(tmp_path: Path) -> None:
    none = zero_table(keyword="ZERO", diameter=GAUGE[0])
    near, nearer = GAUGE[0] * (1.0 - 2.0**-11), GAUGE[0] * (1.0 - 2.0**-9)
    assert lammps_forces(tmp_path, none, np.array([near, 2.0 * near]), "spline", 1000).tolist() == [0.0, 0.0]
    with pytest.raises(RunBroken, match="Pair distance < table inner cutoff"):
        lammps_forces(tmp_path, none, np.array([nearer]), "spline", 1000)
