"""Bands of driven chains: measured edges are judged by the infinite chain's, and a wrong chain is told."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

import dem_bridge as db
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.observables.modes import unit_cell
from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.study import Study
from dem_bridge.runs import campaign
from dem_bridge.scene.file import load_scene
from dem_bridge.scene.scene import Scene
from dem_bridge.studies import bands
from dem_bridge.studies.bands import study_bands

CHIRP = db.Drive(shape="chirp", force=0.02, frequency=600.0, last_frequency=11.4e3, sweep=25e-3)
#: 12 bodies and 200 periods of the highest frequency: half a per cent is resolved
BAR = replace(
    load_scene("driven-monomer"),
    name="bar",
    duration=25e-3,
    mass=load_scene("driven-monomer").mass[:12],
    stiffness=load_scene("driven-monomer").stiffness[:11],
    velocity=(0.0,) * 12,
    exponent=2.5,
    gap=0.0,
    geometry=None,
    drive=CHIRP,
)


def edges(study: Study) -> dict[str, dict[str, Any]]:
    """Rows of the table of edges by code."""
    table = next(one for one in study.tables if one.id == "edges")
    return {str(row[0]): dict(zip(table.columns, row, strict=True)) for row in table.rows}


@pytest.mark.slow
@pytest.mark.lammps
def test_three_codes_have_the_edge_of_the_infinite_chain() -> None:
    study = study_bands(BAR, jobs=1)
    found = edges(study)
    assert set(found) == {"scipy", "verlet", "lammps-granular"}
    theory = unit_cell(BAR)[1].edges[0] / (2.0 * math.pi)
    for row in found.values():
        assert row["infinite chain (kHz)"] == pytest.approx(1e-3 * theory, rel=1e-15)
        assert row["resolution (%)"] == pytest.approx(100.0 / BAR.duration / theory, rel=1e-3)
        # half of what is resolved: see observables.modes
        assert abs(row["difference (%)"]) <= 0.5 * row["resolution (%)"]
        assert row["outcome"] == "PASS"
    assert study.exit_code == 0
    codes = {row[0]: row[3] for row in next(one for one in study.tables if one.id == "codes").rows}
    assert isinstance(codes["lammps-granular"], float)
    # positions of 12 bodies, 2^-14 m, are known to 7e-21 m and bodies move by 1e-9 m; resonances keep what is lost
    assert 0.0 < codes["lammps-granular"] < 1e-8


@pytest.fixture
def only(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Of all codes one runs."""
    honest = campaign.run_cases

    def chosen(name: str) -> None:
        def run(cases: Any, **settings: Any) -> Any:
            return honest([case for case in cases if case.backend == name], **settings)

        monkeypatch.setattr(bands, "run_cases", run)

    return chosen


def test_another_chain_than_the_one_that_is_driven_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    """The planted fault: runs of bodies that are 4 % heavier move the edge by 2 %."""
    heavier = replace(BAR, mass=tuple(1.04 * mass for mass in BAR.mass))
    honest = campaign.run_cases

    def wrong(cases: Any, **settings: Any) -> Any:
        return honest([replace(case, scene=heavier) for case in cases if case.backend == "verlet"], **settings)

    monkeypatch.setattr(bands, "run_cases", wrong)
    study = study_bands(BAR, jobs=1)
    [row] = edges(study).values()
    assert row["difference (%)"] == pytest.approx(-2.0, abs=0.5)
    assert [one.outcome for one in study.verdicts] == [Outcome.FAIL]
    assert study.exit_code == 1


