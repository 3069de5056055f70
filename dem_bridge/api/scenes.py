"""The public facade for scenes that are no scene files: CSV, and the input scripts of LAMMPS."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dem_bridge.errors import SceneError, UsageError
from dem_bridge.scene import Scene

if TYPE_CHECKING:
    from dem_bridge.lmp.reader.scene import ReadDeck

#: what a Scene takes and a table of bodies and contacts has
_IN_TABLES = ("mass", "velocity", "stiffness", "exponent", "gap", "name", "duration", "law")
_BESIDE = tuple(one.name for one in fields(Scene) if one.init and one.name not in _IN_TABLES)


def scene_from_csv(
    path: str | Path,
    *,
    duration: float,
    contacts: str | Path | None = None,
    name: str | None = None,
    **beside: object,
) -> Scene:
    """The scene of a table with a row per body.

    Columns ``mass_kg``, ``velocity_m_per_s`` and, of the contact to the next body and empty in the last row,
    ``stiffness_N_per_m^(n-1)``, and if need be ``exponent`` (2.5), ``gap_m`` (0) and ``damping_N_s_per_m`` (dashpot)
    or ``damping_s`` (Kuwabara-Kono). ``contacts``: a second table with those of contacts, and ``where`` ("chain",
    "wall_left", "wall_right"). Both tables may be those of :func:`dem_bridge.export`, "bodies" and "contacts". Lines
    that begin with # are comments.

    ``duration`` in s; ``name``: None for that of the file; ``beside``: what else a :class:`Scene` takes, by its names,
    such as ``gravity``, ``wall_right``, ``precompression`` or ``samples``. Raises SceneError in one line with file,
    line and column.

    >>> import dem_bridge as db, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     text = "mass_kg,velocity_m_per_s,stiffness_N_per_m^(n-1)\\n8e-3,0.8,4e9\\n1e-2,0,\\n"
    ...     _ = Path(folder, "pair.csv").write_text(text)
    ...     scene = db.scene_from_csv(f"{folder}/pair.csv", duration=1e-4, gravity=9.81)
    >>> scene.name, scene.mass, scene.stiffness, scene.gravity
    ('pair', (0.008, 0.01), (4000000000.0,), 9.81)
    """
    from dem_bridge.exports.scene_csv import scene_of_csv
    from dem_bridge.lmp.reader.scene import scene_name

    for key in beside:
        if key not in _BESIDE:
            raise UsageError(f"scene_from_csv: {key!r} is unknown; allowed: {', '.join(_BESIDE)}")
    file = Path(path)
    return scene_of_csv(
        _text(file, "a CSV file"),
        file=file.name,
        contacts=None if contacts is None else _text(Path(contacts), "a CSV file"),
        contacts_file="" if contacts is None else Path(contacts).name,
        name=scene_name(file.name) if name is None else name,
        duration=duration,
        **beside,
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
) -> Scene:
    """The scene of a LAMMPS input script in which each body is a sphere on one line.

    Read are ``pair_style granular`` (hertz, hertz/material, hooke) and ``gran/hertz/history``, ``gran/hooke`` and
    ``gran/hooke/history``, with types that contacts share or not; atoms of ``read_data`` or ``create_atoms single``;
    ``set``, ``group``, ``velocity set``; frozen atoms at the ends as walls; ``fix`` gravity, addforce at the ends
    (precompression, with a start in equilibrium), langevin at zero temperature (drag); units si, cgs, micro and nano.
    What may change the motion and is not understood is refused.

    The chain lies along x, y or z. Body 0 is the end that moves, else the one of lowest coordinate; ``reverse`` True:
    the other end, of highest coordinate; False: that of lowest. The duration is that of all ``run``; the samples are
    the frames of the first ``dump``; both may be given instead. ``description`` None: where the scene is from and how
    it lies. ``variables``: as LAMMPS takes them by ``-var``. Raises SceneError in one line with file and line.

    >>> import dem_bridge as db, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = db.write_deck("decelerating-40", folder)
    ...     scene = db.scene_from_deck(f"{folder}/in.decelerating-40")
    >>> scene.description
    'from in.decelerating-40: the chain lies along x; body 0 is atom 1 (which moves), positive is +x'
    >>> scene.content_hash == db.load_scene("decelerating-40").content_hash
    True
    """
    return deck_read(
        Path(path),
        name=name,
        description=description,
        duration=duration,
        samples=samples,
        reverse=reverse,
        variables=variables,
    ).scene


def deck_read(path: Path, **settings: Any) -> ReadDeck:
    """As :func:`scene_from_deck`, with notes of how it was read."""
    from dem_bridge.lmp.reader.scene import read_deck

    return read_deck(
        _text(path, "a LAMMPS input script"),
        file=path.name,
        opened=lambda other: (path.parent / other).read_text(encoding="utf-8"),
        **settings,
    )


def _text(path: Path, what: str) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:  # a name with a NUL, bytes that are no text
        why = error.strerror if isinstance(error, OSError) else "no text"
        raise SceneError("", problem=f"cannot be read ({why})", allowed=what, where=str(path)) from None
