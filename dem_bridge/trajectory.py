"""The one result: what every backend answers with, complete and read-only, and how it is kept on disk.

Knows numpy arrays and netCDF; nothing of how a trajectory was made.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.files import check_file

if TYPE_CHECKING:
    import xarray as xr

SCHEMA = "dem-bridge/trajectory/1"
#: what has error bars: two sampled in time, two per contact
QUANTITIES = ("velocity", "displacement", "peak_force", "crossing_time")
#: no scale of a contact or body is smaller than this part of the largest in the chain
SMALLEST_SCALE = 1e-3
Floats = NDArray[np.float64]

#: quantity -> (unit, what it is, dimensions); the vocabulary of every backend, file and table
VOCABULARY: Mapping[str, tuple[str, str, tuple[str, ...]]] = MappingProxyType(
    {
        "displacement": ("m", "displacement from the start", ("time", "body")),
        "velocity": ("m/s", "velocity", ("time", "body")),
        "contact_force": ("N", "compressive force of the contact", ("time", "contact")),
        "peak_force": ("N", "largest force of the contact", ("contact",)),
        "crossing_time": ("s", "first maximal compression of the contact; nan: never", ("contact",)),
    }
)


@dataclass(frozen=True, kw_only=True)
class Cost:
    """What a run cost. ``wall`` and ``cpu`` in s, with what was needed to set it up; nan: not measured."""

    wall: float
    cpu: float
    steps: int
    force_evaluations: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """Motion of every body and force of every contact, with bars, cost and provenance.

    Arrays (float64, read-only): ``time (n_t,)`` in s, starting at 0; ``displacement`` and ``velocity``
    ``(n_t, n_body)``; ``contact_force (n_t, n_contact)``, columns as :attr:`Scene.contacts`; ``peak_force`` and
    ``crossing_time (n_contact,)`` at the accuracy of the run, not of the sample spacing.

    ``uncertainty``: bars in the unit of each quantity. ``velocity`` and ``displacement`` are one number each, the
    largest error over all samples and bodies; ``peak_force`` and ``crossing_time`` have one per contact. inf: nothing
    can be said.
    """

    time: Floats
    displacement: Floats
    velocity: Floats
    contact_force: Floats
    peak_force: Floats
    crossing_time: Floats
    uncertainty: Mapping[str, Any]
    cost: Cost
    provenance: Mapping[str, Any]

    def __post_init__(self) -> None:
        n_t, n_body, n_contact = len(self.time), self.velocity.shape[-1], len(self.peak_force)
        sizes = {"time": n_t, "body": n_body, "contact": n_contact}
        for name in ("time", *VOCABULARY):
            array = np.array(getattr(self, name), dtype=np.float64)
            dims = VOCABULARY[name][2] if name in VOCABULARY else ("time",)
            if array.shape != (expected := tuple(sizes[d] for d in dims)):
                raise ValueError(f"{name} has shape {array.shape}; a trajectory needs {expected}")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        bars: dict[str, Any] = {}
        for name in QUANTITIES:
            bar = self.uncertainty[name]
            if name in ("velocity", "displacement"):
                bars[name] = float(bar)
            else:
                bars[name] = np.broadcast_to(np.asarray(bar, dtype=np.float64), (n_contact,)).copy()
                bars[name].setflags(write=False)
        object.__setattr__(self, "uncertainty", MappingProxyType(bars))
        object.__setattr__(self, "provenance", MappingProxyType(dict(self.provenance)))

    def __reduce__(self) -> tuple[Any, ...]:
        """Read-only mappings cannot be pickled: travel as plain ones, and be checked again on arrival."""
        parts = {name: getattr(self, name) for name in self.__dataclass_fields__}
        parts |= {name: dict(parts[name]) for name in ("uncertainty", "provenance")}
        return _arrive, (parts,)

    def _repr_html_(self) -> str:
        """Shown in notebooks: who solved what, with which bars, at what cost."""
        from dem_bridge.notebook import trajectory_html

        sampled = {name: np.max(np.abs(getattr(self, name)), initial=0.0) for name in ("velocity", "displacement")}
        owned = {name: own_scale(getattr(self, name)) for name in ("peak_force", "crossing_time")}
        return trajectory_html(self, sampled | owned, {name: VOCABULARY[name][0] for name in QUANTITIES})

    def to_xarray(self) -> xr.Dataset:
        """Labelled dataset: dimensions time, body, contact; units and bars as attributes and ``*_bar``."""
        import xarray as xr

        data: dict[str, Any] = {}
        for name, (unit, meaning, dims) in VOCABULARY.items():
            data[name] = (dims, getattr(self, name), {"units": unit, "long_name": meaning})
        for name, bar in self.uncertainty.items():
            dims = ("contact",) if np.ndim(bar) else ()
            data[f"{name}_bar"] = (
                dims,
                bar,
                {"units": VOCABULARY[name][0], "long_name": f"error bar of {name}"},
            )
        return xr.Dataset(
            data,
            coords={
                "time": ("time", self.time, {"units": "s", "long_name": "time"}),
                "body": ("body", np.arange(self.velocity.shape[1]), {"long_name": "body, 0 is the struck end"}),
                "contact": (
                    "contact",
                    np.arange(len(self.peak_force)),
                    {"long_name": "contact: k joins body k and k + 1, then wall_left, wall_right"},
                ),
            },
            attrs={
                "schema": SCHEMA,
                "provenance": json.dumps(dict(self.provenance), sort_keys=True),
                "cost": json.dumps(
                    {name: None if value != value else value for name, value in asdict(self.cost).items()}
                ),
            },
        )

    def save(self, path: str | Path) -> None:
        """Write netCDF-4; the file appears whole or not at all."""
        path = Path(path)
        check_file(path)
        part = path.with_name(f"{path.name}.{os.getpid()}.part")
        try:
            self.to_xarray().to_netcdf(part, engine="h5netcdf")
            part.replace(path)
        except OSError as error:
            raise UsageError(f"{path}: cannot be written ({error}); give another file") from error
        finally:
            part.unlink(missing_ok=True)


def own_scale(values: Floats) -> Floats:
    """Scale of each contact's or body's own value: its magnitude, or a thousandth of the largest where that is more,
    because one that is hardly felt is measured against the chain and not against its own nothing.

    >>> own_scale(np.array([-4.0, 1e-9, np.nan])).tolist()
    [4.0, 0.004, 0.004]
    """
    size = np.nan_to_num(np.abs(values))
    return np.asarray(np.maximum(size, SMALLEST_SCALE * float(np.max(size, initial=0.0))))


def _arrive(parts: dict[str, Any]) -> Trajectory:
    return Trajectory(**parts)


def load_trajectory(path: str | Path) -> Trajectory:
    """Read what :meth:`Trajectory.save` wrote; another schema is refused by name."""
    import xarray as xr

    path = Path(path)
    if not path.is_file():
        raise UsageError(f"{path}: no such file; allowed: a .nc file written by Trajectory.save")
    try:
        dataset = xr.load_dataset(path, engine="h5netcdf")
    except OSError as error:
        raise UsageError(f"{path}: not a netCDF-4 file ({error}); write one with Trajectory.save") from error
    schema = dataset.attrs.get("schema", "none")
    if schema != SCHEMA:
        raise UsageError(f"{path}: schema {schema!r}; this version reads {SCHEMA!r}")
    try:
        return _from_dataset(dataset)
    except (KeyError, TypeError, ValueError) as error:
        raise UsageError(f"{path}: a part is missing or wrong ({error}); write it again") from error


def _from_dataset(dataset: xr.Dataset) -> Trajectory:
    cost: dict[str, Any] = json.loads(dataset.attrs["cost"])
    known = {name: value for name, value in cost.items() if value is not None}  # JSON has no nan
    return Trajectory(
        time=dataset["time"].values,
        **{name: dataset[name].values for name in VOCABULARY},
        uncertainty={name: dataset[f"{name}_bar"].values for name in QUANTITIES},
        cost=Cost(**{"wall": math.nan, "cpu": math.nan, **known}),
        provenance=json.loads(dataset.attrs["provenance"]),
    )
