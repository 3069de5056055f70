"""Table files: exact columns, force = -d energy/dr on every one, and what is no contact law is refused."""

from __future__ import annotations

import math
from decimal import Decimal, localcontext
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.errors import UsageError
from dem_bridge.lmp.force_table import (
    LINES,
    POINTS,
    ContactTable,
    contact_table,
    finds_all_cells,
    points_for,
    zero_table,
)
from dem_bridge.physics.contact_law import ContactLaw, Floats, law_of, power_law
from tests.helpers.strategies import examples

DATE = "2026-11-21"
GAUGE = 2.0**-14
REACH = 2.0**-16
HERTZ = power_law(1e9, 2.5)


def table(law: ContactLaw = HERTZ, *, diameter: float = GAUGE, reach: float = REACH, **kwargs: int) -> ContactTable:
    return contact_table(law, keyword="LAW", diameter=diameter, reach=reach, **kwargs)


def changed(law: ContactLaw, *, force: float = 0.0, energy: float = 0.0, factor: float = 1.0) -> ContactLaw:
    """The law with something added to its force or energy, or its energy times a factor."""
    return ContactLaw(
        force=lambda overlap: law.force(overlap) + force,
        energy=lambda overlap: law.energy(overlap) * factor + energy,
    )


def test_the_file_is_in_the_form_that_lammps_documents() -> None:
    made = table()
    header, blank, keyword, parameters, second_blank, *rows = made.text.splitlines()
    assert header.startswith(f"# DATE: {DATE} UNITS: si CONTRIBUTOR: dem_bridge ")
    assert (blank, keyword, second_blank) == ("", "LAW", "")
    words = parameters.split()
    assert words[:3] == ["N", str(LINES), "FPRIME"]
    assert tuple(map(float, words[3:])) == made.slopes
    assert [int(row.split()[0]) for row in rows] == list(range(1, LINES + 1))
    # all digits: what is read is what was meant, bit for bit
    read = np.array([[float(word) for word in row.split()[1:]] for row in rows]).T
    for column, own in zip(read, (made.distance, made.energy, made.force), strict=True):
        np.testing.assert_array_equal(column, own)
    assert made.text.endswith("\n")


@pytest.mark.parametrize(("diameter", "reach"), [(GAUGE, REACH), (0.018, 1.7e-5), (0.018, 1e-9)])
def test_force_and_energy_are_those_of_the_distances_as_written(diameter: float, reach: float) -> None:
    made = table(diameter=diameter, reach=reach)
    assert made.distance[-1] == diameter
    assert made.force[-1] == made.energy[-1] == 0.0
    assert np.all(np.diff(made.distance) > 0.0)
    # moved by a few ulps at most, see _innermost
    assert diameter - made.distance[0] == pytest.approx(reach, abs=8 * math.ulp(diameter))
    with localcontext() as context:
        context.prec = 50
        for r, e, f in zip(made.distance, made.energy, made.force, strict=True):
            overlap = Decimal(diameter) - Decimal(float(r))
            exact = Decimal(10) ** 9 * overlap * overlap.sqrt()
            # pow is good to 1 ulp, the products and the quotient to half of one each
            assert abs(Decimal(float(f)) - exact) <= 3 * Decimal(math.ulp(float(f)))
            assert abs(Decimal(float(e)) - exact * overlap / Decimal("2.5")) <= 3 * Decimal(math.ulp(float(e)))


@examples(60)
@given(
    exponent=st.floats(2.0, 5.0),
    diameter=st.floats(1e-10, 0.02),
    share=st.floats(1e-6, 0.9),
    points=st.integers(500, 30_000),
    lines=st.integers(8, 1000),
)
def test_any_power_law_gives_a_sound_table(
    exponent: float, diameter: float, share: float, points: int, lines: int
) -> None:
    made = table(power_law(1e9, exponent), diameter=diameter, reach=share * diameter, points=points, lines=lines)
    assert 8 <= len(made.distance) <= lines
    assert finds_all_cells(float(made.distance[0]), diameter, points)
    # LAMMPS' own check of force = -dE/dr, which warns: between the secants of both sides (a convex energy), but where
    # r is so coarse (an ulp) that their difference is round-off
    secant = -np.diff(made.energy) / np.diff(made.distance)
    noise = 4 * 2.3e-16 * made.energy[:-1] / np.diff(made.distance)
    inner = made.force[1:-1]
    assert np.all(inner <= secant[:-1] + noise[:-1])
    assert np.all(inner >= secant[1:] - noise[1:])


