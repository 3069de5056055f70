"""All contacts of a scene as arrays, for the backends."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dem_bridge.physics import contact_law
from dem_bridge.physics.contact_law import ContactLaw
from dem_bridge.physics.contact_law import Floats as Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class Contacts:
    """All contacts of a scene as arrays ``(n_contact,)``: those of the chain in order, then wall_left, wall_right.

    ``overlap_k = x[left_k] - x[right_k] - gap_k``; the index ``n_body`` stands for a wall, with x = v = 0. In a
    precompressed chain ``gap`` is minus the static overlap. The damping force of every law is ``damping
    overlap^damping_power overlap'``; ``clip`` is True if its sum with the elastic force is clipped at zero. A closed
    contact attracts with ``pull_off`` (N) in addition to its elastic force, and the forces and energies here are the
    sums. ``laws`` are the distinct laws that are not powers, valid for overlaps up to ``reach (n_law,)`` (m), which the
    energy of the scene cannot exceed; contact k has ``laws[law[k]]``. Without such laws ``laws`` and ``reach`` are
    empty and ``law`` is -1.
    """

    left: NDArray[np.int64]
    right: NDArray[np.int64]
    stiffness: Floats
    exponent: Floats
    gap: Floats
    damping: Floats
    damping_power: Floats
    clip: bool
    pull_off: Floats
    laws: tuple[ContactLaw, ...]
    law: NDArray[np.int64]
    reach: Floats

    def __post_init__(self) -> None:
        for item in fields(self):
            if isinstance(values := getattr(self, item.name), np.ndarray):
                values.flags.writeable = False

    def __str__(self) -> str:
        """Return four lines: number, stiffness, exponents and gaps."""
        from dem_bridge.foundation.notebook import contacts_text  # not needed for a run

        return contacts_text(self)

    def force(self, overlap: Floats, which: NDArray[np.int64]) -> Floats:
        """Return the elastic force of the contacts ``which`` at overlaps >= 0, N.

        Parameters
        ----------
        overlap : ndarray
            Overlaps, m, ``(..., n_which)``.
        which : ndarray of int
            Indices of the contacts.
        """
        return self._evaluated("force", overlap, which)

    def energy(self, overlap: Floats, which: NDArray[np.int64]) -> Floats:
        """Return the stored energy, J; parameters as in :meth:`force`."""
        return self._evaluated("energy", overlap, which)

    def damping_force(self, overlap: Floats, rate: Floats, which: NDArray[np.int64]) -> Floats:
        """Return the damping force of the contacts ``which`` before a clip, N; 0 where the overlap is not above 0.

        Parameters
        ----------
        overlap, rate : ndarray
            Overlaps (m) and their rates (m/s), ``(..., n_which)``.
        which : ndarray of int
            Indices of the contacts.
        """
        closed = np.maximum(overlap, 0.0)
        factor = self.damping[which] * closed ** self.damping_power[which] * rate
        return np.asarray(np.where(overlap > 0.0, factor, 0.0))

    def _evaluated(self, quantity: Literal["force", "energy"], overlap: Floats, which: NDArray[np.int64]) -> Floats:
        """Evaluate force or energy of each contact by its power or its law."""
        if not self.laws:
            by_power = contact_law.force if quantity == "force" else contact_law.energy
            repulsion = by_power(overlap, self.stiffness[which], self.exponent[which])
            if not self.pull_off.any():
                return repulsion
            closed = np.maximum(overlap, 0.0)
            return np.asarray(repulsion - self.pull_off[which] * (closed > 0.0 if quantity == "force" else closed))
        out = np.empty(overlap.shape)
        for law in np.unique(self.law[which]).tolist():
            columns = self.law[which] == law
            out[..., columns] = getattr(self.laws[law], quantity)(overlap[..., columns])
        return out
