"""The constants to take home: each by two computations, in every format, and in a C program that asserts them."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.formats.tables.constants.constant import Constant
from dem_bridge.formats.tables.constants.elastic import WAVE_EXPONENTS
from dem_bridge.formats.tables.constants.table import all_constants, second_values
from dem_bridge.physics.exact import restitution_obtained
from tests.helpers import second_constants

CONSTANTS = {constant.name: constant for constant in all_constants()}
#: each ninth constant, of every group, is computed a second time also by the fast test
SOME = set(list(CONSTANTS)[::9])
COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


def agree(constant: Constant, second: float) -> bool:
    """Return True if both computations agree to the digits of the constant: half a unit of the last one."""
    return abs(constant.rounded - second) <= 0.5 * 10.0 ** (1 - constant.family.digits) * (abs(second) or 1.0)


def test_every_constant_is_that_of_a_second_computation_to_its_digits() -> None:
    second = second_values()
    assert list(second) == list(CONSTANTS)
    assert [name for name, constant in CONSTANTS.items() if not agree(constant, second[name])] == []
    # a planted fault in the last digit that is certain is seen, in every constant
    for name, constant in CONSTANTS.items():
        off = 10.0 ** (1 - constant.family.digits)
        wrong = replace(constant, value=constant.value * (1.0 + off) if constant.value else off)
        assert not agree(wrong, second[name]), name


#: between two machines the second computation differs by its round-off: integrations of up to a thousand steps
SAME = 2e-13


def _repeated(names: set[str] | None) -> None:
    kept, errors = second_values(), []
    for name, value in second_constants.second_values(names).items():
        # an error relative to 1 loses the digits that cancel
        scale = 1.0 if name.endswith("_error") or not kept[name] else abs(kept[name])
        errors += [name] * (not abs(value - kept[name]) <= SAME * scale)
    assert errors == []


def test_second_values_are_those_of_their_computation() -> None:
    _repeated(SOME)


@pytest.mark.slow
def test_all_second_values_are_those_of_their_computation() -> None:
    _repeated(None)


def test_numbers_that_are_published_or_known_are_in_the_table() -> None:
    expected = {
        "solitary_n2_5_speed_by_velocity": 0.907470078412,
        "solitary_n2_5_speed_by_force": 0.905515776419,
        "solitary_n2_5_momentum": 1.6699712493,
        "solitary_n2_5_energy": 1.0693229458,
        "collision_n2_5_time_by_overlap": 2.943275184325,
        "chung_ooi_1_glass_force": 10696.88898,
        "chung_ooi_3_alumina_overlap": 8.08881e-6,
        "chung_ooi_2_magnesium_time": 767.06591e-6,
        "restitution_coeff_restitution_clipped_e0_5": 0.55028,
        "restitution_tsuji_not_clipped_e0_1": 0.09948,
        "restitution_tsuji_without_sqrt2_not_clipped_e0_5": 0.61608,  # measured with LAMMPS
    }
    for name, value in expected.items():
        digits = len(f"{value:.12g}".replace(".", "").split("e")[0].strip("0"))
        assert CONSTANTS[name].value == pytest.approx(value, rel=10.0 ** (1 - digits)), name
    errors = [CONSTANTS[f"solitary_n2_5_speed_by_{key}_nesterenko_error"].value for key in ("force", "velocity")]
    assert errors == pytest.approx([-0.0122, 0.0079], abs=5e-5)
    # by the virial theorem the energy of a wave and its force exponent fix the kinetic energy; n covers 2 < n <= 6
    assert {n - 1.0 for n in WAVE_EXPONENTS} >= {1.5, 2.0, 2.5, 3.0, 4.0, 5.0}


def test_what_is_to_write_gives_the_wanted_restitution() -> None:
    laws = [name for name in CONSTANTS if "_write_for_e" in name]
    assert len(laws) > 50
    for name in laws:
        [(law, clipped, e)] = re.findall(r"^restitution_(.*?)_(not_clipped|clipped)_write_for_e(.*)$", name)
        result = restitution_obtained(CONSTANTS[name].value, clip=clipped == "clipped", law=law)
        assert result == pytest.approx(float(e.replace("_", ".")), abs=1e-13), name


def test_every_row_states_digits_source_method_and_the_second_computation() -> None:
    frame = db.table_of(None, "constants").to_pandas()
    assert frame["name"].is_unique
    assert frame["name"].str.fullmatch(r"[a-z][a-z0-9_]*").all()
    needed = ["quantity", "parameters", "digits", "source", "method", "second_value", "second_method"]
    assert not frame[needed].isna().any(axis=None)
    assert (frame["method"] != frame["second_method"]).all()
    # an error of a formula is a difference from 1, whose digits cancel
    assert frame["digits"][~frame["name"].str.endswith("_error")].min() >= 12
    assert frame["difference"].abs().max() < 1e-12


def test_yaml_is_read_as_the_document_of_json() -> None:
    document = json.loads(db.export(table="constants", format="json"))
    assert yaml.safe_load(db.export(table="constants", format="yaml")) == document
    bodies = {format: db.export("decelerating-40", table="bodies", format=format) for format in ("json", "yaml")}
    assert yaml.safe_load(bodies["yaml"]) == json.loads(bodies["json"])


def test_the_c_header_needs_all_columns_and_the_table_of_constants() -> None:
    names = [column.name for column in db.table_of(None, "constants").columns if column.name != "unit"]
    with pytest.raises(UsageError, match=r"^format = 'c' needs the column unit; allowed: the table 'constants' with"):
        db.export(table="constants", format="c", columns=names)
    with pytest.raises(UsageError, match=r"^table 'bodies' cannot be written in the format 'c'; allowed: table 'const"):
        db.export("decelerating-40", table="bodies", format="c")


def test_a_table_has_a_scene_or_none() -> None:
    with pytest.raises(UsageError, match=r"^table 'contacts' needs a scene, and none was given; allowed: the name of"):
        db.export(table="contacts", format="csv")
    with pytest.raises(
        UsageError, match=r"^table 'constants' has no scene, and decelerating-40 was given; allowed: no"
    ):
        db.export("decelerating-40", table="constants", format="csv")


PROGRAM = """
#define DEM_BRIDGE_CONSTANTS_ARRAY
#include "constants.h"
#include "constants.h"
#include <assert.h>
#include <math.h>
#include <stddef.h>

