"""The table [measurement] of a scene file: it names files of measured values, and is no part of the Scene.

A measurement is no physics: a :class:`~dem_bridge.scene.scene.Scene` does not hold it, and its content hash does not
depend on it. :func:`measurement_of` reads the table from the scene file where a comparison needs it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from dem_bridge.errors import SceneError
from dem_bridge.foundation.files import named_file
from dem_bridge.scene.file.load import read_form
from dem_bridge.scene.scene import Scene

#: kind of measured values -> its name on a page; a digitised figure is not called data
NAMES = {"measured": "data", "digitised": "digitised figure", "synthetic": "synthetic data"}


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """Files of measured values, their source, and the uncertain parameters of the scene.

    ``files`` are CSV files. ``parameters`` maps the name of each uncertain parameter to its standard uncertainty (see
    the study "measurement" for the names). ``fit`` are the parameters that are fitted; None means
    all that belong to the whole scene.

    Examples
    --------
    >>> Measurement(files=(Path("laser.csv"),), parameters={"stiffness": 0.02}).name
    'data'
    """

    files: tuple[Path, ...]
    source: str = ""
    kind: str = "measured"
    parameters: Mapping[str, float] = field(default_factory=dict)
    fit: tuple[str, ...] | None = None

    @property
    def name(self) -> str:
        """Return what the values are called on a page."""
        return NAMES[self.kind]


def measurement_of(source: Scene | str | Path | None) -> Measurement | None:
    """Return the measurement of a scene file; None for a Scene, and for a file without the table [measurement].

    Raises
    ------
    SceneError
        If the file is not a valid scene file.
    """
    if source is None or isinstance(source, Scene):
        return None
    form, folder = read_form(source)
    table = form.measurement
    if table is None:
        return None
    try:
        files = tuple(
            named_file(folder, file) for file in ([table.file] if isinstance(table.file, str) else table.file)
        )
    except OSError as error:
        problem, allowed = f"cannot be read: {error.strerror}", "files below the folder of the scene file"
        raise SceneError("measurement.file", problem=problem, allowed=allowed, where=str(source)) from None
    return Measurement(
        files=files,
        source=table.source,
        kind=table.kind,
        parameters=table.parameters,
        fit=None if table.fit is None else tuple(table.fit),
    )
