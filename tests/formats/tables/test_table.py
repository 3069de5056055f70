"""A table is what it was given, and refuses what it cannot be."""

from __future__ import annotations

import math

import pytest

from dem_bridge.errors import UsageError
from dem_bridge.formats.tables.table import Table, with_uncertainty
from dem_bridge.formats.units import UNITS
from tests.helpers.columns import counts, numbers, texts


def _table() -> Table:
    return Table(
        id="some",
        title="Some",
        columns=(
            counts("contact", "contact", [0, 1, None]),
            *with_uncertainty("peak_force", "peak force", "N", [1.5, math.nan, 3.0], [0.1, 0.2, math.inf]),
            texts("shape", "shape", ["sphere", "", None]),
        ),
        include="run 0\n",
    )


def test_names_carry_units_and_what_is_not_finite_is_not_known() -> None:
    table = _table()
    assert [one.name for one in table.columns] == ["contact", "peak_force_N", "peak_force_uncertainty_N", "shape"]
    assert table.rows == [(0, 1.5, 0.1, "sphere"), (1, None, None, None), (None, 3.0, None, None)]


def test_a_bar_belongs_to_its_column_wherever_that_goes() -> None:
    [force] = _table().only(["peak_force_N"]).columns
    assert force.uncertainties == (0.1, None, None)
    assert _table().columns[2].uncertainty_of == "peak_force_N"
    assert _table().columns[0].uncertainties is None


def test_pandas_has_the_types_of_the_columns_and_the_units_beside_them() -> None:
    frame = _table().to_pandas()
    assert [str(one) for one in frame.dtypes] == ["Int64", "float64", "float64", "string"]
    assert frame["peak_force_N"].isna().tolist() == [False, True, False]
    assert [one["unit"] for one in frame.attrs["columns"]] == ["", "N", "N", ""]


def test_columns_are_chosen_by_name_and_others_are_refused() -> None:
    chosen = _table().only(["shape", "peak_force_N"])
    assert [one.name for one in chosen.columns] == ["shape", "peak_force_N"]
    assert chosen.include is None, "commands have all columns or none"
    with pytest.raises(UsageError, match=r"table 'some' has no column 'force'; allowed: contact, peak_force_N,"):
        _table().only(["force"])
    for wrong in ([], ["shape", "shape"]):
        with pytest.raises(UsageError, match="one or more names, each once"):
            _table().only(wrong)


def test_columns_of_other_lengths_or_equal_names_are_no_table() -> None:
    one = counts("body", "body", [0, 1])
    for other in (counts("contact", "contact", [0]), counts("body", "again", [0, 1])):
        with pytest.raises(ValueError, match="columns of lengths"):
            Table(id="wrong", title="Wrong", columns=(one, other))


@pytest.mark.parametrize("unit", UNITS)
def test_no_unit_makes_a_name_that_programs_cannot_have(unit: str) -> None:
    assert numbers("x", "x", unit, []).name.isidentifier()