int main(void)
{
    size_t i, count = sizeof dem_bridge_constants / sizeof dem_bridge_constants[0];
    assert(count == COUNT);
    for (i = 0; i < count; i++) {
        struct dem_bridge_constant c = dem_bridge_constants[i];
        double scale = c.second_value == 0.0 ? 1.0 : fabs(c.second_value);
        assert(fabs(c.value - c.second_value) <= 0.5 * pow(10.0, 1 - c.digits) * scale);
    }
    assert(fabs(DEM_BRIDGE_SOLITARY_N2_5_SPEED_BY_VELOCITY - 0.907470078412) < 1e-12);
    assert(fabs(DEM_BRIDGE_COLLISION_N2_5_TIME_BY_OVERLAP - 2.943275184325) < 1e-12);
    return 0;
}
"""


def _compiled(folder: Path, header: str) -> int:
    """Compile and run the program with a header, with warnings as errors; return its exit code."""
    assert COMPILER is not None
    (folder / "constants.h").write_text(header, encoding="ascii")
    (folder / "program.c").write_text(PROGRAM.replace("COUNT", str(len(CONSTANTS))), encoding="ascii")
    strict = ("-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror")
    words = [COMPILER, *strict, "program.c", "-o", "program", "-lm"]
    subprocess.run(words, cwd=folder, check=True, timeout=300)
    return subprocess.run([folder / "program"], stderr=subprocess.DEVNULL, check=False, timeout=60).returncode


@pytest.mark.skipif(COMPILER is None, reason="no C compiler (cc, gcc or clang)")
def test_a_c_program_that_includes_the_header_compiles_and_asserts(tmp_path: Path) -> None:
    header = str(db.export(table="constants", format="c", path=tmp_path / "constants.h"))
    assert (tmp_path / "constants.h").read_text(encoding="ascii") == header
    assert _compiled(tmp_path, header) == 0
    # planted: one digit of one constant
    name = "DEM_BRIDGE_SOLITARY_N3_WIDTH"
    [value] = re.findall(rf"#define {name} \((.*)\)", header)
    wrong = value[:-3] + str((int(value[-3]) + 5) % 10) + value[-2:]
    assert _compiled(tmp_path, header.replace(f"{name} ({value})", f"{name} ({wrong})")) != 0
