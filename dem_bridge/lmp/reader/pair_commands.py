"""Evaluation of ``pair_style`` and ``pair_coeff``: the normal force between the atoms of two types on a straight line.

``hertz K`` is K sqrt(R_eff) overlap^1.5; ``hertz/material E eta nu`` is the same with K = 4/3 / ((1-nu_i^2)/E_i +
(1-nu_j^2)/E_j); ``dmt E eta nu gamma`` is that less 4 pi gamma R_eff; ``hooke k`` is k overlap. 1/R_eff = 1/R_i +
1/R_j. Damping is eta overlap' (``velocity``), eta m_eff overlap' (``mass_velocity``) or eta m_eff sqrt(R_eff overlap)
overlap' (``viscoelastic``, the default), or follows from a coefficient of restitution in the place of eta
(``coeff_restitution``, ``tsuji``); the older ``gran`` styles have the factor m_eff as well (LAMMPS manual,
*pair_style granular* and *pair_style gran*). Tangential, rolling and twisting models have no effect if nothing rotates
or moves across the line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from dem_bridge.lmp.reader.mixing import mixed_law
from dem_bridge.lmp.reader.pair_laws import Materials, PairLaw, compliance
from dem_bridge.lmp.reader.script import Command, Script

#: normal model -> number of its coefficients
_MODELS = {"hertz": 2, "hooke": 2, "hertz/material": 3, "dmt": 4}
_GRAN = {"gran/hertz/history": "hertz", "gran/hooke": "hooke", "gran/hooke/history": "hooke"}
_DAMPINGS = ("velocity", "mass_velocity", "viscoelastic", "coeff_restitution", "tsuji")
#: dampings whose coefficient is a coefficient of restitution
_RESTITUTIONS = ("coeff_restitution", "tsuji")
#: settings after the normal model; only ``damping`` and ``limit_damping`` affect motion along a line
_SECTIONS = ("tangential", "rolling", "twisting", "heat", "damping", "limit_damping", "synchronized_verlet")
#: sections whose model ``none`` LAMMPS refuses ("Must specify damping granular model"; 29 Sep 2021 to 22 Jul 2025) ->
#: words that mean the same
_INSTEAD_OF_NONE = {
    "damping": "damping velocity, with the coefficient 0 behind the stiffness",
    "tangential": "tangential linear_nohistory 0 0",
}
_STYLES = f"granular, {', '.join(_GRAN)}"
_WALLS = f"granular, {', '.join(style.removeprefix('gran/') for style in _GRAN)}"
_ALLOWED = f"{', '.join(_MODELS)} with tangential, rolling, twisting, limit_damping and damping {', '.join(_DAMPINGS)}"


@dataclass
class Pairs:
    """State of the pair commands of a script."""

    script: Script
    style: str = ""
    command: Command | None = None
    _named: dict[tuple[int, int], tuple[int, PairLaw]] = field(default_factory=dict)
    """Laws of pairs of types that a line names, with the number of that line."""
    _ranges: list[tuple[int, range, range, PairLaw]] = field(default_factory=list)
    """Laws of ranges of types (with *), which are not expanded because they may be large."""
    _whole: PairLaw | None = None
    """Law of a style that has one law for all pairs."""
    _lines: int = 0
    _clipped: bool = False
    """True if the forces of LIGGGHTS' ``gran model`` are clipped."""

    def __post_init__(self) -> None:
        self.materials = Materials(self.script)

    def pair_style(self, command: Command) -> None:
        """Evaluate a ``pair_style`` command."""
        command.fail_if(not command.rest, "names no style", _STYLES)
        style, *words = command.rest
        if style == "table" or style.startswith("hybrid"):
            why = "reads forces from a file" if style == "table" else "has more than one law for a pair"
            raise command.error(f"{why}, so that the force is not a power of the overlap", _STYLES)
        if style == "gran":
            self._clipped = self.materials.settings(command, words)
        elif style not in (*_GRAN, "granular"):
            raise command.error(f"has the style {style}, which is not supported", _STYLES)
        self.style, self.command, self._whole = style, command, None
        self._named, self._ranges, self._lines = {}, [], 0
        if style in _GRAN:
            self._whole = self._gran(command, style, words)

    def wall_law(self, command: Command, words: Sequence[str]) -> PairLaw:
        """Return the law of ``fix wall/gran STYLE SETTINGS``; old scripts leave out the style, that of the pairs."""
        style, *settings = words or ("",)
        if style == "granular":
            return self._granular(command, settings)
        if words and style.replace(".", "0").replace("e", "0").isdigit() and self.style in _GRAN:
            return self._gran(command, self.style, words)
        command.fail_if(f"gran/{style}" not in _GRAN, f"has the force style {style}, which is not supported", _WALLS)
        return self._gran(command, f"gran/{style}", settings)

    def _gran(self, command: Command, style: str, words: Sequence[str]) -> PairLaw:
        """Return the law of ``pair_style gran/... Kn Kt gamma_n gamma_t xmu dampflag [limit_damping]``."""
        if len(words) == 2 and self.materials.properties:
            raise command.error("is of a LIGGGHTS before version 3", "pair_style gran model hertz tangential off")
        if len(words) not in (6, 7) or (len(words) == 7 and words[6] != "limit_damping"):
            raise command.error(f"has {len(words)} settings", "Kn Kt gamma_n gamma_t xmu dampflag [limit_damping]")
        stiffness, eta = (self.script.number(command, words[at]) for at in (0, 2))
        kind = "viscoelastic" if _GRAN[style] == "hertz" else "mass_velocity"
        return PairLaw(command, _GRAN[style], stiffness, eta, kind, len(words) == 7)

    def pair_coeff(self, command: Command, types: int) -> None:
        """Evaluate a ``pair_coeff`` command."""
        if not self.style or len(command.rest) < 2:
            raise command.error(
                "comes before pair_style, or names no types", "pair_coeff I J MODEL ... after pair_style"
            )
        if self._whole is not None and len(command.rest) > 2:
            raise command.error(f"has coefficients, but {self.style} has one law for all pairs", "pair_coeff * *")
        low, high, *words = command.rest
        if self.style == "gran":
            return
        law = self._whole or self._granular(command, words)
        first, second = (numbered(self.script, command, word, types) for word in (low, high))
        self._lines += 1
        if "*" in low + high:
            self._ranges.append((self._lines, first, second, law))
        else:
            self._named[min(first[0], second[0]), max(first[0], second[0])] = (self._lines, law)

    def _granular(self, command: Command, words: Sequence[str]) -> PairLaw:
        """Return the law of the coefficients of ``pair_style granular``."""
        if not words or words[0] not in _MODELS:
            raise command.error(f"has the normal model {(*words, 'none')[0]}, which is not supported", _ALLOWED)
        model, count = words[0], _MODELS[words[0]]
        command.fail_if(len(words) < 1 + count, f"has {len(words) - 1} numbers for {model}", f"{count}")
        numbers = [self.script.number(command, word) for word in words[1 : 1 + count]]
        command.fail_if(numbers[0] < 0.0 or numbers[1] < 0.0, "has a stiffness or a damping below 0", "numbers >= 0")
        behind, damping = list(words[1 + count :]), "viscoelastic"
        section = ""
        for at, word in enumerate(behind):
            if word in _SECTIONS:
                section = word
                chosen = (*behind[at + 1 : at + 2], "nothing")[0]
                if chosen == "none" and word in _INSTEAD_OF_NONE:
                    raise command.error(f"has {word} none, which LAMMPS refuses", _INSTEAD_OF_NONE[word])
                if word == "damping":
                    damping = chosen
            elif not section or word == "cutoff":
                raise command.error(f"has the setting {word}, which is not supported", _ALLOWED)
        if damping not in _DAMPINGS:
            raise command.error(f"has damping {damping}, which is not supported", f"damping {', '.join(_DAMPINGS)}")
        eta = numbers[1]
        if damping in _RESTITUTIONS and not 0.0 < eta <= 1.0:
            problem = f"has a coefficient of restitution of {eta:g}"
            raise command.error(problem, "a number above 0 and at most 1")
        stiffness, material = numbers[0], None
        if count > 2:
            if numbers[0] == 0.0 or not -1.0 < numbers[2] <= 0.5:
                raise command.error("has an impossible material", "E > 0 and -1 < nu <= 0.5")
            material = (numbers[0], numbers[2])
            stiffness = 4.0 / 3.0 / (2.0 * compliance(*material))
        name = "hooke" if model == "hooke" else "hertz"
        gamma = numbers[3] if model == "dmt" else 0.0
        command.fail_if(gamma < 0.0, "has a surface energy below 0", "a number >= 0")
        return PairLaw(command, name, stiffness, eta, damping, "limit_damping" in behind, material, gamma)

    def between(self, first: int, second: int) -> PairLaw:
        """Return the law between the atoms of two types, or raise SceneError if the script defines none."""
        low, high = min(first, second), max(first, second)
        assert self.command is not None  # checked before
        if self.style == "gran":
            return self.materials.law(self.command, first, second, clip=self._clipped)
        if (law := self._last(low, high)) is not None:
            return law
        left, right = self._last(low, low), self._last(high, high)
        if left is None or right is None:
            problem = f"leaves types {low} and {high}, which meet, without pair_coeff"
            raise self.command.error(problem, f"pair_coeff {low} {high} or *")
        return mixed_law((left, right), (low, high), self.command)

    def _last(self, low: int, high: int) -> PairLaw | None:
        """Return the law of the last line that names both types, low <= high."""
        if self._ranges:
            self.script.count(self._ranges[-1][3].command, len(self._ranges) // 8)
        laws = [(line, law) for line, first, second, law in self._ranges if low in first and high in second]
        laws += [self._named[low, high]] if (low, high) in self._named else []
        return max(laws, key=lambda entry: entry[0])[1] if laws else None


def numbered(script: Script, command: Command, word: str, most: int) -> range:
    """Return the range of ``n``, ``*``, ``n*``, ``*m`` or ``n*m`` within 1 to ``most``."""
    low, star, high = word.partition("*")
    first = script.whole(command, low) if low else 1
    last = (script.whole(command, high) if high else most) if star else first
    command.fail_if(not 1 <= first <= last <= most, f"has {word!r}", f"1 to {most}")
    return range(first, last + 1)
