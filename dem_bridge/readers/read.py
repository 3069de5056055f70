"""Read a file of any code as a record, in the format that its content shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from dem_bridge.errors import UsageError
from dem_bridge.readers.assemble import Choices, draft_of_table
from dem_bridge.readers.record import Record
from dem_bridge.readers.source import read_bytes, text_of
from dem_bridge.readers.tables import read_text
from dem_bridge.scene import Scene


def read_record(
    path: str | Path,
    scene: Scene,
    *,
    dt: float | None = None,
    columns: Mapping[str, str] | Sequence[str] | None = None,
    units: Mapping[str, str] | str | None = None,
    bodies: Sequence[int] | None = None,
    axis: str | None = None,
) -> Record:
    r"""Read what a file of any code has of a run of ``scene``.

    The format follows from the content. Headings are believed; what is recognised without being stated in the file is
    in :attr:`Record.recognised`. Values that contradict the scene are not refused.

    Parameters
    ----------
    path : str or Path
        File to read.
    scene : Scene
        Scene of the run: numbers of bodies and contacts.
    dt : float, optional
        Time step of the run, s; needed for a file with step numbers and no times.
    columns : mapping or sequence of str, optional
        Meaning of headings, such as ``{"ch1": "velocity 3 [mm/s]"}``, or the headings of all columns in their order.
    units : str or mapping, optional
        Unit style ("si", "metal", ...) of quantities without a unit, or the unit of each quantity, such as
        ``{"time": "ms"}``.
    bodies : sequence of int, optional
        Body of each column, in their order.
    axis : {"x", "y", "z"}, optional
        Axis of the chain.

    Returns
    -------
    Record
        Quantities in SI units with their rounding errors.

    Raises
    ------
    UsageError
        If the file cannot be read.

    Examples
    --------
    >>> import dem_bridge as db, tempfile
    >>> scene = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "pair.csv").write_text("t,v0,v1\n0,0.8,0\n1e-4,0.089,0.569\n")
    ...     record = read_record(f"{folder}/pair.csv", scene)
    >>> record.values["velocity"][1].tolist(), record.rounding["velocity"][1].tolist(), record.recognised[0]
    ([0.089, 0.569], [0.0005, 0.0005], 'time has no unit in the file and is read in s')
    """
    path = Path(path)
    if not path.is_file():
        raise UsageError(f"{path}: there is no such file; give a file of a run")
    try:
        choices = Choices(dt, columns, units, bodies, axis)
        table = read_text(text_of(read_bytes(path)))
        return draft_of_table(path.name, table, scene, choices).record(scene)
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from error
