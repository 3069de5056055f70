"""The result of a run, complete and read-only, with its uncertainty and cost, and its file format (netCDF-4).

This module knows numpy arrays and netCDF and nothing of how a trajectory was computed.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.foundation.arguments import check_arguments, is_path
from dem_bridge.foundation.files import check_file, write_whole
from dem_bridge.foundation.numbers import constant_doubles
from dem_bridge.foundation.stopwatch import Stopwatch
from dem_bridge.trajectory.relative import own_scale
from dem_bridge.version import schema_fault

if TYPE_CHECKING:
    import xarray as xr
    from pandas import DataFrame

    from dem_bridge.foundation.netcdf import Contents

SCHEMA = "dem-bridge/trajectory/2"
#: the schema before, which calls uncertainties ``*_bar`` and has no parts of them
PREVIOUS = "dem-bridge/trajectory/1"
#: quantities with an uncertainty: two are sampled in time, two have one value per contact
SAMPLED, PER_CONTACT = ("velocity", "displacement"), ("peak_force", "crossing_time")
QUANTITIES = (*SAMPLED, *PER_CONTACT)
Floats = NDArray[np.float64]

#: quantity -> (unit, description, dimensions), for every backend, file and table
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
    """The cost of a run.

    ``wall`` and ``cpu`` (s) include the preparation of the run, such as a prescan or a deck; nan: not measured.
    """

    wall: float
    cpu: float
    steps: int
    force_evaluations: int

    @classmethod
    def since(cls, watch: Stopwatch, *, steps: int, force_evaluations: int, child_cpu: float = 0.0) -> Cost:
        """Return the cost of a run that began with ``watch``; ``child_cpu``: CPU time of a child process, s."""
        return cls(wall=watch.wall, cpu=watch.cpu + child_cpu, steps=steps, force_evaluations=force_evaluations)


#: the cost of a result for which nothing was computed
FREE = Cost(wall=0.0, cpu=0.0, steps=0, force_evaluations=0)


class _ReadOnly:
    """Base of dataclasses whose arrays and mappings are read-only, also after pickling."""

    def __reduce__(self) -> tuple[Any, ...]:
        parts = {each.name: getattr(self, each.name) for each in fields(cast(Any, self))}
        plain = {name: dict(part) if isinstance(part, MappingProxyType) else part for name, part in parts.items()}
        return _rebuild, (type(self), plain)


def _rebuild(kind: type[Any], parts: dict[str, Any]) -> Any:
    return kind(**parts)


@dataclass(frozen=True, kw_only=True, eq=False)
class Uncertainty(_ReadOnly, Mapping[str, Any]):
    """The estimated numerical error of a run: a mapping from each quantity to its uncertainty, in its own unit.

    Parameters
    ----------
    velocity, displacement : float
        Largest error over all samples and bodies, m/s and m; inf where no estimate exists.
    peak_force, crossing_time : float or array, shape (n_contact,)
        Error of each contact, N and s.
    parts : mapping
        Parts of the velocity uncertainty by cause, relative to the largest velocity: ``time_step``, ``round_off``,
        ``table``, ``summation`` and ``last_digit`` for codes with a fixed step; empty for others.
    roundoff_floor : float
        Round-off of absolute positions in the velocities, relative to the largest; nan where it was not measured.
    sampling : mapping
        Part of each quantity's uncertainty that comes from reading it between time steps, relative to its scale.
    cost : Cost
        Cost of the estimate, in addition to that of the run.

    Examples
    --------
    >>> estimate = Uncertainty(velocity=1e-6, displacement=1e-9, peak_force=[0.1, 0.2], crossing_time=1e-9)
    >>> estimate["velocity"], estimate["peak_force"].tolist(), list(estimate)
    (1e-06, [0.1, 0.2], ['velocity', 'displacement', 'peak_force', 'crossing_time'])
    """

    velocity: float
    displacement: float
    peak_force: Any
    crossing_time: Any
    parts: Mapping[str, float] = field(default_factory=dict)
    roundoff_floor: float = math.nan
    sampling: Mapping[str, float] = field(default_factory=dict)
    cost: Cost = FREE
    # a mapping of arrays has no equality of its own: two estimates are equal if they are one object
    __eq__ = object.__eq__
    __hash__ = object.__hash__

    def __post_init__(self) -> None:
        for name in SAMPLED:
            object.__setattr__(self, name, float(getattr(self, name)))
        for name in PER_CONTACT:
            values = np.array(getattr(self, name), dtype=np.float64)
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        for name in ("parts", "sampling"):
            numbers = {key: float(value) for key, value in getattr(self, name).items()}
            object.__setattr__(self, name, MappingProxyType(numbers))

    def __str__(self) -> str:
        """Return a line for each quantity, with the largest uncertainty of all contacts, and one for the parts."""
        from dem_bridge.foundation.notebook import quantity as shown

        rows = {name: shown(float(np.max(value, initial=0.0)), VOCABULARY[name][0]) for name, value in self.items()}
        parts = ", ".join(f"{name.replace('_', ' ')} {value:.1e}" for name, value in self.parts.items())
        lines = ["Uncertainty", *(f"  {name.replace('_', ' '):14} {text}" for name, text in rows.items())]
        return "\n".join(lines + ([f"  of velocities  {parts} (relative)"] if parts else []))

    __repr__ = __str__

    def __getitem__(self, quantity: str) -> Any:
        if quantity not in QUANTITIES:
            raise KeyError(quantity)
        return getattr(self, quantity)

    def __iter__(self) -> Iterator[str]:
        return iter(QUANTITIES)

    def __len__(self) -> int:
        return len(QUANTITIES)

    def of_contacts(self, count: int) -> Uncertainty:
        """Return this uncertainty with one value per contact for each of ``count`` contacts."""
        values: dict[str, Any] = {name: np.broadcast_to(self[name], (count,)) for name in PER_CONTACT}
        return replace(self, **values)

    def as_json(self) -> dict[str, Any]:
        """Return all parts except the four quantities as JSON types; a number that is not finite becomes null."""
        floor = self.roundoff_floor
        return {
            "parts": dict(self.parts),
            "roundoff_floor": floor if math.isfinite(floor) else None,
            "sampling": dict(self.sampling),
            "cost": cost_as_json(self.cost),
        }

    @classmethod
    def from_json(cls, values: Mapping[str, Any], about: Mapping[str, Any]) -> Uncertainty:
        """Return the uncertainty with four ``values``, and the parts ``about`` them that :meth:`as_json` returned."""
        floor = about["roundoff_floor"]
        return cls(
            **{name: values[name] for name in QUANTITIES},
            parts=about["parts"],
            roundoff_floor=math.nan if floor is None else float(floor),
            sampling=about["sampling"],
            cost=cost_from_json(about["cost"]),
        )


#: the uncertainty of a run for which none was estimated
UNKNOWN = Uncertainty(velocity=math.inf, displacement=math.inf, peak_force=math.inf, crossing_time=math.inf)


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory(_ReadOnly):
    """The motion of every body and the force of every contact, with uncertainty, cost and provenance.

    Arrays are float64 and read-only; their columns of contacts are in the order of :attr:`Scene.contacts`.

    Parameters
    ----------
    time : ndarray, shape (n_t,)
        Times of the samples, s, from 0.
    displacement, velocity : ndarray, shape (n_t, n_body)
        Displacements from the start, m, and velocities, m/s.
    contact_force : ndarray, shape (n_t, n_contact)
        Compressive forces, N.
    peak_force, crossing_time : ndarray, shape (n_contact,)
        Largest force, N, and time of first maximal compression, s (nan: never). They have the accuracy of the run, not
        that of the sample spacing.
    uncertainty : Uncertainty
        Estimated error of each quantity; inf where no estimate exists.
    cost : Cost
        Times, steps and force evaluations of the run.
    provenance : mapping
        Versions, settings and hashes of the run.

    Examples
    --------
    >>> import dem_bridge as db
    >>> pair = db.Scene(name="pair", duration=1e-4, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=4)
    >>> run = db.solve(pair, backend="scipy")
    >>> run.velocity.shape, f"{run.peak_force[0]:.1f} N"
    ((5, 2), '252.4 N')
    """

    time: Floats
    displacement: Floats
    velocity: Floats
    contact_force: Floats
    peak_force: Floats
    crossing_time: Floats
    uncertainty: Uncertainty = UNKNOWN
    cost: Cost
    provenance: Mapping[str, Any]

    def __post_init__(self) -> None:
        check_arguments(type(self), vars(self))
        arrays = {name: constant_doubles(name, getattr(self, name)) for name in ("time", *VOCABULARY)}
        last = {name: (0, *array.shape)[-1] for name, array in arrays.items()}
        n_t, n_body, n_contact = last["time"], last["velocity"], last["peak_force"]
        sizes = {"time": n_t, "body": n_body, "contact": n_contact}
        for name, array in arrays.items():
            dims = VOCABULARY[name][2] if name in VOCABULARY else ("time",)
            if array.shape != (expected := tuple(sizes[d] for d in dims)):
                raise UsageError(f"{name} has shape {array.shape}; a trajectory needs {expected}")
            object.__setattr__(self, name, array)
        object.__setattr__(self, "uncertainty", self.uncertainty.of_contacts(n_contact))
        object.__setattr__(self, "provenance", MappingProxyType(dict(self.provenance)))

    def __str__(self) -> str:
        """Return ten lines: backend, scene, time step, samples, cost and uncertainties."""
        from dem_bridge.foundation.notebook import trajectory_text

        return trajectory_text(self, *self._scales_and_units())

    __repr__ = __str__

    def _repr_html_(self) -> str:
        """Return the card of a notebook: backend, scene, uncertainty and cost."""
        from dem_bridge.foundation.notebook import trajectory_html
        from dem_bridge.trajectory.shown import picture_of_run

        return trajectory_html(self, *self._scales_and_units(), picture_of_run(self))

    def _scales_and_units(self) -> tuple[dict[str, Any], dict[str, str]]:
        """Return the scale and the unit of each quantity that has an uncertainty."""
        sampled = {name: np.max(np.abs(getattr(self, name)), initial=0.0) for name in ("velocity", "displacement")}
        contacts = {name: own_scale(getattr(self, name)) for name in ("peak_force", "crossing_time")}
        return sampled | contacts, {name: VOCABULARY[name][0] for name in QUANTITIES}

    @property
    def restitution(self) -> float:
        """Speed of separation where the contact opens over the speed of approach; nan where nothing rebounds.

        A contact opens at zero overlap, or before if its net force is clipped. Of several impacts it is the first.
        Raises UsageError for other scenes than two bodies in free space, or one body and a wall.
        """
        from dem_bridge.trajectory.restitution import restitution

        n_body, n_contact = self.velocity.shape[1], len(self.peak_force)
        if n_contact != 1:
            raise UsageError(
                f"the restitution of a run with {n_body} bodies and {n_contact} contacts is not defined; allowed: two"
                " bodies, or one body and one wall; read run.velocity instead"
            )
        facts = self.provenance.get("impact")
        if facts is None:
            raise UsageError(
                "the restitution of this run is unknown: the scene has a drive, or a clipped contact law that is a"
                " function, or the run was read from another program's file; read run.velocity instead"
            )
        return restitution(self.time, self.displacement, self.velocity, float(self.crossing_time[0]), facts)

    def to_xarray(self) -> xr.Dataset:
        """Return a labelled dataset: dimensions time, body and contact, units as attributes, ``*_uncertainty``."""
        import xarray as xr

        return xr.Dataset(self._variables(), coords=self._coordinates(), attrs=self._attributes())

    def to_pandas(self, table: str = "bodies") -> DataFrame:
        """Return the samples as a table with a row for each time and body, or for each time and contact.

        Parameters
        ----------
        table : {"bodies", "contacts"}
            "bodies" has the columns time_s, body, displacement_m and velocity_m_per_s; "contacts" has time_s, contact,
            force_N and, the same at all times of a contact, peak_force_N and crossing_time_s.

        Raises
        ------
        UsageError
            If there is no such table.

        Examples
        --------
        >>> import dem_bridge as db
        >>> run = db.solve("accelerating-40", backend="verlet", dt=1e-6, samples=10, uncertainty=False)
        >>> run.to_pandas("bodies").head(2).velocity_m_per_s.tolist(), len(run.to_pandas("contacts"))
        ([0.8, 0.0], 440)
        """
        from dem_bridge.trajectory.shown import table_of_run

        return table_of_run(self, table)

    def plot(self, figure: str = "spacetime", ax: Any = None, **settings: Any) -> Any:
        """Draw the run by a function of :mod:`dem_bridge.plot`, and return the matplotlib Axes.

        Parameters
        ----------
        figure : {"spacetime", "velocity", "residence"}
            The function: velocity of all bodies as colours, velocities of some bodies, or residence times.
        ax : Axes, optional
            Axes to draw on; the default is a new figure.
        **settings
            Further arguments of the function, such as ``until`` or ``bodies``.

        Raises
        ------
        UsageError
            If there is no such figure, or the function refuses a setting.

        Examples
        --------
        >>> import dem_bridge as db
        >>> db.solve("accelerating-40", backend="bca").plot("velocity", bodies=[40]).get_ylabel()
        'velocity (m/s)'
        """
        from dem_bridge.trajectory.shown import plot_run

        return plot_run(self, figure, ax, settings)

    def _variables(self) -> dict[str, Any]:
        """Return dimensions, values and attributes of each variable of a file."""
        data: dict[str, Any] = {
            name: (dims, getattr(self, name), {"units": unit, "long_name": meaning})
            for name, (unit, meaning, dims) in VOCABULARY.items()
        }
        for name, value in self.uncertainty.items():
            about = {"units": VOCABULARY[name][0], "long_name": f"uncertainty of {name}"}
            data[f"{name}_uncertainty"] = (("contact",) if np.ndim(value) else (), value, about)
        return data

    def _coordinates(self) -> dict[str, Any]:
        """Return dimensions, values and attributes of time, body and contact."""
        bodies, contacts = np.arange(self.velocity.shape[1]), np.arange(len(self.peak_force))
        joined = "contact: k joins body k and k + 1, then wall_left, wall_right"
        return {
            "time": (("time",), self.time, {"units": "s", "long_name": "time"}),
            "body": (("body",), bodies, {"long_name": "body, 0 is the struck end"}),
            "contact": (("contact",), contacts, {"long_name": joined}),
        }

    def _attributes(self) -> dict[str, str]:
        """Return the attributes of a file: schema, provenance, cost and how the uncertainty was found."""
        return {
            "schema": SCHEMA,
            "provenance": json.dumps(dict(self.provenance), sort_keys=True),
            "cost": json.dumps(cost_as_json(self.cost)),
            "uncertainty": json.dumps(self.uncertainty.as_json()),
        }

    def save(self, path: str | Path) -> None:
        """Write a netCDF-4 file, which appears complete or not at all.

        Raises
        ------
        UsageError
            If the file cannot be written.
        """
        from dem_bridge.foundation.netcdf import netcdf_bytes

        check_arguments(Trajectory.save, {"self": self, "path": path})
        path = Path(path)
        check_file(path)
        content = netcdf_bytes(self._coordinates() | self._variables(), self._attributes())
        write_whole(path.parent, {path.name: content})


def cost_as_json(cost: Cost) -> dict[str, Any]:
    """Return the cost as JSON types; nan becomes null."""
    return {name: None if value != value else value for name, value in asdict(cost).items()}


def cost_from_json(cost: Mapping[str, Any]) -> Cost:
    """Return the cost from the result of :func:`cost_as_json`."""
    numbers: dict[str, Any] = {name: math.nan if value is None else value for name, value in cost.items()}
    if not all(isinstance(value, int | float) for value in numbers.values()):
        raise TypeError("the cost has a value that is no number")
    return Cost(**numbers)


def load_trajectory(path: str | Path) -> Trajectory:
    """Read a file that :meth:`Trajectory.save` wrote.

    Parameters
    ----------
    path : str or Path
        A netCDF-4 file.

    Returns
    -------
    Trajectory
        The run with its uncertainty, cost and provenance.

    Raises
    ------
    UsageError
        If the file is missing, is of another kind, or has another version of the schema.

    Examples
    --------
    >>> import dem_bridge as db
    >>> db.load_trajectory("missing.nc")
    Traceback (most recent call last):
    dem_bridge.errors.UsageError: missing.nc: no such file; allowed: a .nc file written by Trajectory.save
    """
    from dem_bridge.foundation.netcdf import read_netcdf

    check_arguments(load_trajectory, locals())
    path = Path(path)
    if not is_path(path) or not path.exists():
        raise UsageError(f"{path}: no such file; allowed: a .nc file written by Trajectory.save")
    try:
        contents = read_netcdf(path)
    except UsageError as error:
        raise UsageError(f"{path}: not a netCDF-4 file that can be read: {error}") from error
    schema = contents.attributes.get("schema", "none")
    if schema not in (PREVIOUS, SCHEMA):
        raise UsageError(f"{path}: {schema_fault(schema, PREVIOUS, SCHEMA)}")
    try:
        return _from_contents(contents)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, RecursionError, MemoryError) as error:
        raise UsageError(f"{path}: a part is missing or wrong ({error}); write it again") from error


def _from_contents(contents: Contents) -> Trajectory:
    """Return the trajectory of a file; raise an exception if a part is missing or has another form."""
    arrays = {variable.name: variable.values for variable in contents.variables}
    about = {name: json.loads(str(contents.attributes[name])) for name in ("cost", "provenance")}
    suffix, parts = "bar", UNKNOWN.as_json()
    if contents.attributes["schema"] != PREVIOUS:
        suffix, parts = "uncertainty", json.loads(str(contents.attributes["uncertainty"]))
    forms = {"scene": str, "backend": str, "settings": dict}
    provenance = about["provenance"]
    if (
        not all(isinstance(provenance.get(key, form()), form) for key, form in forms.items())
        or arrays["velocity"].ndim != 2
    ):
        raise TypeError("the provenance has another form, or the velocity not two dimensions")
    return Trajectory(
        **{name: arrays[name] for name in ("time", *VOCABULARY)},
        uncertainty=Uncertainty.from_json({name: arrays[f"{name}_{suffix}"] for name in QUANTITIES}, parts),
        cost=cost_from_json(about["cost"]),
        provenance=provenance,
    )
