"""Draw small SVGs: a chain, with contacts coloured by stiffness from blue (soft) to orange (stiff), and a histogram."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

#: largest number of bodies; width of the sketch and half height of the largest body, pixels
_MOST, _WIDTH, _HALF = 100, 680.0, 18.0
#: largest number of bars of a histogram
_MOST_BINS = 40
#: two colours of the Okabe-Ito set, and a grey between them that is visible on white and on black
_SOFT, _MIDDLE, _STIFF = (0, 114, 178), (150, 150, 150), (230, 159, 0)


def sketch(
    outlines: Sequence[tuple[float, float]],
    stiffness: Sequence[float],
    *,
    moving: Sequence[bool],
    walls: tuple[bool, bool],
    unit: str,
) -> str:
    """Return the sketch of a chain as HTML.

    Parameters
    ----------
    outlines : sequence of (float, float)
        Half width and half height of each body, in any unit; a body is round if they are equal.
    stiffness : sequence of float
        Stiffness of the contacts between the bodies, in ``unit``.
    moving : sequence of bool
        True for bodies with an initial velocity.
    walls : (bool, bool)
        True for a wall on the left and on the right.
    unit : str
        Unit of the stiffness, for the caption.

    Examples
    --------
    >>> svg = sketch([(1.0, 1.0), (2.0, 3.0)], [4e9], moving=[True, False], walls=(False, True), unit="N/m^1.5")
    >>> svg.count("<ellipse"), svg.count("<rect"), svg.count("<line")
    (1, 1, 2)
    """
    shown = outlines[:_MOST]
    half = max(high for _, high in shown)
    scale = min(_WIDTH / (2.0 * sum(wide for wide, _ in shown)), _HALF / max(half, max(wide for wide, _ in shown)))
    middle, x = scale * half + 3.0, 6.0
    parts, touch = [], []
    if walls[0]:
        parts.append(_upright(x, middle, scale * half + 2.0, 4.0, "currentColor"))
    for (wide, high), moves in zip(shown, moving, strict=False):
        a, b = scale * wide, scale * high
        ink = f'fill="currentColor" fill-opacity="{0.6 if moves else 0.0}" stroke="currentColor" stroke-width=".7"'
        if wide == high:
            parts.append(f'<ellipse cx="{x + a:.1f}" cy="{middle:.1f}" rx="{a:.1f}" ry="{b:.1f}" {ink}/>')
        else:
            parts.append(f'<rect x="{x:.1f}" y="{middle - b:.1f}" width="{2 * a:.1f}" height="{2 * b:.1f}" {ink}/>')
        x += 2.0 * a
        touch.append((x, min(b, scale * half)))
    if walls[1] and len(shown) == len(outlines):
        parts.append(_upright(x, middle, scale * half + 2.0, 4.0, "currentColor"))
    width = max(1.5, min(5.0, 0.5 * scale * min(wide for wide, _ in shown)))
    for (position, high), beta in zip(touch, stiffness, strict=False):
        if len(touch) > 1 and position < x:
            parts.append(_upright(position, middle, 0.8 * high, width, _colour(beta, stiffness)))
    caption = f"filled bodies move at the start; contacts are coloured by stiffness from blue to orange ({unit})"
    if len(shown) < len(outlines):
        caption = f"the first {len(shown)} of {len(outlines)} bodies; {caption}"
    size = f'width="{x + 6.0:.0f}" height="{2.0 * middle:.0f}"'
    svg = f'<svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label="{caption}" {size}>{"".join(parts)}</svg>'
    return f'<div style="margin:.5em 0">{svg}<div style="opacity:.75;font-size:85%">{caption}</div></div>'


def histogram(values: NDArray[np.float64], label: str) -> str:
    """Return a histogram of finite values as HTML; empty for fewer than two.

    Examples
    --------
    >>> svg = histogram(np.array([1.0, 2.0, 2.0, 3.0]), "arrival (ms)")
    >>> svg.count("<rect"), "1 to 3" in svg
    (4, True)
    """
    if len(values) < 2:
        return ""
    counts, edges = np.histogram(values, bins=min(_MOST_BINS, max(4, math.isqrt(len(values)))))
    wide, high = _WIDTH / 2.0 / len(counts), 4.0 * _HALF
    bars = "".join(
        f'<rect x="{k * wide:.1f}" y="{high * (1.0 - count / counts.max()):.1f}" width="{wide - 1.0:.1f}"'
        f' height="{high * count / counts.max():.1f}" fill="rgb{_SOFT}"/>'
        for k, count in enumerate(counts.tolist())
    )
    caption = f"histogram of {len(values)} chains: {label}, {edges[0]:.5g} to {edges[-1]:.5g}"
    size = f'width="{_WIDTH / 2.0:.0f}" height="{high:.0f}"'
    svg = f'<svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label="{caption}" {size}>{bars}</svg>'
    return f'<div style="margin:.5em 0">{svg}<div style="opacity:.75;font-size:85%">{caption}</div></div>'


def _upright(x: float, middle: float, half: float, width: float, colour: str) -> str:
    """Return a vertical line."""
    ends = f'x1="{x:.1f}" y1="{middle - half:.1f}" x2="{x:.1f}" y2="{middle + half:.1f}"'
    return f'<line {ends} stroke="{colour}" stroke-width="{width:.1f}"/>'


def _colour(beta: float, all_stiffness: Sequence[float]) -> str:
    """Return the colour of a stiffness, on a logarithmic scale from the smallest to the largest."""
    low, high = math.log(min(all_stiffness)), math.log(max(all_stiffness))
    part = (math.log(beta) - low) / (high - low) if high > low else 0.5
    ends, fraction = ((_SOFT, _MIDDLE), 2.0 * part) if part < 0.5 else ((_MIDDLE, _STIFF), 2.0 * part - 1.0)
    mixed = (round(start + fraction * (end - start)) for start, end in zip(*ends, strict=True))
    return f"rgb({','.join(map(str, mixed))})"
