"""HTML for notebooks: scenes, trajectories, verifications, plans and studies, with small SVGs of chains and histograms.

The HTML has inline styles and no scripts. Text has the colour of the page, so that it is readable on light and dark
pages; coloured words have a background of their own. Contacts of a chain are coloured by stiffness from blue (soft) to
orange (stiff). The classes call this module in ``_repr_html_`` and the module imports none of them, so its arguments
have the type Any.
"""

from __future__ import annotations

import base64
import io
import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.foundation.wording import MOST_LINES, summary

_PREFIXES = {-15: "f", -12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
#: largest number of bodies that are listed one by one, and of rows of a table
_LISTED, _ROWS = 3, 200
_HASH = 12
#: width of the names of facts on a terminal; resolution of a picture, dots per inch
_KEY, _DOTS = 17, 80


def quantity(value: float, unit: str, digits: int = 3) -> str:
    """Return a number with its unit and an SI prefix, or a power of ten if no prefix fits.

    >>> quantity(8.1e-3, "kg"), quantity(3e-3, "s"), quantity(0.0, "m"), quantity(4e9, "N/m^1.5"), quantity(1e-19, "m")
    ('8.1 g', '3 ms', '0 m', '4e+09 N/m^1.5', '1e-19 m')
    >>> quantity(float("inf"), "m/s"), quantity(-2.5e-6, "m"), quantity(999.9e-6, "s"), quantity(1.8e-10, "m", 2)
    ('unknown', '-2.5 µm', '1 ms', '180 pm')
    """
    if not math.isfinite(value):
        return "unknown"
    if unit == "kg" and abs(value) < 1.0:
        return quantity(1e3 * value, "g", digits)
    rounded = float(f"{value:.{digits}g}")
    # velocities below 1 m/s keep the unit m/s: 0.8 m/s, not 800 mm/s
    power = 3 * math.floor((math.log10(abs(rounded)) + (unit == "m/s")) / 3.0) if rounded else 0
    if unit not in ("m", "s", "g", "N", "m/s") or power not in _PREFIXES:
        return f"{value:.{digits}g} {unit}".strip()
    return f"{float(f'{value / 10.0**power:.{digits}g}'):g} {_PREFIXES[power]}{unit}"


def spread(values: Iterable[float], unit: str) -> str:
    """Return the range of values as text, or the value if all are equal.

    >>> spread([8.1e-3, 10.1e-3], "kg"), spread([0.8, 0.8], "m/s"), spread([], "m"), spread([2.4, 2.5], "")
    ('8.1 g to 10.1 g', '0.8 m/s', 'none', '2.4 to 2.5')
    """
    distinct = sorted(set(values))
    if not distinct:
        return "none"
    ends = [quantity(value, unit) for value in (distinct[0], distinct[-1])]
    return ends[0] if ends[0] == ends[1] else f"{ends[0]} to {ends[1]}"


def _unit_of_stiffness(scene: Any) -> str:
    """Return the unit of the stiffness of all contacts of a Scene."""
    n = set(scene.contacts.exponent.tolist())
    return f"N/m^{next(iter(n)) - 1.0:g}" if len(n) == 1 else "N/m^(n-1)"


def scene_sketch(scene: Any) -> str:
    """Return the HTML of a sketch of a Scene."""
    return sketch(
        _outlines(scene),
        scene.contacts.stiffness[: scene.n_body - 1].tolist(),
        moving=[v != 0.0 for v in scene.velocity],
        walls=(scene.wall_left is not None, scene.wall_right is not None),
        unit=_unit_of_stiffness(scene),
    )


def scene_text(scene: Any) -> str:
    """Return a Scene in ten lines for a terminal: its properties."""
    return summary((), _aligned(_scene_facts(scene)), title=f"Scene {scene.name}")


def scene_html(scene: Any) -> str:
    """Return the HTML of a Scene: a sketch of the chain and its properties."""
    title = f"Scene {scene.name}"
    return _card(title, subtitle=scene.description, sketch=scene_sketch(scene), facts=_scene_facts(scene))


def contacts_text(contacts: Any) -> str:
    """Return Contacts in five lines for a terminal."""
    c = contacts
    unit = f"N/m^{c.exponent[0] - 1.0:g}" if len(set(c.exponent.tolist())) == 1 else "N/m^(n-1)"
    facts = {
        "stiffness": spread(c.stiffness.tolist(), unit),
        "exponent n": spread(c.exponent.tolist(), ""),
        "gap": spread(c.gap.tolist(), "m"),
        "damping": f"{int((c.damping > 0.0).sum())} of them",
    }
    return summary((), _aligned(facts), title=f"{len(c.gap)} contacts (arrays: contacts.stiffness, ...)")


def geometry_text(geometry: Any) -> str:
    """Return a Geometry in at most three lines for a terminal."""
    shapes = Counter(body.shape for body in geometry.bodies)
    kinds = ", ".join(f"{count} {shape}{'s' if count > 1 else ''}" for shape, count in shapes.items())
    facts = {"radius": spread((body.radius for body in geometry.bodies), "m")}
    if geometry.angles is not None:
        angles = [angle for angle in geometry.angles if angle is not None]
        facts["angles"] = f"{spread(angles, 'degrees')}, law of the stiffness: {geometry.law}"
    return summary((), _aligned(facts), title=f"Geometry of {kinds} (list: geometry.bodies)")


def _aligned(facts: Mapping[str, str]) -> list[str]:
    """Return a line for each fact."""
    return [f"{key:{_KEY}} {value}" for key, value in facts.items()]


def _scene_facts(scene: Any) -> dict[str, str]:
    """Return the properties of a Scene as texts."""
    c, walls = scene.contacts, [side for side in ("left", "right") if getattr(scene, f"wall_{side}") is not None]
    n, unit = set(c.exponent.tolist()), _unit_of_stiffness(scene)
    near = " (approximates the contact laws)" if scene.law is not None else ""
    facts = {
        "bodies": f"{scene.n_body}, mass {spread(scene.mass, 'kg')}",
        "contacts": f"{scene.n_contact}"
        + (f", {len(walls)} of them with a wall ({', '.join(walls)})" if walls else ""),
        "stiffness": f"{spread(c.stiffness.tolist(), unit)}{near}",
        "exponent n": f"{spread(n, '')} (force is proportional to overlap^(n-1)){near}",
        "gap": f"{spread(c.gap.tolist(), 'm')}" + (" (negative: initial overlap)" if (c.gap < 0.0).any() else ""),
        "initial velocity": _start(scene.velocity),
        "further physics": "; ".join(_acting(scene)) or "none",
        "duration": f"{quantity(scene.duration, 's')}, sampled every {quantity(scene.duration / scene.samples, 's')}"
        f" ({scene.samples} intervals)",
        "hash": scene.content_hash[:_HASH],
    }
    if scene.geometry is not None:
        shapes = Counter(body.shape for body in scene.geometry.bodies)
        radii = spread((body.radius for body in scene.geometry.bodies), "m")
        kinds = ", ".join(f"{count} {shape}{'s' if count > 1 else ''}" for shape, count in shapes.items())
        facts["bodies"] += f": {kinds}, radius {radii}"
    return facts


def _run_facts(run: Any) -> dict[str, str]:
    """Return how a Trajectory was made: backend, scene, time step, samples and cost."""
    provenance, settings = run.provenance, run.provenance.get("settings", {})
    step, cost = settings.get("dt"), run.cost
    spent = [f"{quantity(value, 's')} {name}" for name, value in (("wall", cost.wall), ("CPU", cost.cpu))]
    return {
        "backend": f"{provenance.get('backend', 'unknown')} ({provenance.get('equations', 'equations unknown')})",
        "scene": f"{provenance.get('scene', 'unknown')}, hash {str(provenance.get('scene_hash', 'unknown'))[:_HASH]}",
        "time step": "no fixed time step" if step is None else quantity(step, "s"),
        "samples": f"{len(run.time)} times from 0 to {quantity(float(run.time[-1]), 's')},"
        f" {run.velocity.shape[1]} bodies, {len(run.peak_force)} contacts",
        "cost": f"{', '.join(spent)}, {cost.steps} time steps, {cost.force_evaluations} force evaluations",
    }


def _uncertainty_rows(
    run: Any, scales: Mapping[str, Any], units: Mapping[str, str]
) -> Iterable[tuple[str, str, str, str]]:
    """Yield quantity, absolute and relative uncertainty of a Trajectory, and what the latter is relative to."""
    for name, estimate in run.uncertainty.items():
        value, scale = np.atleast_1d(estimate), np.atleast_1d(scales[name])
        present = (scale > 0.0) & (np.isfinite(getattr(run, name)) if np.ndim(estimate) else True)
        if not present.any():
            yield name.replace("_", " "), "no value", "", ""
            continue
        largest, relative = float(value[present].max()), float((value[present] / scale[present]).max())
        yield (
            name.replace("_", " "),
            quantity(largest, units[name], 2),
            f"{relative:.1e}" if math.isfinite(relative) else "unknown",
            f"the largest, {quantity(float(scale[0]), units[name])}"
            if np.ndim(estimate) == 0
            else "the value of each contact (largest ratio)",
        )


def trajectory_text(run: Any, scales: Mapping[str, Any], units: Mapping[str, str]) -> str:
    """Return ten lines on a Trajectory for a terminal: how it was made, and its uncertainties."""
    lines = [f"Trajectory of {run.provenance.get('scene', 'an unknown scene')}"]
    lines += [f"  {key:14} {value}" for key, value in _run_facts(run).items()]
    for name, absolute, relative, scale in _uncertainty_rows(run, scales, units):
        lines.append(f"  {name:14} uncertainty {absolute}" + (f", {relative} of {scale}" if relative else ""))
    return "\n".join(lines)


def ensemble_html(facts: Mapping[str, str], quantiles: Sequence[tuple[str, str, str, str]], drawing: str) -> str:
    """Return the HTML of an Ensemble: what varies, the quantiles of its observables, and a histogram."""
    return _card("Ensemble", facts=facts, quantiles=quantiles, drawing=drawing)


def trajectory_html(run: Any, scales: Mapping[str, Any], units: Mapping[str, str], drawing: str = "") -> str:
    """Return the HTML of a Trajectory: settings, cost, uncertainties and provenance.

    ``scales`` has the scale of each uncertainty, a number or an array over contacts, and ``units`` the unit.
    """
    provenance = "\n".join(f"{key}: {_plain(value)}" for key, value in run.provenance.items())
    rows = tuple(_uncertainty_rows(run, scales, units))
    facts = _run_facts(run)
    return _card("Trajectory", facts=facts, uncertainties=rows, provenance=provenance, drawing=drawing)


def plan_text(plan: Any) -> str:
    """Return at most 15 lines on a Plan for a terminal: settings, error, cost, and as many reasons as fit."""
    facts = _aligned(_plan_facts(plan))
    return "\n".join([f"Plan for {plan.scene}", *(f"  {fact}" for fact in facts), *_reasons(plan, len(facts))])


def _reasons(plan: Any, before: int) -> list[str]:
    """Return the lines of the reasons of a Plan that fit below others."""
    lines = summary(plan.reasons).splitlines()
    room = MOST_LINES - 1 - before
    return lines if len(lines) <= room else [*lines[: room - 1], "  ... (all: plan.reasons)"]


def plan_html(plan: Any) -> str:
    """Return the HTML of a Plan: settings, predicted and measured error and cost, and reasons."""
    return _card("Plan", facts=_plan_facts(plan), reasons=plan.reasons)


def _plan_facts(plan: Any) -> dict[str, str]:
    """Return settings, error and cost of a Plan as texts."""
    settings = ", ".join(f"{key}={value!r}" for key, value in plan.resolution.items()) or "default settings"
    facts = {
        "scene": plan.scene,
        "accuracy": f"{plan.accuracy:g} of {plan.observable}",
        "backend": plan.backend,
        "settings": f"{settings} (SI)",
        "error": f"{plan.predicted_error:.2g} predicted"
        + ("" if plan.found_error is None else f", {plan.found_error:.2g} measured"),
        "cost": f"{quantity(plan.predicted_cost, 's')} of CPU predicted"
        + ("" if plan.found_cost is None else f", {quantity(plan.found_cost, 's')} measured"),
        "time steps": "unknown before the run" if plan.steps is None else str(plan.steps),
    }
    if plan.units:
        parts = [f"{value:.2g} of {name.replace('_', ' ')}" for name, value in plan.units.items() if name != "dt"]
        facts["time step"] = ", ".join([quantity(plan.units["dt"], "s"), *parts])
    return facts


def study_html(study: Any, drawing: str = "") -> str:
    """Return the HTML of a Study: its answer, the verdicts by outcome, its first figure, and its tables."""
    counts = Counter(verdict.outcome.value for verdict in study.verdicts)
    state = "interrupted: only the results up to the interruption are shown" if study.interrupted else ""
    return _card(study.title, subtitle=state, study=study, counts=counts, most_rows=_ROWS, drawing=drawing)


def picture(figure: Any, description: str) -> str:
    """Return the HTML of a figure of matplotlib: a PNG within the text, which needs no other file."""
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=_DOTS)
    data = base64.b64encode(content.getvalue()).decode()
    style = "max-width:100%;height:auto;margin:.4em 0;border-radius:.2em"
    return f'<img src="data:image/png;base64,{data}" alt="{escape(description)}" style="{style}"/>'


