"""The result of an ensemble: observables of every chain, quantiles, and the agreement of a sample with other codes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dem_bridge.ensembles.draw import Variation
from dem_bridge.ensembles.solve import OBSERVABLES
from dem_bridge.errors import UsageError
from dem_bridge.foundation.notebook import ensemble_html, histogram, quantity
from dem_bridge.foundation.wording import summary
from dem_bridge.observables.registry import OBSERVABLES as REGISTRY
from dem_bridge.trajectory.trajectory import Floats

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

_UNITS = {name: REGISTRY[name].unit for name in OBSERVABLES}


@dataclass(frozen=True, kw_only=True, eq=False)
class Ensemble:
    """Observables of many chains that differ in numbers only; :func:`dem_bridge.ensemble` returns it.

    Parameters
    ----------
    variation : Variation
        The intended chain, what varies, and the seed.
    values : mapping
        Observable -> values, ``(n_chain,)``, ``(n_chain, n_body)`` or ``(n_chain, n_contact)``; with samples
        also "velocity", ``(n_chain, n_sample + 1, n_body)``. Large arrays are files in a temporary folder that is
        deleted with this object.
    accuracy : float
        Relative accuracy that was asked for.
    steps : int
        Steps of each chain.
    checked : DataFrame
        A row for each chain of the sample, code and observable: ``chain``, ``code``, ``observable``,
        ``difference`` (largest, relative to each value's own scale), ``uncertainty`` (of that code, on the same
        scale; inf: not estimated) and ``failure`` (why that code has no run; empty otherwise).
    """

    variation: Variation
    values: Mapping[str, Floats]
    accuracy: float
    steps: int
    checked: pd.DataFrame

    def __len__(self) -> int:
        return len(self.values["arrival_at_end"])

    def __repr__(self) -> str:
        vary = ", ".join(f"{key} {value:g}" for key, value in self.variation.vary.items())
        return f"<Ensemble of {len(self)} chains of {self.variation.scene.name}: {vary}; {self.agreement}>"

    def __str__(self) -> str:
        """Return at most 15 lines: the median and the quantiles of observables of the whole chain, and the check."""
        rows = [f"{name}: {median} ({low} to {high})" for name, low, median, high in self._shown_quantiles()]
        title = f"{len(self)} chains of {self.variation.scene.name} (median; 5 % to 95 %)"
        return summary([*rows, f"check: {self.agreement}"], title=title)

    def _repr_html_(self) -> str:
        arrival = self.values["arrival_at_end"]
        drawing = histogram(1e6 * arrival[np.isfinite(arrival)], "arrival at the last body (µs)")
        vary = ", ".join(f"{key} {value:g}" for key, value in self.variation.vary.items())
        facts = {"chains": f"{len(self)} of {self.variation.scene.name}", "varied": vary, "check": self.agreement}
        return ensemble_html(facts, self._shown_quantiles(), drawing)

    def _shown_quantiles(self) -> list[tuple[str, str, str, str]]:
        """Return name, 5 %, median and 95 % of each observable that has one value a chain."""
        names = [name for name, values in self.values.items() if values.ndim == 1]
        rows = []
        for name in names:
            low, median, high = (quantity(float(part), _UNITS[name], 4) for part in self.quantiles(name))
            rows.append((name.replace("_", " "), low, median, high))
        return rows

    @property
    def agreement(self) -> str:
        """Agreement of the sample with the other codes, in one sentence."""
        parts = []
        for code, rows in self.checked.groupby("code", sort=False):
            failures = rows[rows["failure"] != ""]
            if len(failures):
                parts.append(f"{code} has no run of {failures['chain'].nunique()} chains")
            if len(failures) < len(rows):
                chains = rows[rows["failure"] == ""]["chain"].nunique()
                parts.append(f"{chains} chains by {code} differ by at most {rows['difference'].max():.1e}")
            beyond = rows[rows["difference"] > self.accuracy + rows["uncertainty"]]
            if len(beyond):
                names = ", ".join(beyond["observable"].unique())
                parts.append(
                    f"{beyond['chain'].nunique()} of these chains disagree: {names} differ by more than the accuracy"
                    f" {self.accuracy:g} and the uncertainty of {code}"
                )
        return "; ".join(parts) or "no chain was checked by another code"

    def quantiles(self, observable: str, q: Sequence[float] = (0.05, 0.5, 0.95)) -> Floats:
        """Return quantiles over the chains.

        Parameters
        ----------
        observable : str
            A key of ``values``.
        q : sequence of float
            Parts of the chains, 0 to 1.

        Returns
        -------
        ndarray
            ``(len(q), ...)``, with the axes of the observable; chains without a value are left out.

        Raises
        ------
        UsageError
            For an observable that the ensemble does not have, or a part outside 0 to 1.
        """
        if observable not in self.values:
            raise UsageError(f"observable = {observable!r}; allowed: {', '.join(self.values)}")
        if not all(0.0 <= part <= 1.0 for part in q):
            raise UsageError(f"q = {tuple(q)!r}; allowed: numbers from 0 to 1")
        values = self.values[observable]
        out = np.full((len(q), math.prod(values.shape[1:])), np.nan)
        # column by column, so that memory does not grow with the number of chains times columns
        for column, place in enumerate(np.ndindex(values.shape[1:])):
            present = values[(slice(None), *place)]
            present = present[~np.isnan(present)]
            if len(present):
                out[:, column] = np.quantile(present, q)
        return out.reshape(len(q), *values.shape[1:])

    @property
    def table(self) -> pd.DataFrame:
        """All observables as a pandas frame, a row for each chain; columns such as ``peak_force_7``, SI units."""
        import pandas as pd

        columns: dict[str, Floats] = {}
        for name, axis in OBSERVABLES.items():
            values = self.values[name]
            columns |= {name: values} if not axis else {f"{name}_{k}": values[:, k] for k in range(values.shape[1])}
        frame = pd.DataFrame(columns, index=pd.RangeIndex(len(self), name="chain"))
        frame.attrs = self._attributes | {"units": _UNITS}
        return frame

    @property
    def _attributes(self) -> dict[str, object]:
        """Scene, seed and variation, for the attributes of frames and Datasets."""
        scene = self.variation.scene
        about = {"scene": scene.name, "scene_hash": scene.content_hash, "seed": self.variation.seed}
        return about | {f"vary_{key}": value for key, value in self.variation.vary.items()}

    @property
    def long_table(self) -> pd.DataFrame:
        """All observables as a long pandas frame: ``chain``, ``observable``, ``place`` (-1: the chain), ``value``."""
        import pandas as pd

        parts = []
        for name in OBSERVABLES:
            values = self.values[name].reshape(len(self), -1)
            places = np.arange(values.shape[1], dtype=np.int32) if OBSERVABLES[name] else np.array([-1], dtype=np.int32)
            columns = {
                "chain": np.repeat(np.arange(len(self), dtype=np.int32), values.shape[1]),
                "observable": pd.Categorical([name], OBSERVABLES).repeat(values.size),
                "place": np.tile(places, len(self)),
                "value": values.ravel(),
            }
            parts.append(pd.DataFrame(columns))
        frame = pd.concat(parts, ignore_index=True)
        frame.attrs = self._attributes | {"units": _UNITS}
        return frame

    def to_xarray(self) -> xr.Dataset:
        """Return all values as an xarray Dataset with the dimensions chain, body, contact and sample."""
        import xarray as xr

        data = {}
        for name, values in self.values.items():
            axes = ("sample", "body") if name == "velocity" else (OBSERVABLES[name],) if OBSERVABLES[name] else ()
            data[name] = xr.DataArray(values, dims=("chain", *axes), attrs={"units": REGISTRY[name].unit})
        return xr.Dataset(data, attrs=self._attributes)
