"""Colours of maps: one with even lightness for values, one with a white middle for signed errors; and their limits.

Both can be told apart by colour-blind readers. Pages and pictures use the same colours.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dem_bridge.report.study import Map

#: colours at equal distances, from the least to the largest value: cividis of matplotlib
SEQUENTIAL = (
    "#00224e", "#002c64", "#0c3470", "#273e6e", "#38476c", "#46516c", "#535a6d", "#5f636f", "#6b6d72", "#777776",
    "#828079", "#908b78", "#9c9576", "#aaa073", "#b8aa6e", "#c6b667", "#d4c15f", "#e4ce53", "#f2da44", "#fee838",
)  # fmt: skip
#: colours of signed values: blue below zero, white at zero, orange above; the Okabe-Ito blue and vermilion, darkened
DIVERGING = ("#003d66", "#0072b2", "#7ab8e0", "#f7f7f7", "#f2a46f", "#d55e00", "#7a2e00")


def rgb(colours: Sequence[str], fractions: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return the colours (..., 3) at fractions of a scale, which is 0 for the first colour and 1 for the last.

    >>> rgb(DIVERGING, np.array([0.0, 0.5, 2.0])).tolist()
    [[0, 61, 102], [247, 247, 247], [122, 46, 0]]
    """
    stops = np.array([[int(colour[at : at + 2], 16) for at in (1, 3, 5)] for colour in colours], dtype=float)
    places = np.clip(fractions, 0.0, 1.0) * (len(stops) - 1)
    return np.stack(
        [np.rint(np.interp(places, np.arange(len(stops)), stops[:, part])) for part in range(3)], axis=-1
    ).astype(np.uint8)


def colour_limits(maps: Sequence[Map]) -> tuple[float, float, str]:
    """Return the smallest and the largest value of a colour scale for all maps, and the ends that values exceed.

    The extreme values of 19 of 20 columns lie within the scale. A percentile of all values would depend on how much of
    a map is at rest.
    """
    tops, bottoms = [], []
    for data in maps:
        finite = np.where(np.isfinite(data.values), data.values, np.nan)
        full = finite[:, np.isfinite(finite).any(axis=0)]
        if full.size:
            tops.append(np.nanmax(full, axis=0))
            bottoms.append(np.nanmin(full, axis=0))
    if not tops:
        return 0.0, 1.0, "neither"
    high, low = np.concatenate(tops), np.concatenate(bottoms)
    top, bottom = float(np.percentile(high, 95.0)), float(np.percentile(low, 5.0))
    if any(data.diverging for data in maps):
        top = max(abs(top), abs(bottom))
        bottom = -top
    if not top > bottom:
        top, bottom = float(high.max()), float(low.min())
    if not top > bottom:
        top = bottom + 1.0
    step = (top - bottom) / 256.0  # one of 256 colours; smaller excesses are invisible
    ends = (float(low.min()) < bottom - step, float(high.max()) > top + step)
    extend = {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}[ends]
    return bottom, top, extend
