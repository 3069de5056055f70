"""From stiffness to angle: set so, cylinders have it, and within the tolerance they have it to a per cent."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.formats.tables.angles import CURVE
from dem_bridge.physics.contact_ellipse import cylinder_stiffness_paper
from dem_bridge.physics.hertz import crossed_cylinders
from tests.helpers.export_chains import CROSSED, ELASTIC, PAIR
from tests.helpers.strategies import examples

QUARTZ: dict[str, Any] = {"radius": 9e-3, "youngs_modulus": 72e9, "poissons_ratio": 0.17}
LEAST = 4.689197642511e9
Law = Literal["paper", "exact"]
LAWS: tuple[Law, ...] = ("paper", "exact")


def _stiffness(angle: float, law: Law) -> float:
    # beyond 90 degrees two axes cross at the mirror image
    return crossed_cylinders(angle=min(angle, 180.0 - angle), law=law, **ELASTIC).stiffness


@examples(40)
@given(
    st.floats(math.log(0.01), math.log(90.0)).map(math.exp), st.sampled_from(LAWS), st.sampled_from([1e-3, 0.01, 0.1])
)
def test_angles_have_the_wanted_stiffness_and_their_tolerance_keeps_it(angle: float, law: Law, within: float) -> None:
    wanted = _stiffness(angle, law)
    found = db.angles_for(wanted, law=law, within=within, **QUARTZ)
    assert _stiffness(float(found.angle[0]), law) == pytest.approx(wanted, rel=1e-11)
    away = float(found.tolerance[0])
    for share in (-1.0, -0.5, 0.3, 1.0):
        off = _stiffness(float(found.angle[0]) + share * away, law) / wanted - 1.0
        # its edge is where the stiffness is off by just as much; roots are found to 1e-12
        assert abs(off) <= within * (1.0 + 1e-9)
    assert _stiffness(float(found.angle[0]) - away, law) / wanted - 1.0 == pytest.approx(within, rel=1e-8)


@pytest.mark.parametrize("law", LAWS)
def test_the_tolerance_is_that_of_the_slope_far_from_90_degrees_and_of_the_curvature_there(law: Law) -> None:
    small, right = db.angles_for([_stiffness(2.0, law), LEAST], law=law, within=1e-4, **QUARTZ).tolerance
    slope = db.angles_for(_stiffness(2.0, law), law=law, **QUARTZ).slope[0]
    # the next order is the within again, times a number like 1
    assert small == pytest.approx(1e-4 / abs(slope), rel=2e-4)
    # beta/beta_min = 1 + g^2/3; the next order is g^2 = 3e-4, and LEAST is printed to 13 digits
    assert right == pytest.approx(math.degrees(math.sqrt(3e-4)), rel=2e-4)


def test_the_slope_at_90_degrees_would_be_no_tolerance() -> None:
    """At 89 degrees 1 % over the slope would be 50 degrees; what keeps 1 % is 8.9."""
    found = db.angles_for(_stiffness(89.0, "exact"), **QUARTZ)
    assert 0.01 / abs(found.slope[0]) > 45.0
    assert found.tolerance[0] == pytest.approx(8.9, abs=0.1)


def test_what_no_angle_gives_is_one_clear_line() -> None:
    wrong = {
        r"^stiffness\[1\] is not possible .* = 4680000000.0 .*; allowed: from 4689197642.51 \(at": 4.68e9,
        r"^stiffness\[1\] is not possible with these cylinders: stiffness = -1.0; allowed: a finite number > 0": -1.0,
        r"^stiffness\[1\] is not possible with these cylinders: stiffness = nan": math.nan,
    }
    for message, value in wrong.items():
        with pytest.raises(UsageError, match=message) as caught:
            db.angles_for([7e10, value], **QUARTZ)
        assert "\n" not in str(caught.value)
    with pytest.raises(UsageError, match=r"^within = 1.0; allowed"):
        db.angles_for(7e10, within=1.0, **QUARTZ)
    with pytest.raises(UsageError, match=r"^radius = 0.0; allowed"):
        db.angles_for(7e10, **(QUARTZ | {"radius": 0.0}))
    assert db.angles_for([], **QUARTZ).angle.shape == (0,)


def test_a_chain_gets_the_angles_that_it_was_made_of() -> None:
    table = db.table_of(CROSSED, "angles")
    frame = table.to_pandas()
    assert math.isnan(frame["angle_deg"][0])
    assert frame["angle_deg"][1] == pytest.approx(20.0, rel=1e-11)
    assert frame["angle_deg"][2] == pytest.approx(90.0, abs=1e-4), "as near as 12 digits tell"
    assert "contact 0: a sphere has no angle" in table.notes
    assert table.provenance["law"] == "exact"
    # the same stiffness is had at other angles by the other law, which is stiffer
    assert db.table_of(CROSSED, "angles", law="paper").to_pandas()["angle_deg"][1] > 20.0


def test_the_papers_own_chain_is_set_from_2_to_90_degrees() -> None:
    frame = db.table_of("decelerating-40", "angles").to_pandas()
    assert frame["angle_deg"][1] == pytest.approx(2.0, rel=1e-10)
    assert frame["angle_deg"].iloc[-1] == pytest.approx(90.0, abs=1e-3)
    assert frame["angle_deg"][1:].is_monotonic_increasing


def test_other_cylinders_than_those_of_the_table_have_no_angles_in_it() -> None:
    quartz = db.Material(youngs_modulus=72e9, poissons_ratio=0.17, density=2200.0)
    thick, thin = (db.Body(shape="cylinder", radius=r, height=18e-3, material=quartz) for r in (9e-3, 6e-3))
    chain = db.chain(name="rods", duration=1e-3, bodies=[thick, thick, thin, thin], velocity=0.5, angles=20.0)
    table = db.table_of(chain, "angles")
    assert table.to_pandas()["angle_deg"][0] == pytest.approx(20.0, rel=1e-11)
    assert table.to_pandas()["angle_deg"].isna().tolist() == [False, True, True]
    assert "contact 1 to 2: its cylinders differ from those of this table in radius or material" in table.notes
    # with cylinders given by the caller, all contacts have angles
    assert not db.table_of(chain, "angles", **QUARTZ | {"radius": 4e-3}).to_pandas()["angle_deg"].isna().any()


def test_a_chain_without_geometry_is_told_which_cylinders() -> None:
    chain = replace(
        PAIR, mass=(1e-2,) * 4, stiffness=(4e9, 2e10, 3e7), exponent=(2.5, 2.5, 2.0), velocity=(0.8, 0, 0, 0), gap=0.0
    )
    with pytest.raises(
        UsageError, match=r"^pair has no two crossed cylinders, and radius, youngs_modulus, poissons_rat"
    ):
        db.table_of(chain, "angles")
    table = db.table_of(chain, "angles", **QUARTZ)
    assert table.to_pandas()["angle_deg"].isna().tolist() == [True, False, True]
    assert [note for note in table.notes if note.startswith("contact 0: stiffness = 4000000000.0 N/m^1.5; allowed: fr")]
    assert "contact 2: an angle follows only from Hertz' law, n = 2.5" in table.notes
    long = replace(chain, exponent=(2.5, 2.0, 2.0), stiffness=(2e10, 3e7, 3e7))
    assert (
        "contact 1 to 2: an angle follows only from Hertz' law, n = 2.5" in db.table_of(long, "angles", **QUARTZ).notes
    )
    with pytest.raises(UsageError, match=r"^pair has no contact with an angle; contact 0: stiffness = 4000000000.0"):
        db.table_of(PAIR, "angles", **QUARTZ)


def test_the_curve_is_that_of_both_laws() -> None:
    frame = db.table_of(CROSSED, "stiffness-curve").to_pandas()
    assert frame["angle_deg"].tolist() == list(CURVE)
    for angle, paper, exact in frame.iloc[:, :3].to_numpy()[::10]:
        assert paper == pytest.approx(cylinder_stiffness_paper(angle, **ELASTIC), rel=1e-13)
        assert exact == crossed_cylinders(angle=angle, **ELASTIC).stiffness
    # the slope is that of the curve: central differences, whose own error is h^2 f'''/6
    step = 1e-3
    near = db.table_of(CROSSED, "stiffness-curve", angles=[30.0 - step, 30.0, 30.0 + step]).to_pandas()
    for law in LAWS:
        rise = np.diff(np.log(near[f"stiffness_{law}_N_per_m1_5"]))
        assert np.sum(rise) / (2.0 * step) == pytest.approx(near[f"slope_{law}_per_deg"][1], rel=1e-6)
    with pytest.raises(UsageError, match=r"^contact angle = 91.0 degrees; allowed: 0 < angle <= 90"):
        db.table_of(CROSSED, "stiffness-curve", angles=[91.0])
    with pytest.raises(UsageError, match=r"^angles = \[\]; allowed"):
        db.table_of(CROSSED, "stiffness-curve", angles=[])
