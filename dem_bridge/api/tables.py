"""The public facade for tables of parameters and results, in the formats of other programs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dem_bridge.errors import UsageError
from dem_bridge.files import check_file, write_whole
from dem_bridge.scene import Scene
from dem_bridge.scene_file import scene_of

if TYPE_CHECKING:
    from dem_bridge.exports.table import Table


def export(
    scene: Scene | str | Path,
    *,
    table: str,
    format: str | None = None,
    path: str | Path | None = None,
    columns: Sequence[str] | None = None,
    **settings: Any,
) -> str | bytes:
    """A table of a scene as text (``parquet``: as bytes), written to ``path`` where one is given.

    ``table``: "contacts", "pair-coeffs", "bodies", "observables", "stiffness-curve" or "angles"; see :func:`table_of`
    for ``settings``. ``format``: "csv", "json" and "parquet" with every digit, "md" and "tex" (booktabs, siunitx)
    rounded and with units, and of pair-coeffs "lammps", which LAMMPS reads by ``include``; None: by the ending of
    ``path``. ``columns``: only these, in this order, by their names in csv. Raises UsageError for anything else, and
    what the run in a table raises.

    >>> import dem_bridge as db
    >>> print(db.export("decelerating-40", table="stiffness-curve", format="md", angles=[2.0, 30.0, 90.0],
    ...                 columns=["angle_deg", "paper_over_exact"]).split("*")[0].strip())
    ### Stiffness against angle for cylinders as in decelerating-40
    <BLANKLINE>
    | angle (°) | eq. 3.1 over exact |
    | ---: | ---: |
    | 2 | 1.1777 |
    | 30 | 1.0068 |
    | 90 | 1.0000 |
    """
    return exported(scene, table=table, format=format, path=path, columns=columns, **settings)[1]


def exported(
    scene: Scene | str | Path,
    *,
    table: str,
    format: str | None = None,
    path: str | Path | None = None,
    columns: Sequence[str] | None = None,
    **settings: Any,
) -> tuple[Table, str | bytes]:
    """The table, and it as :func:`export` writes it."""
    from dem_bridge.exports.formats import format_for, written

    path = None if path is None else Path(path)
    chosen = format_for(format, path, table)
    if path is not None:
        check_file(path)
    found = table_of(scene, table, **settings)
    if columns is not None:
        found = found.only(columns)
    content = written(found, chosen)
    if path is not None:
        write_whole(path.parent, {path.name: content})
    return found, content


def table_of(scene: Scene | str | Path, table: str, *, found: bool = True, **settings: Any) -> Table:
    """A table of a scene as data: ``columns``, ``rows``, ``notes``, ``to_pandas()``.

    "contacts" and "observables" have results in them: of the backend and with the settings of :func:`dem_bridge.solve`
    (default: backend="reference"); with ``found=False`` "contacts" does without a run. "contacts", "bodies" and
    "pair-coeffs" show a deck and take ``geometry``, ``types`` and ``surrogate_radius``, "stiffness-curve" ``angles``
    (degrees), "angles" ``law`` and ``within``; the last two ``radius`` (m), ``youngs_modulus`` (Pa) and
    ``poissons_ratio``, where they are not to be those of the scene. Raises UsageError for another table or setting.

    >>> import dem_bridge as db
    >>> db.table_of("decelerating-40", "contacts", found=False).to_pandas()["angle_deg"].round(3)[1:4].tolist()
    [2.0, 2.054, 2.112]
    """
    from dem_bridge.api.runs import solve
    from dem_bridge.exports.tables import needs_run, table_named, takes

    made = table_named(table)
    runs, own = takes(made)
    scene = scene_of(scene)
    if not found and needs_run(made):
        raise UsageError(f"found = False leaves nothing of table {table!r}: all of it is found by a run")
    mine = {key: settings[key] for key in own if key in settings}
    if not (runs and found):
        unknown = [key for key in settings if key not in own]
        if unknown:
            allowed = ", ".join(own) or "none"
            raise UsageError(f"setting {unknown[0]!r} of table {table!r} without a run is unknown; allowed: {allowed}")
        return made(scene, **mine)
    run = solve(scene, **({"backend": "reference"} | settings))
    return made(scene, run, **mine)
