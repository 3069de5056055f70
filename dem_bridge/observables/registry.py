"""Find every quantity that is measured, planned, judged, tabulated or drawn.

A module of this folder that declares observables has them in a tuple ``DECLARED``; a new observable is a new file, and
:func:`register` adds one from outside the package. Checks, planning, work-precision, the model hierarchy, the paper's
tables, exports and the report read :data:`OBSERVABLES`.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from dem_bridge.errors import UsageError
from dem_bridge.observables.observable import Observable as Observable

#: modules whose observables come first in tables and lists of verdicts, in this order; all others follow by name
_FIRST = ("traces", "front", "forces", "conserved")


def declared_in(folder: Path) -> tuple[Observable, ...]:
    """Return the observables that the modules in a folder declare; a module that declares none is not imported.

    Parameters
    ----------
    folder : Path
        Folder of the package ``dem_bridge.observables``.

    """
    names = {file.stem for file in folder.glob("*.py") if "\nDECLARED = (" in file.read_text(encoding="utf-8")}
    modules = [name for name in _FIRST if name in names] + sorted(names.difference(_FIRST))
    package = __name__.rpartition(".")[0]
    return tuple(observable for name in modules for observable in importlib.import_module(f"{package}.{name}").DECLARED)


_REGISTRY: dict[str, Observable] = {}
#: name -> observable, in the order of tables
OBSERVABLES: Mapping[str, Observable] = MappingProxyType(_REGISTRY)


def register(observable: Observable) -> Observable:
    """Add an observable to :data:`OBSERVABLES` and return it.

    It then is in the tables of verifications, work-precision and exports, and accuracy can be planned for it.

    Parameters
    ----------
    observable : Observable
        With a name that is not in use.

    Raises
    ------
    UsageError
        If the name is in use.

    """
    if observable.name in _REGISTRY:
        raise UsageError(f"observable = {observable.name!r} is registered already; allowed: another name")
    _REGISTRY[observable.name] = observable
    return observable


def observable_named(name: str) -> Observable:
    """Return the observable of that name; UsageError, with the names that are allowed, if there is none.

    Examples
    --------
    >>> residence_time = observable_named("residence_time")
    >>> residence_time.unit, residence_time.axis, residence_time.scale_name
    ('s', ('body',), "each body's own residence_time")

    """
    if name not in OBSERVABLES:
        raise UsageError(f"observable = {name!r}; allowed: {', '.join(OBSERVABLES)}")
    return OBSERVABLES[name]


for _observable in declared_in(Path(__file__).parent):
    register(_observable)
