"""Roles of a verification: which backend plays which part on a scene, and the runs in these parts.

A verification compares runs pair by pair, and each pair isolates one cause of error:

=========================  ==========================================================================
engine - twin              implementation and round-off: the same algorithm and step (and tables, if any)
engine - positional twin   implementation alone: the same round-off, too
twin - reference           time step: the same equations, solved to round-off
engine - reference         all of these, the error of a user's run
second reference           independent check: another integrator, each within its own uncertainty
theory - reference         model difference: other equations, never PASS or FAIL
=========================  ==========================================================================

:func:`assign_roles` alone decides who plays which part; :func:`list_cases` writes the parts down as cases.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Generic, TypeVar, cast

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.backends.surrogate_radius import radius_after
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.pair_coefficients import GRANULAR_STYLE
from dem_bridge.observables.differences import Readings
from dem_bridge.runs.case import Case
from dem_bridge.scene.scene import Scene
from dem_bridge.verification.reference_choice import REFERENCE, SCIPY, choose_references, second_settings

GRANULAR, TABLE = "lammps-granular", "lammps-table"
TWIN, THEORY = "verlet", "bca"
#: the name that verdicts give to the twin that keeps absolute positions, with the surrogate radius of the deck
POSITIONAL = "verlet in positions"
#: time steps of the refinement levels, in units of the main step
STEPS_OF_REFINEMENT = (10.0, 5.0, 2.5, 1.25)

Item = TypeVar("Item")
Other = TypeVar("Other")


@dataclass(frozen=True, kw_only=True)
class Roles:
    """Backends by the part that they play on one scene."""

    scene: Scene
    engine: str
    """The LAMMPS backend that is verified: ``pair_style granular`` where it has the laws, otherwise ``table``."""
    solver: str
    """As :class:`~dem_bridge.verification.reference_choice.References` has it."""
    second_reference: str | None
    """As the second of these."""

    @cached_property
    def readings(self) -> Readings:
        """Return the observables of the runs in these roles, each read once; another copy of the roles has its own."""
        return Readings(self.scene)

    @property
    def takes_tables(self) -> bool:
        """Return whether the engine interpolates forces in tables, so that the twin has a run with them, too."""
        return self.engine == TABLE


def assign_roles(scene: Scene) -> Roles:
    """Decide which backend plays which part on a scene.

    >>> from dem_bridge.scene.file import load_scene
    >>> roles = assign_roles(load_scene("decelerating-40"))
    >>> roles.engine, roles.solver, roles.second_reference
    ('lammps-granular', 'reference', 'scipy')
    """
    engine = GRANULAR if GRANULAR_STYLE.covers(scene) else TABLE
    solver, second = choose_references(scene)
    return Roles(scene=scene, engine=engine, solver=solver, second_reference=second)


@dataclass(frozen=True, kw_only=True)
class Runs(Generic[Item]):
    """One item (a case, a result) for each part in the verification of one scene.

    Iteration goes through all items; of each backend the main run comes first.
    """

    reference: Item
    second_reference: Item | None = None
    theory: Item
    twin: Item
    engine: Item
    tabled_twin: Item | None = None
    """The twin with the deck's tables; None where the engine has none."""
    positional_twin: Item
    """The twin in absolute positions, with the deck's surrogate radius and, if there are any, its tables."""
    twin_refinements: tuple[Item, ...] = ()
    """Runs at the coarser steps from which the order of convergence follows, the coarsest first."""
    engine_refinements: tuple[Item, ...] = ()

    def __iter__(self) -> Iterator[Item]:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, tuple):
                yield from value
            elif value is not None:
                yield value

    def map(self, function: Callable[[Item], Other]) -> Runs[Other]:
        """Return the runs with ``function`` applied to each item."""

        def apply(value: object) -> object:
            if isinstance(value, tuple):
                return tuple(function(item) for item in value)
            return None if value is None else function(cast(Item, value))

        return Runs(**{field.name: apply(getattr(self, field.name)) for field in fields(self)})  # type: ignore[arg-type]

    def filled(self, items: Iterable[Other]) -> Runs[Other]:
        """Return the same parts with other items, given in the order of iteration."""
        others = iter(items)
        return self.map(lambda _: next(others))


def list_cases(roles: Roles, main: Resolution, *, engine: Engine | None = None, full: bool = True) -> Runs[Case]:
    """List the runs that the verification of a scene needs; nothing is run.

    Parameters
    ----------
    roles : Roles
        Of the scene.
    main : Resolution
        Settings of the main runs of engine and twin; its ``dt`` is set.
    engine : Engine, optional
        Which LAMMPS.
    full : bool
        With the refinement levels, and with the uncertainty of the second reference where that is scipy.
    """
    assert main.dt is not None
    scene, sampling = roles.scene, Sampling(count=roles.scene.samples)
    levels = [replace(main, dt=factor * main.dt) for factor in STEPS_OF_REFINEMENT if full]
    tabled = replace(main, tables=roles.takes_tables)
    positional = replace(tabled, surrogate_radius=radius_after(prescan_scene(scene)))

    def case(name: str, resolution: Resolution, uncertainty: bool = True) -> Case:
        return Case(
            scene=scene,
            backend=name,
            resolution=resolution,
            sampling=sampling,
            engine=engine if name == roles.engine else None,
            uncertainty=uncertainty,
        )

    second = None
    if (name := roles.second_reference) is not None:
        second = case(name, second_settings(scene, name, sampling), full or name != SCIPY)
    return Runs(
        reference=case(REFERENCE, Resolution()),
        second_reference=second,
        theory=case(THEORY, Resolution()),
        twin=case(TWIN, main),
        engine=case(roles.engine, main),
        tabled_twin=case(TWIN, tabled, False) if roles.takes_tables else None,
        positional_twin=case(TWIN, positional, False),
        twin_refinements=tuple(case(TWIN, level, False) for level in levels),
        engine_refinements=tuple(case(roles.engine, level, False) for level in levels),
    )
