"""Keep scenes with their truths in one compressed file: scenes as text, values, and doubts as powers of 2."""

from __future__ import annotations

import json
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from dem_bridge.scene.drive import Drive
from dem_bridge.scene.scene import Adhesion, Damping, Scene, Wall
from tests.helpers.truths import QUANTITIES, Truth

PARTS = {"wall_left": Wall, "wall_right": Wall, "damping": Damping, "adhesion": Adhesion, "drive": Drive}
_FIELDS = ("name", "duration", "mass", "stiffness", "exponent", "velocity", "gap", "gravity", "precompression", "drag")
#: exponents of doubts that are no number: none at all, and not sure
_NONE, _UNSURE = -32768, 32767


def save(path: Path, pairs: list[tuple[Scene, Truth]]) -> None:
    """Keep scenes and truths together; a doubt is rounded up to a power of 2."""
    values = [truth.values[name] for _, truth in pairs for name in QUANTITIES]
    doubts = np.concatenate([truth.doubt[name] for _, truth in pairs for name in QUANTITIES])
    fraction, exponent = np.frexp(np.where(np.isfinite(doubts), doubts, 1.0))
    exponent = np.where(fraction == 0.5, exponent - 1, exponent)
    powers = np.select([doubts == 0.0, ~np.isfinite(doubts)], [_NONE, _UNSURE], exponent).astype(np.int16)
    text = np.frombuffer(json.dumps([_kept_fields(scene) for scene, _ in pairs]).encode(), dtype=np.uint8)
    np.savez_compressed(path, scenes=text, values=np.concatenate(values), doubts=powers)


def load(path: Path, *, samples: int) -> list[tuple[Scene, Truth]]:
    """Return the scenes of a file, with this number of samples where they name none, and their truths."""
    with np.load(path) as data:
        lines, numbers, powers = json.loads(data["scenes"].tobytes()), data["values"], data["doubts"]
    doubts = np.select(
        [powers == _NONE, powers == _UNSURE],
        [0.0, np.inf],
        np.ldexp(1.0, np.clip(powers, -1074, 1023).astype(np.int64)),
    )
    pairs, at = [], 0
    for parts in lines:
        scene = _scene_of({"samples": samples, **parts})
        ends = at + np.cumsum([0, scene.n_body, scene.n_body, scene.n_contact, scene.n_contact])
        blocks = [slice(first, last) for first, last in pairwise(ends.tolist())]
        at = int(ends[-1])
        values, doubt = (
            {name: kept[block] for name, block in zip(QUANTITIES, blocks, strict=True)} for kept in (numbers, doubts)
        )
        pairs.append((scene, Truth(values, doubt)))
    return pairs


def _scene_of(parts: dict[str, Any]) -> Scene:
    parts = {key: tuple(value) if isinstance(value, list) else value for key, value in parts.items()}
    for key, part in PARTS.items():
        if parts.get(key) is not None:
            fields = {name: tuple(v) if isinstance(v, list) else v for name, v in parts[key].items()}
            parts[key] = part(**fields)
    return Scene(**parts)


def _kept_fields(scene: Scene) -> dict[str, Any]:
    """Return the fields of a scene that are not defaults, so that they make it again."""
    fields = {
        key: value for key, value in asdict(scene).items() if key in (*_FIELDS, *PARTS) and value not in (None, 0.0)
    }
    if scene.precompression:
        del fields["gap"]
    if scene.samples != 4:
        fields["samples"] = scene.samples
    return {
        key: {name: v for name, v in value.items() if not name.startswith("_") and v not in (None, "")}
        if isinstance(value, dict)
        else value
        for key, value in fields.items()
    }