def test_lines_are_close_together_at_touch_and_at_kinks() -> None:
    kink = 5e-6
    law = law_of(lambda d: 1e6 * (d + 3.0 * np.maximum(d - kink, 0.0)), reach=REACH, kinks=[kink])
    overlap = GAUGE - table(law).distance[::-1]
    step = np.diff(overlap)
    for place in (0.0, kink):
        assert step[np.argmin(abs(overlap[:-1] - place))] < 1e-4 * step.max()
    assert min(abs(overlap - kink)) <= math.ulp(GAUGE)


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (changed(HERTZ, force=math.nan), "force = nan N at overlap 0.0 m; allowed: finite and >= 0"),
        (changed(HERTZ, energy=math.inf), "energy = inf J at overlap 0.0 m"),
        (changed(HERTZ, force=-1e-3), "force = -0.001 N at overlap 0.0 m"),
        (changed(HERTZ, force=1e-3), "force = 0.001 N at overlap 0; allowed: 0 N"),
        (changed(HERTZ, energy=1e-9), "energy = 1e-09 J at overlap 0; allowed: 0 J"),
        (ContactLaw(force=HERTZ.force, energy=lambda d: np.zeros(3)), "energy has shape (3,)"),
        (changed(HERTZ, factor=1.0 + 1e-9), "allowed: force = -d energy/dr; use law_of(force, ..., kinks=...)"),
        (ContactLaw(force=HERTZ.force, energy=power_law(1e9, 2.5 + 1e-9).energy), "allowed: force = -d energy/dr"),
        # wrong in one place alone
        (
            ContactLaw(force=HERTZ.force, energy=lambda d: HERTZ.energy(d) * (1.0 + 1e-6 * (d > 0.9 * REACH))),
            "the energy rises by",
        ),
    ],
)
def test_what_is_no_contact_law_is_refused_with_place_and_numbers(law: ContactLaw, words: str) -> None:
    with pytest.raises(UsageError) as caught:
        table(law)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_energy_that_does_not_fit_is_named_by_overlap_and_both_numbers() -> None:
    step = ContactLaw(force=HERTZ.force, energy=lambda d: HERTZ.energy(d) + 1e-6 * (d > 0.5 * REACH))
    with pytest.raises(
        UsageError, match=r"from overlap (\S+) m to (\S+) m the energy rises by (\S+) J and .* (\S+) J of"
    ):
        table(step)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"reach": GAUGE}, "0 < reach < diameter"),
        ({"reach": 0.0}, "0 < reach < diameter"),
        ({"reach": math.nan}, "0 < reach < diameter"),
        ({"reach": 1e-20}, "has only"),
    ],
)
def test_wrong_settings_are_refused(changes: dict[str, object], words: str) -> None:
    settings: dict[str, object] = {"keyword": "LAW", "diameter": GAUGE, "reach": REACH} | changes
    with pytest.raises(UsageError) as caught:
        contact_table(HERTZ, **settings)  # type: ignore[arg-type]
    assert words in str(caught.value)


def test_the_zero_table_holds_no_force_and_begins_just_below_touch() -> None:
    none = zero_table(keyword="ZERO", diameter=GAUGE)
    assert not none.force.any()
    assert not none.energy.any()
    assert none.distance.tolist() == [GAUGE * 1023 / 1024, GAUGE]
    assert "\nZERO\nN 2 FPRIME 0.0 0.0\n\n1 " in none.text
    for points in (500, POINTS):
        assert finds_all_cells(float(none.distance[0]), GAUGE, points)


@given(tables=st.integers(0, 15_000))
def test_points_stay_within_their_memory(tables: int) -> None:
    points = points_for(tables)
    assert tables * 40 * (points + LINES) <= 5e8 or tables == 0
    assert points <= POINTS


def test_points_never_rise_with_the_number_of_tables_and_too_few_are_refused() -> None:
    assert all(few >= many for few, many in pairwise(map(points_for, range(1, 15_000, 500))))
    with pytest.raises(UsageError, match="20000 tables in 5e\\+08 bytes leave 375 points each; allowed: >= 500"):
        points_for(20_000)


def _hertz_and_linear(overlap: Floats) -> Floats:
    return np.asarray(1e6 * overlap + 1e9 * overlap**1.5)


def test_a_table_of_a_force_alone_has_the_energy_of_the_exact_law() -> None:
    made = table(law_of(_hertz_and_linear, reach=REACH))
    overlap = GAUGE - made.distance
    exact = 1e6 * overlap**2 / 2.0 + 1e9 * overlap**2.5 / 2.5
    # sums of 200 panels of rounded values
    np.testing.assert_allclose(made.energy, exact, rtol=0.0, atol=1e-13 * exact[0])
