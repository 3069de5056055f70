"""Write tables of a contact law: with ``pair_style table`` in place of ``granular`` LAMMPS can be given any law."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

from dem_bridge.lmp.deck import Deck
from tests.helpers.fault_judging import BENCH, FREE

#: overlap (m, < 0: open) and stiffness beta -> force (N) and stored energy (J)
Law = Callable[[np.ndarray, float], tuple[np.ndarray, np.ndarray]]

LINES = 500
#: depth of a table over the largest overlap of its contact
RANGE = 1.3


def hertz(overlap: np.ndarray, beta: float) -> tuple[np.ndarray, np.ndarray]:
    """Return force and energy of the sound law."""
    closed = np.maximum(overlap, 0.0)
    return beta * closed**1.5, beta * closed**2.5 / 2.5


def tabulated(law: Law, style: str, *, reach: float = 0.0) -> Callable[[Deck], dict[str, str]]:
    """Put tables of ``law`` in a deck; ``style`` as ``spline 20000``, ``reach`` (m): how far open bodies feel it."""

    def change(deck: Deck) -> dict[str, str]:
        files = dict(deck.files)
        text = files[deck.input_file]
        text = re.sub(r"^pair_style .*$", f"pair_style table {style}", text, flags=re.MULTILINE)
        diameter = 2.0 * deck.surrogate_radius
        text = re.sub(
            r"^pair_coeff +\* \* .*$", f"pair_coeff * * none.table LAW {diameter!r}", text, flags=re.MULTILINE
        )
        files["none.table"] = _table(np.linspace(0.5, 1.0, 3) * diameter, np.zeros(3), np.zeros(3))
        peak = BENCH.reference.peak_force
        for k, (beta, force) in enumerate(zip(FREE.stiffness, peak, strict=True)):
            deepest = RANGE * (force / beta) ** (2.0 / 3.0)
            # close together where bodies touch: the law has a kink there
            overlap = deepest * np.linspace(1.0, 0.0, LINES) ** 2
            if reach:
                overlap = np.concatenate([overlap, -reach * np.linspace(0.0, 1.0, LINES)[1:] ** 2])
            files[f"contact{k}.table"] = _table(diameter - overlap, *law(overlap, beta))
            cut = float(diameter + reach)
            pattern = rf"^pair_coeff +(\d+ \d+) hertz .*# contact {k}:.*$"
            text, count = re.subn(pattern, rf"pair_coeff \1 contact{k}.table LAW {cut!r}", text, flags=re.MULTILINE)
            assert count == 1
        return files | {deck.input_file: text}

    return change


def _table(distance: np.ndarray, force: np.ndarray, energy: np.ndarray) -> str:
    lines = [
        f"{i} {r!r} {e!r} {f!r}"
        for i, (r, e, f) in enumerate(zip(distance.tolist(), energy.tolist(), force.tolist(), strict=True), start=1)
    ]
    return "\n".join(["# a contact law", "", "LAW", f"N {len(lines)}", "", *lines, ""])
