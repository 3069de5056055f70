"""The public functions for tables of parameters and results, in the formats of other programs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dem_bridge.errors import UsageError
from dem_bridge.foundation.arguments import check_arguments
from dem_bridge.foundation.files import check_file, write_whole
from dem_bridge.scene.file import scene_of
from dem_bridge.scene.scene import Scene

if TYPE_CHECKING:
    from dem_bridge.formats.tables.table import Table


def export(
    scene: Scene | str | Path,
    *,
    table: str,
    format: str | None = None,
    path: str | Path | None = None,
    columns: Sequence[str] | None = None,
    **settings: Any,
) -> str | bytes:
    """Return a table of a scene as text or bytes, and write it to a file if ``path`` is given.

    Parameters
    ----------
    scene : Scene, str or Path
        Scene, name of a shipped scene, or path of a scene file.
    table : {"contacts", "pair-coeffs", "bodies", "observables", "energy-ledger", "stiffness-curve", "angles"}
        Name of the table; see :func:`table_of`.
    format : {"csv", "json", "parquet", "md", "tex", "lammps"}, optional
        "csv", "json" and "parquet" keep every digit. "md" and "tex" (booktabs, siunitx) are rounded and have units in
        the headings. "lammps", for the table pair-coeffs only, is read by the LAMMPS command ``include``. The default
        follows from the ending of ``path``.
    path : str or Path, optional
        File to write.
    columns : sequence of str, optional
        Names of the columns to keep, in this order, as in the CSV format. The default is all columns.
    **settings
        Settings of the table and of its run; see :func:`table_of`.

    Returns
    -------
    str or bytes
        Contents of the file; bytes for the format "parquet".

    Raises
    ------
    UsageError
        If a table, format, column or setting is unknown or does not fit. A run in a table raises the errors of
        :func:`dem_bridge.solve`.

    Examples
    --------
    >>> import dem_bridge as db
    >>> print(db.export("decelerating-40", table="stiffness-curve", format="md", angles=[2.0, 30.0, 90.0],
    ...                 columns=["angle_deg", "paper_over_exact"]).split("*")[0].strip())
    ### Stiffness against angle for the cylinders of decelerating-40
    <BLANKLINE>
    | angle (°) | eq. 3.1 over exact |
    | ---: | ---: |
    | 2 | 1.1777 |
    | 30 | 1.0068 |
    | 90 | 1.0000 |
    """
    check_arguments(export, locals())
    return export_table(scene, table=table, format=format, path=path, columns=columns, **settings)[1]


def export_table(
    scene: Scene | str | Path,
    *,
    table: str,
    format: str | None = None,
    path: str | Path | None = None,
    columns: Sequence[str] | None = None,
    **settings: Any,
) -> tuple[Table, str | bytes]:
    """Return a table as data and as :func:`export` returns it, and write it if ``path`` is given."""
    from dem_bridge.formats.tables.text import format_for, render

    path = None if path is None else Path(path)
    chosen = format_for(format, path, table)
    if path is not None:
        check_file(path)
    data = table_of(scene, table, **settings)
    if columns is not None:
        data = data.only(columns)
    content = render(data, chosen)
    if path is not None:
        write_whole(path.parent, {path.name: content})
    return data, content


def table_of(scene: Scene | str | Path, table: str, *, with_run: bool = True, **settings: Any) -> Table:
    """Return a table of a scene as data.

    Parameters
    ----------
    scene : Scene, str or Path
        Scene, name of a shipped scene, or path of a scene file.
    table : {"contacts", "pair-coeffs", "bodies", "observables", "energy-ledger", "stiffness-curve", "angles"}
        "contacts" lists geometry, stiffness, LAMMPS coefficients, predictions and results of each contact;
        "pair-coeffs" the coefficients of each pair of atom types for ``pair_style granular``; "bodies" masses, shapes
        and materials; "observables" arrival, residence time, speed and peak velocity of the front at each body;
        "energy-ledger" the energy that each contact stores and dissipates, with the rest of the balance in notes;
        "stiffness-curve" the stiffness of two crossed cylinders against their angle; "angles" the angle that gives the
        stiffness of each contact.
    with_run : bool
        False for the table "contacts" without results of a run.
    **settings
        For tables with results ("contacts", "observables", "energy-ledger"): keywords of :func:`dem_bridge.solve`; the
        default backend is "reference". For tables about a deck ("contacts", "bodies", "pair-coeffs"): ``geometry``,
        ``types`` and ``surrogate_radius`` (m). For "stiffness-curve": ``angles`` (degrees). For "angles": ``law`` and
        ``within``. For the last two also ``radius`` (m), ``youngs_modulus`` (Pa) and ``poissons_ratio`` of the
        cylinders; the default is the scene's first crossed pair.

    Returns
    -------
    Table
        Table with the attributes ``columns``, ``rows`` and ``notes`` and the method ``to_pandas()``.

    Raises
    ------
    UsageError
        If a table or setting is unknown or does not fit.

    Examples
    --------
    >>> import dem_bridge as db
    >>> db.table_of("decelerating-40", "contacts", with_run=False).to_pandas()["angle_deg"].round(3)[1:4].tolist()
    [2.0, 2.054, 2.112]
    """
    check_arguments(table_of, locals())
    from dem_bridge.api.runs import solve
    from dem_bridge.formats.tables.tables import table_named

    build, needs_run, names = table_named(table)
    scene = scene_of(scene)
    if needs_run and not with_run:
        raise UsageError(f"table {table!r} consists of results of a run; leave out with_run=False (--no-run)")
    table_settings = {key: settings[key] for key in names if key in settings}
    if needs_run is None or not with_run:
        unknown = [key for key in settings if key not in names]
        if unknown:
            allowed = ", ".join(names) or "none"
            raise UsageError(f"table {table!r} without a run has no setting {unknown[0]!r}; allowed: {allowed}")
        return build(scene, **table_settings)
    run = solve(scene, **({"backend": "reference"} | settings))
    return build(scene, run, **table_settings)
