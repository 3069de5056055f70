"""Mixing: the law of two types without coefficients of their own, and the releases of LAMMPS that mix otherwise."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from dem_bridge.lmp import log
from dem_bridge.lmp.reader.pair_laws import PairLaw, compliance
from dem_bridge.lmp.reader.script import Command

#: first release that mixes the coefficients of ``pair_style granular`` as today: lammps#3807 of June 2023 ended a
#: second mixing. Measured: 29 Sep 2021 gives other velocities than 22 Jul 2025, and the same if the pair has a line
MIXES_AS_TODAY = 20230802


def mixed_law(laws: tuple[PairLaw, PairLaw], types: tuple[int, int], command: Command) -> PairLaw:
    """Return the law that LAMMPS mixes for two ``types`` i and j from the ``laws`` of i with i and j with j.

    A stiffness, a damping coefficient and a surface energy are the geometric means of the two; two materials act as two
    springs in series (LAMMPS manual, *pair_style granular*).

    Raises
    ------
    SceneError
        If the two laws are of different kinds, at ``command``, which is ``pair_style``.
    """
    first, second = laws
    alike, others = ((law.model, law.damping, law.clip, law.material is None, law.surface_energy > 0.0) for law in laws)
    if alike != others:
        raise command.error("leaves two types that meet without coefficients", "pair_coeff I J for these types")
    eta = math.sqrt(first.eta * second.eta)
    gamma = math.sqrt(first.surface_energy * second.surface_energy)
    if first.material is None or second.material is None:
        stiffness, material = math.sqrt(first.stiffness * second.stiffness), None
        numbers = [stiffness, eta]
    else:
        both = compliance(*first.material) + compliance(*second.material)
        stiffness, material, poisson = 4.0 / 3.0 / both, first.material, first.material[1]
        numbers = [2.0 * (1.0 - poisson**2) / both, eta, poisson]
    numbers += [gamma] if first.surface_energy > 0.0 else []
    name, words = first.command.rest[2], first.command.rest[3:]
    numbers += [0.0] if name == "dmt" and len(numbers) < 4 else []
    text = " ".join((*map(str, types), name, *map(repr, numbers), *words[len(numbers) :]))
    return PairLaw(
        first.command, first.model, stiffness, eta, first.damping, first.clip, material, gamma, f"pair_coeff {text}"
    )


def stated_release(text: str) -> int:
    r"""Return the LAMMPS release that a comment of a deck states, such as 20250722; 0 if there is none or several.

    Examples
    --------
    >>> stated_release("# for LAMMPS (22 Jul 2025 - Update 1)\nunits si"), stated_release("units si # 2 Aug 2023")
    (20250722, 0)
    """
    comments = re.findall(r"#.*\bLAMMPS\b(.*)", text)
    releases = {release for comment in comments if (release := log.version(comment))}
    return releases.pop() if len(releases) == 1 else 0


def mixing_warning(commands: Sequence[str], release: int = 0) -> str:
    """Return a sentence about the pairs that a deck leaves to mixing; '' if the release mixes them as they are read.

    Parameters
    ----------
    commands : sequence of str
        ``pair_coeff`` commands of these pairs.
    release : int, optional
        LAMMPS release that runs the deck, such as 20250722; 0: it is not known.

    Examples
    --------
    >>> mixing_warning(["pair_coeff 1 2 hertz 2e9 0.0 damping velocity"], 20210929).partition(";")[2]
    ' write pair_coeff 1 2 hertz 2e9 0.0 damping velocity'
    >>> mixing_warning(["pair_coeff 1 2 hertz 2e9 0.0 damping velocity"], 20250722)
    ''
    """
    if not commands or release >= MIXES_AS_TODAY:
        return ""
    pairs = ", ".join(" ".join(command.split()[1:3]) for command in commands)
    if release:
        who = f"LAMMPS {release}, as every release before {MIXES_AS_TODAY}, mixes"
    else:
        who = f"LAMMPS releases before {MIXES_AS_TODAY} (that of the deck is not known) mix"
    return (
        f"types {pairs} have no pair_coeff, and {who} their coefficients otherwise than read here (lammps#3807);"
        f" write {'; '.join(commands)}"
    )
