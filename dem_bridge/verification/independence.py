"""Who shares what: the modules that two backends have in common, read from their imports.

Two codes that agree prove nothing where they share what is wrong. What all of them share is the language they speak
(scenes, trajectories, errors); anything else that a pair has in common is listed here, apart for the values of a run
and for its uncertainty.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from types import MappingProxyType

from dem_bridge.backends.base import BACKENDS
from dem_bridge.runs.code import file_of_module, imported_names, reached, rule_of

#: what every backend speaks: nothing in it solves anything
LANGUAGE = frozenset(
    f"dem_bridge.{name}"
    for name in (
        "backends.base", "errors", "foundation.compiled", "foundation.leftovers", "foundation.progress",
        "foundation.stopwatch", "runs.cache", "runs.case", "runs.code", "runs.keys", "runs.store", "scene.contacts",
        "scene.derived", "scene.features", "scene.scene", "scene.support", "trajectory.relative",
        "trajectory.trajectory",
    )
)  # fmt: skip
#: modules through which nothing reaches the values of a run. ``tabled`` gives the twin the tables of a deck for the
#: uncertainty of LAMMPS, and for its own values with ``tables=True`` only; ``scene_prescan`` runs the twin for scenes
#: whose laws are functions, of which only the largest values are read; ``roundoff`` writes a comment of a deck
ASIDE = frozenset(f"dem_bridge.backends.{name}" for name in ("roundoff", "scene_prescan", "tabled"))
#: concept -> modules, or rooms of them, that make it up: the words of the page
CONCEPTS: Mapping[str, tuple[str, ...]] = MappingProxyType({
    "law of contact": (
        "physics.adhesion", "physics.contact_ellipse", "physics.contact_law", "physics.damped_impact",
        "physics.viscoelastic",
    ),
    "closed form of a collision": ("physics.drop_and_stack", "physics.exact"),
    "solitary wave": ("physics.solitary", "physics.dispersion"),
    "binary collisions": ("backends.bca",),
    "integrator of fixed steps": ("backends.splitting", "backends.fused"),
    "twin": ("backends.twin",),
    "drive": ("backends.driven", "scene.drive", "scene.piston"),
    "curves of force for kernels": ("backends.curves",),
    "coarse run beforehand": ("backends.prescan", "backends.scene_prescan"),
    "radius of the particles": ("backends.surrogate_radius",),
    "time steps": ("backends.steps",),
    "limit of what is a collision": ("backends.scales",),
    "peaks between samples": ("trajectory.dense",),
    "round-off of positions": ("backends.roundoff",),
    "tables of force": ("backends.tabled", "lmp.force_table"),
    "interpolation of tables": ("lmp.interpolation", "lmp.table_cell"),
    "writer of decks": (
        "foundation.arguments", "lmp.deck", "lmp.known_defects", "lmp.pair_coefficients",
    ),
    "engine of LAMMPS": ("backends.lammps", "lmp.child", "lmp.engine", "lmp.loaded", "lmp.log", "lmp.process"),
    "reader of dumps": ("lmp.binary_dump",),
    "limits of numbers": ("foundation.numbers", "physics.numbers"),
    "version": ("version",),
    "rule of the uncertainty": ("runs.uncertainty",),
})  # fmt: skip
#: a backend that answers through another where its own method does not fit, and says so in the run's provenance
ANSWERS_THROUGH: Mapping[str, str] = MappingProxyType({"reference": "scipy"})


@dataclass(frozen=True)
class Shared:
    """The modules that a pair of backends has in common."""

    values: tuple[str, ...]
    uncertainty: tuple[str, ...]
    """For the uncertainty only."""

    def concepts(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return the parts that these modules make up, for values and then only for the uncertainty, in words.

        >>> shared("ase", "reference").concepts()
        (('limit of what is a collision',), ('rule of the uncertainty',))
        """
        values, uncertainty = (dict.fromkeys(map(concept_of, part)) for part in (self.values, self.uncertainty))
        return tuple(values), tuple(name for name in uncertainty if name not in values)


def shared(first: str, other: str) -> Shared:
    """Return the modules that two backends of ``BACKENDS`` share.

    >>> shared("reference", "bca").values
    ()
    """
    values = _reached(first, without=ASIDE) & _reached(other, without=ASIDE)
    further = _reached_by_uncertainty(first) & _reached_by_uncertainty(other) - values
    return Shared(tuple(sorted(values)), tuple(sorted(further)))


def concept_of(module: str) -> str:
    """Return the concept of a module; KeyError for a module that has none yet.

    >>> concept_of("dem_bridge.lmp.binary_dump"), concept_of("dem_bridge.runs.uncertainty.grazes")
    ('reader of dumps', 'rule of the uncertainty')
    """
    name = module.removeprefix("dem_bridge.")
    for concept, parts in CONCEPTS.items():
        if any(name == part or name.startswith(f"{part}.") for part in parts):
            return concept
    raise KeyError(f"{module} has no concept in CONCEPTS")


def matrix() -> dict[tuple[str, str], Shared]:
    """Every pair of backends, in the order of ``BACKENDS``."""
    return {pair: shared(*pair) for pair in combinations(BACKENDS, 2)}


def _reached(backend: str, without: frozenset[str] = frozenset()) -> frozenset[str]:
    """Modules that a backend imports, and they in turn; the language left out, and what lies behind ``without``."""
    start = BACKENDS[backend].module
    other = ANSWERS_THROUGH.get(backend)
    stops = LANGUAGE | without | ({BACKENDS[other].module} if other else set())
    return _closure(start, stops)


def _reached_by_uncertainty(backend: str) -> frozenset[str]:
    """Modules that a run of a backend and its uncertainty import."""
    own = _closure(rule_of(backend), LANGUAGE) if BACKENDS[backend].uncertainty else frozenset[str]()
    return _reached(backend) | own


def _closure(start: str, stops: frozenset[str]) -> frozenset[str]:
    """Return a module with all that it imports, without ``stops`` and what lies behind them."""
    return frozenset(reached([start], lambda module: imported_modules(module) - stops))


@cache
def imported_modules(module: str) -> frozenset[str]:
    """Return the modules of this package that a module imports, also within functions.

    It is the seam at which a test plants an import.

    >>> sorted(imported_modules("dem_bridge.scene.support"))
    ['dem_bridge.scene.derived', 'dem_bridge.scene.features', 'dem_bridge.scene.scene']
    """
    file = file_of_module(module)
    assert file is not None
    names = imported_names(file.read_text(encoding="utf-8"))
    return frozenset(name for name in names if name.startswith("dem_bridge.") and _is_module(name))


def _is_module(name: str) -> bool:
    """Return True for a module of this package; the ``__init__`` of a folder has nothing that solves anything."""
    file = file_of_module(name)
    return file is not None and file.name != "__init__.py"
