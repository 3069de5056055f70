"""The public functions that make scenes from CSV files and from LAMMPS input scripts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dem_bridge.errors import OF_DAMAGED_DATA, DemBridgeError, SceneError, UsageError
from dem_bridge.foundation.arguments import check_arguments
from dem_bridge.foundation.files import text_of_file
from dem_bridge.scene.scene import Scene

if TYPE_CHECKING:
    from dem_bridge.lmp.reader.to_scene import ReadDeck

#: fields of a Scene that are columns of a table or parameters of scene_from_csv
_IN_TABLES = ("mass", "velocity", "stiffness", "exponent", "gap", "name", "duration", "law")
_SCENE_FIELDS = tuple(entry.name for entry in fields(Scene) if entry.init and entry.name not in _IN_TABLES)


def scene_from_csv(
    path: str | Path,
    *,
    duration: float,
    contacts: str | Path | None = None,
    name: str | None = None,
    **scene_fields: object,
) -> Scene:
    r"""Return the scene of a CSV table with a row per body.

    The table has the columns ``mass_kg`` and ``velocity_m_per_s``. For the contact to the next body it has
    ``stiffness_N_per_m^(n-1)`` and may have ``exponent`` (default 2.5), ``gap_m`` (default 0) and
    ``damping_N_s_per_m`` (dashpot) or ``damping_s`` (Kuwabara-Kono); these are empty in the last row. Lines that begin
    with # are comments.

    Parameters
    ----------
    path : str or Path
        CSV file with a row per body.
    duration : float
        Duration of the scene, s.
    contacts : str or Path, optional
        Second CSV file with a row per contact. It has the columns of contacts, and ``where`` with "chain", "wall_left"
        or "wall_right". Both files may be tables of :func:`dem_bridge.export`, "bodies" and "contacts".
    name : str, optional
        Name of the scene; the default is that of the file.
    **scene_fields
        Further fields of :class:`Scene`, such as ``gravity``, ``wall_right``, ``precompression`` or ``samples``.

    Returns
    -------
    Scene

    Raises
    ------
    SceneError
        If a table or a number in it is not allowed; the message states file, line and column.
    UsageError
        If a keyword is not a field of :class:`Scene`.

    Examples
    --------
    >>> import dem_bridge as db, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     text = "mass_kg,velocity_m_per_s,stiffness_N_per_m^(n-1)\n8e-3,0.8,4e9\n1e-2,0,\n"
    ...     _ = Path(folder, "pair.csv").write_text(text)
    ...     scene = db.scene_from_csv(f"{folder}/pair.csv", duration=1e-4, gravity=9.81)
    >>> scene.name, scene.mass, scene.stiffness, scene.gravity
    ('pair', (0.008, 0.01), (4000000000.0,), 9.81)
    """
    check_arguments(scene_from_csv, locals())
    from dem_bridge.lmp.reader.to_scene import scene_name
    from dem_bridge.scene.file.scene_csv import scene_of_csv

    for key in scene_fields:
        if key not in _SCENE_FIELDS:
            raise UsageError(f"scene_from_csv has no keyword {key!r}; allowed: {', '.join(_SCENE_FIELDS)}")
    file = Path(path)
    return scene_of_csv(
        _text(file, "a CSV file"),
        file=file.name,
        contacts=None if contacts is None else _text(Path(contacts), "a CSV file"),
        contacts_file="" if contacts is None else Path(contacts).name,
        name=scene_name(file.name) if name is None else name,
        duration=duration,
        **scene_fields,
    )


def scene_from_deck(
    path: str | Path,
    *,
    name: str | None = None,
    description: str | None = None,
    duration: float | None = None,
    samples: int | None = None,
    reverse: bool | None = None,
    variables: Mapping[str, str] | None = None,
    files_below: str | Path | None = None,
) -> Scene:
    """Return the scene of a LAMMPS input script in which every body is a sphere on one line.

    The reader knows ``pair_style granular`` (hertz, hertz/material, dmt, hooke), ``gran/hertz/history``, ``gran/hooke``
    and ``gran/hooke/history``; atoms from ``read_data`` or ``create_atoms single``; ``set``, ``group`` and ``velocity
    set``; frozen atoms at the ends and planes of ``fix wall/gran`` and ``fix wall/gran/region``, which become walls;
    ``fix gravity``, ``fix addforce`` at the ends (precompression of a chain that starts in equilibrium), ``fix
    langevin`` at zero temperature and ``fix viscous`` (drag); loops and branches by ``jump``, ``next`` and ``if``; the
    units si, cgs, micro, nano and lj. Of a LIGGGHTS script it knows ``pair_style gran model hertz``, ``fix
    property/global`` and planes of ``fix wall/gran``. All other commands that may change the motion are errors, which
    are listed together.

    Parameters
    ----------
    path : str or Path
        LAMMPS input script. The chain lies along x, y or z.
    name : str, optional
        Name of the scene; the default is that of the file.
    description : str, optional
        Description of the scene; the default states the file and the direction of the chain.
    duration : float, optional
        Duration, s; the default is that of all ``run`` commands.
    samples : int, optional
        Number of samples; the default is that of the frames of the first ``dump``.
    reverse : bool, optional
        True: body 0 is at the highest coordinate. False: at the lowest. The default is the end that moves, or the
        lowest coordinate if neither or both move.
    variables : mapping of str to str, optional
        Values of variables, as LAMMPS accepts them by ``-var``.
    files_below : str or Path, optional
        Folder below which the files must be that the script names. None: ``$DEM_BRIDGE_FILES_BELOW``, or else the
        folder of the script.

    Returns
    -------
    Scene

    Raises
    ------
    BlockedScript
        If the script cannot be read as a scene; the message has a line with file and line for each problem.

    Examples
    --------
    >>> import dem_bridge as db, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = db.write_deck("decelerating-40", folder)
    ...     scene = db.scene_from_deck(f"{folder}/in.decelerating-40")
    >>> scene.description
    'from in.decelerating-40: the chain lies along x; body 0 is atom 1 (which moves), positive is +x'
    >>> scene.content_hash == db.load_scene("decelerating-40").content_hash
    True
    """
    check_arguments(scene_from_deck, locals())
    return deck_read(
        Path(path),
        name=name,
        description=description,
        duration=duration,
        samples=samples,
        reverse=reverse,
        variables=variables,
        files_below=files_below,
    ).scene


def deck_read(path: Path, *, files_below: str | Path | None = None, **settings: Any) -> ReadDeck:
    """Return the scene of a LAMMPS input script, as :func:`scene_from_deck`, with notes on how it was read."""
    from dem_bridge.foundation.script_files import files_of, is_script, is_unit_test
    from dem_bridge.lmp.reader.to_scene import read_deck
    from dem_bridge.lmp.unit_test import read_unit_test

    kind, name = "a LAMMPS input script or a unit test of LAMMPS", path.name
    text = _text(path, kind)
    if is_unit_test(text):
        text, name = read_unit_test(text, str(path)).script, f"{name} as a script"
    if text.strip() and not is_script(text):
        raise SceneError("", problem="no line of the file is a command of LAMMPS", allowed=kind, where=str(path))
    try:
        return read_deck(text, file=name, opened=files_of(path.parent, files_below), **settings)
    except DemBridgeError:
        raise
    except OF_DAMAGED_DATA as error:
        problem = f"the script cannot be evaluated ({type(error).__name__})"
        raise SceneError("", problem=problem, allowed=kind, where=str(path)) from error


def _text(path: Path, allowed: str) -> str:
    """Return the text of a file; raise SceneError if it cannot be read."""
    try:
        return text_of_file(path)
    except OSError as error:
        problem = f"the file cannot be read ({error.strerror})"
        raise SceneError("", problem=problem, allowed=allowed, where=str(path)) from None
