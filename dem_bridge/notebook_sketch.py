"""A chain as a small SVG: bodies to scale, contacts by their stiffness, from blue (soft) to orange (stiff)."""

from __future__ import annotations

import math
from collections.abc import Sequence

#: bodies drawn, pixels of the whole and of the largest body's half height
_MOST, _WIDTH, _HALF = 100, 680.0, 18.0
#: of the Okabe-Ito set, through a grey that is seen on white and on black
_SOFT, _MIDDLE, _STIFF = (0, 114, 178), (150, 150, 150), (230, 159, 0)


def sketch(
    outlines: Sequence[tuple[float, float]],
    stiffness: Sequence[float],
    *,
    moving: Sequence[bool],
    walls: tuple[bool, bool],
    unit: str,
) -> str:
    """``outlines``: half width and half height of each body, in any unit: round where they are equal. ``stiffness``:
    of the contacts between them, in ``unit``; ``moving``: at the start; ``walls``: on the left, on the right.

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
        ink = f'fill="currentColor" fill-opacity="{0.55 if moves else 0.12}" stroke="currentColor" stroke-width=".7"'
        if wide == high:
            parts.append(f'<ellipse cx="{x + a:.1f}" cy="{middle:.1f}" rx="{a:.1f}" ry="{b:.1f}" {ink}/>')
        else:
            parts.append(f'<rect x="{x:.1f}" y="{middle - b:.1f}" width="{2 * a:.1f}" height="{2 * b:.1f}" {ink}/>')
        x += 2.0 * a
        touch.append((x, min(b, scale * half)))
    if walls[1] and len(shown) == len(outlines):
        parts.append(_upright(x, middle, scale * half + 2.0, 4.0, "currentColor"))
    width = max(1.5, min(5.0, 0.5 * scale * min(wide for wide, _ in shown)))
    for (at, high), beta in zip(touch, stiffness, strict=False):
        if len(touch) > 1 and at < x:
            parts.append(_upright(at, middle, 0.8 * high, width, _colour(beta, stiffness)))
    told = f"filled: moving at the start; contacts from blue (soft) to orange (stiff), {unit}"
    if len(shown) < len(outlines):
        told = f"the first {len(shown)} of {len(outlines)} bodies; {told}"
    size = f'width="{x + 6.0:.0f}" height="{2.0 * middle:.0f}"'
    svg = f'<svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label="{told}" {size}>{"".join(parts)}</svg>'
    return f'<div style="margin:.5em 0">{svg}<div style="opacity:.75;font-size:85%">{told}</div></div>'


def _upright(x: float, middle: float, half: float, width: float, colour: str) -> str:
    ends = f'x1="{x:.1f}" y1="{middle - half:.1f}" x2="{x:.1f}" y2="{middle + half:.1f}"'
    return f'<line {ends} stroke="{colour}" stroke-width="{width:.1f}"/>'


def _colour(beta: float, among: Sequence[float]) -> str:
    low, high = math.log(min(among)), math.log(max(among))
    part = (math.log(beta) - low) / (high - low) if high > low else 0.5
    ends, at = ((_SOFT, _MIDDLE), 2.0 * part) if part < 0.5 else ((_MIDDLE, _STIFF), 2.0 * part - 1.0)
    mixed = (round(one + at * (other - one)) for one, other in zip(*ends, strict=True))
    return f"rgb({','.join(map(str, mixed))})"