DIMER = load_scene("driven-dimer")
#: right codes, and not the theory's chain, or too little seen of it
ODD = {
    "the oscillation of the overlaps is 69 %": replace(BAR, drive=replace(CHIRP, force=1.5)),
    "the chain has damping": replace(BAR, damping=db.Damping(law="dashpot", coefficient=100.0)),
    "a tabulated drive need not": replace(
        BAR, drive=db.Drive(shape="table", force=(0.0, 0.02) + (0.0,) * 3998, interval=25e-3 / 3999)
    ),
    "the resolution is 249 Hz": replace(DIMER, duration=4e-3, drive=replace(CHIRP, last_frequency=13e3, sweep=4e-3)),
    # a gap of 12 Hz
    "the resolution is 25 Hz": replace(
        DIMER,
        mass=tuple((1.0 + 0.003 * (i % 2)) * DIMER.mass[0] for i in range(24)),
        geometry=None,
        drive=replace(CHIRP, frequency=100.0, last_frequency=15.5e3, sweep=40e-3),
    ),
}


def test_single_frequencies_that_stand_out_deep_in_a_gap_are_no_edges(only: Any) -> None:
    """Between walls this cell of three has four crossings at 11.9 kHz, where the trace is far below -2 all around."""
    steel = db.Material(youngs_modulus=200e9, poissons_ratio=0.3, density=7800.0)
    aluminium = db.Material(youngs_modulus=70e9, poissons_ratio=0.33, density=2700.0)
    brass = db.Material(youngs_modulus=103e9, poissons_ratio=0.34, density=8500.0)
    cell = [(steel, 9.525e-3), (aluminium, 9.525e-3), (brass, 6e-3)]
    scene = db.chain(
        name="three",
        duration=60e-3,
        bodies=[db.Body(shape="sphere", radius=radius, material=material) for material, radius in 8 * cell],
        wall_left=steel,
        wall_right=aluminium,
        precompression=20.0,
        drive=db.Drive(shape="chirp", force=0.02, frequency=500.0, last_frequency=15e3, sweep=60e-3),
    )
    only("verlet")
    study = study_bands(scene, jobs=1)
    assert [one.outcome for one in study.verdicts] == [Outcome.PASS] * 5


@pytest.mark.parametrize("tolerance", [math.nan, 0.0, -1.0, 1.0])
def test_a_tolerance_that_is_none_is_refused(tolerance: float) -> None:
    with pytest.raises(UsageError, match=r"tolerance = .*; allowed: above 0 and below 1"):
        study_bands(BAR, jobs=1, tolerance=tolerance)


def test_a_gap_too_narrow_to_be_seen_is_no_pass(only: Any) -> None:
    """From 600 Hz on the same chain shows as many edges as there should be, and all within 1 %."""
    only("verlet")
    narrow = ODD["the resolution is 25 Hz"]
    study = study_bands(
        replace(narrow, drive=replace(CHIRP, frequency=600.0, last_frequency=15.5e3, sweep=40e-3)), jobs=1
    )
    assert all(abs(float(row[4])) < 1.0 for row in study.tables[0].rows)
    assert {one.outcome for one in study.verdicts} == {Outcome.UNDECIDED}


@pytest.mark.parametrize("why", list(ODD))
def test_codes_are_not_judged_by_edges_that_the_theory_does_not_have(why: str, only: Any) -> None:
    only("verlet")
    study = study_bands(ODD[why], jobs=1)
    assert {one.outcome for one in study.verdicts} == {Outcome.UNDECIDED}
    assert study.exit_code == 4
    assert f"The band edges of verlet are not judged: {why}" in " ".join(study.answer)


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        (replace(BAR, drive=None), "is driven by no force"),
        (replace(BAR, precompression=0.0), "not precompressed"),
        (replace(BAR, drive=db.Drive(shape="sine", force=0.02, frequency=3e3)), "one frequency"),
        # its end is hidden by the window
        (
            replace(BAR, drive=db.Drive(shape="chirp", force=0.02, frequency=600.0, last_frequency=9e3, sweep=25e-3)),
            "not driven over all edges",
        ),
    ],
)
def test_chains_that_show_no_bands_are_refused(scene: Scene, words: str) -> None:
    with pytest.raises(UnsupportedScene, match=words):
        study_bands(scene, jobs=1)
