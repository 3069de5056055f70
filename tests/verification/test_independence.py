"""What judges shares nothing with what it judges, by its imports."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable

import pytest

from dem_bridge.backends.base import BACKENDS, backend
from dem_bridge.verification.independence import (
    ANSWERS_THROUGH,
    ASIDE,
    CONCEPTS,
    LANGUAGE,
    concept_of,
    imported_modules,
    matrix,
    shared,
)
from tests.helpers.seams import Seam, plant

#: judged, judge -> what they may share for the values of a run: unless more is said, what counts as a collision
JUDGED: dict[tuple[str, str], set[str]] = {
    **{(name, "reference"): {"scales"} for name in BACKENDS if name != "reference"},
    # a drive as kernels have it is in the coarse run alone: LAMMPS has its own formula
    # steps must be the same, and peaks be read off alike, so that both drop out of the difference; neither solves
    ("lammps-granular", "verlet"): {"dense", "driven", "scales", "steps", "prescan", "surrogate_radius"},
    # the twin takes LAMMPS' tables where it is asked to: then their lines are common to both and drop out, and what
    # LAMMPS makes of them is written a second time (table_cell, interpolation). Not asked, it knows nothing of tables
    ("lammps-table", "verlet"): {"dense", "driven", "scales", "steps", "prescan", "surrogate_radius"},
    ("ase", "verlet"): {"dense", "driven", "scales", "steps", "prescan"},
    ("bca", "reference"): set(),
    ("adiabatic", "reference"): set(),
}


def _short(modules: Iterable[str]) -> set[str]:
    return {name.rpartition(".")[2] for name in modules}


@pytest.mark.parametrize("pair", JUDGED, ids="-".join)
def test_a_judge_shares_no_solver_with_what_it_judges(pair: tuple[str, str]) -> None:
    assert _short(shared(*pair).values) == JUDGED[pair]


def test_only_fixed_step_codes_take_their_uncertainty_from_the_twin() -> None:
    for pair, found in matrix().items():
        # blanes-moan has the rules of the others, for runs of its own, and looks at a scene by the twin's coarse run
        fixed = all(backend(name).order is not None for name in pair)
        assert ("twin" in _short(found.uncertainty)) == fixed, pair
        assert "twin" not in _short(found.values)


def test_a_twin_with_tables_has_the_lines_of_the_deck_and_lammps_has_nothing_of_its_interpolation() -> None:
    lent = {"force_table", "contact_law", "pair_coefficients", "tabled", "version",
            "scene_prescan"}  # fmt: skip
    lent |= {"numbers"}  # limits of numbers, and no formula
    emulated = {"table_cell", "interpolation", "splitting", "twin"}
    rules = {"run_differences", "fixed_step", "grazes", "moments", "readings", "from_twins"}
    found = shared("lammps-table", "verlet")
    assert _short(found.uncertainty) == lent | emulated | {"curves", "fused"} | rules
    # what LAMMPS reads is written without the emulation
    reached, waiting = set[str](), [BACKENDS["lammps-table"].module]
    while waiting:
        waiting += (more := imported_modules(waiting.pop()) - reached - LANGUAGE - ASIDE)
        reached |= more
    assert "dem_bridge.lmp.force_table" in reached
    assert not emulated & {name.rpartition(".")[2] for name in reached}


def test_the_matrix_has_every_pair_once() -> None:
    assert len(matrix()) == len(BACKENDS) * (len(BACKENDS) - 1) // 2


def test_the_matrix_is_read_and_imports_no_module_that_it_is_about() -> None:
    code = (
        "import sys; from dem_bridge.verification import independence; before = set(sys.modules);"
        "independence.matrix(); print(*(name for name in set(sys.modules) - before if name.startswith('dem_bridge')))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_every_shared_module_has_a_concept_and_each_concept_exists() -> None:
    modules = {name for found in matrix().values() for name in (*found.values, *found.uncertainty)}
    concepts = {concept_of(name) for name in modules}
    assert concepts == set(CONCEPTS)
    assert not concepts & {name.rpartition(".")[2] for name in modules} - {"twin", "version", "drive"}
    with pytest.raises(KeyError, match="a_new_module has no concept"):
        concept_of("dem_bridge.backends.a_new_module")


def test_a_solver_that_is_shared_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    def planted(module: str) -> frozenset[str]:
        more = {"dem_bridge.backends.twin"} if module == "dem_bridge.backends.taylor" else set()
        return imported_modules(module) | more

    plant(monkeypatch, Seam.IMPORTED_MODULES, planted)
    assert "twin" in _short(shared("verlet", "reference").values)


def test_the_fallback_of_the_reference_is_named_and_real() -> None:
    for one, other in ANSWERS_THROUGH.items():
        assert BACKENDS[other].module in imported_modules(BACKENDS[one].module)
