"""All contacts of a scene as arrays: what those who solve it work with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from dem_bridge.physics import contact
from dem_bridge.physics.law import ContactLaw


@dataclass(frozen=True, kw_only=True, eq=False)
class Contacts:
    """Every contact of a scene as arrays ``(n_contact,)``: the chain's in order, then wall_left, wall_right.

    ``overlap_k = x[left_k] - x[right_k] - gap_k``; the index ``n_body`` stands for a wall, with x = v = 0. In a
    precompressed chain ``gap`` is minus the static overlap. The damping force is
    ``damping overlap^damping_power overlap'``, whatever its law. ``laws``: the distinct laws that are no powers, good
    for overlaps up to ``reach (n_law,)`` (m), which the energy at hand cannot exceed; contact k has
    ``laws[law[k]]``. Without them ``laws`` and ``reach`` are empty and ``law`` is -1.
    """

    left: NDArray[np.int64]
    right: NDArray[np.int64]
    stiffness: NDArray[np.float64]
    exponent: NDArray[np.float64]
    gap: NDArray[np.float64]
    damping: NDArray[np.float64]
    damping_power: NDArray[np.float64]
    laws: tuple[ContactLaw, ...]
    law: NDArray[np.int64]
    reach: NDArray[np.float64]

    def __post_init__(self) -> None:
        for one in fields(self):
            if one.name != "laws":
                getattr(self, one.name).flags.writeable = False

    def force(self, overlap: NDArray[np.float64], which: NDArray[np.int64]) -> NDArray[np.float64]:
        """Elastic force, N, of the contacts ``which`` at overlaps >= 0, ``(..., n_which)`` both."""
        if not self.laws:
            return contact.force(overlap, self.stiffness[which], self.exponent[which])
        return self._by_law([one.force for one in self.laws], overlap, which)

    def energy(self, overlap: NDArray[np.float64], which: NDArray[np.int64]) -> NDArray[np.float64]:
        """Stored energy, J; as :meth:`force`."""
        if not self.laws:
            return contact.energy(overlap, self.stiffness[which], self.exponent[which])
        return self._by_law([one.energy for one in self.laws], overlap, which)

    def _by_law(
        self,
        functions: Sequence[Callable[[NDArray[np.float64]], NDArray[np.float64]]],
        overlap: NDArray[np.float64],
        which: NDArray[np.int64],
    ) -> NDArray[np.float64]:
        out = np.empty(overlap.shape)
        for law in np.unique(self.law[which]).tolist():
            own = self.law[which] == law
            out[..., own] = functions[law](overlap[..., own])
        return out