@cache
def template() -> Any:
    """Return the template of all cards."""
    from jinja2 import Environment, PackageLoader  # only notebooks need it

    environment = Environment(loader=PackageLoader(__package__, "."), autoescape=True, trim_blocks=True)
    return environment.get_template("notebook.html.j2")


def _card(title: str, **parts: Any) -> str:
    """Return a frame with a title and the parts that the template knows."""
    return str(template().render(title=title, **parts)).strip()


def _plain(value: object) -> str:
    """Return a value as text."""
    return value if isinstance(value, str) else json.dumps(value, default=str, ensure_ascii=False)


def _start(velocity: Sequence[float]) -> str:
    """Return the initial velocities as text."""
    moving = [(body, v) for body, v in enumerate(velocity) if v != 0.0]
    if not moving:
        return "all bodies at rest"
    if len(moving) > _LISTED:
        return f"{len(moving)} bodies move, {spread([v for _, v in moving], 'm/s')}"
    listed = ", ".join(f"body {body} at {v:g} m/s" for body, v in moving)
    return listed + ("" if len(moving) == len(velocity) else ", all others at rest")


def _acting(scene: Any) -> Iterable[str]:
    """Yield the parts of the physics beyond elastic contacts."""
    if scene.gravity != 0.0:
        yield f"gravity {scene.gravity:g} m/s² ({'towards' if scene.gravity > 0.0 else 'away from'} the last body)"
    if scene.precompression > 0.0:
        yield f"precompression {quantity(scene.precompression, 'N')}"
    if scene.damping is not None and scene.damped:
        units = {"dashpot": "N s/m", "mass_velocity": "1/s", "kuwabara-kono": "s"}
        coefficient = spread(scene.damping.coefficient, units.get(scene.damping.law, ""))
        clip = "" if scene.damping.clip else ", not clipped"
        yield f"damping by the law {scene.damping.law}, coefficient {coefficient}{clip}"
    if scene.adhesion is not None and scene.adhesive:
        yield f"{scene.adhesion.law.upper()} adhesion, pull-off force {spread(scene.adhesion.pull_off, 'N')}"
    if scene.drag > 0.0:
        yield f"drag {scene.drag:g} 1/s"
    if scene.drive is not None:
        yield f"drive of body 0 by a {scene.drive.words}"
    if scene.law is not None:
        yield f"contact laws that are functions ({len(set(map(id, scene.law)))})"


def _outlines(scene: Any) -> list[tuple[float, float]]:
    """Return half the width and half the height of each body, in any unit."""
    if scene.geometry is not None:
        return [(b.radius, b.radius if b.height is None else 0.5 * b.height) for b in scene.geometry.bodies]
    radii = [float(mass) ** (1.0 / 3.0) for mass in scene.mass]
    return [(radius, radius) for radius in radii]


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
