"""Read LAMMPS decks, ``granular`` or ``table`` or both: written from LAMMPS' manual and nothing of this project.

It does what LAMMPS does with ``in.NAME`` and the data file that it reads: strips comments, substitutes variables, lets
later ``pair_coeff`` and ``set`` lines override earlier ones, and knows a frozen atom by the absence of an integrator.
Commands that it does not know are an error, so nothing in a deck goes unread.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

#: commands that say nothing about masses, forces, positions or velocities
SILENT = {
    "units", "dimension", "boundary", "atom_style", "atom_modify", "newton", "comm_modify", "neighbor",
    "neigh_modify", "thermo_style", "thermo_modify", "thermo", "dump", "dump_modify", "run",
}  # fmt: skip


@dataclass
class Atom:
    """Hold one line of the data file's Atoms section, with what ``set`` and Velocities add."""

    number: int
    kind: int
    diameter: float
    density: float
    place: tuple[float, float, float]
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    set_mass: float | None = None
    moves: bool = False

    @property
    def mass(self) -> float:
        """Return the mass that ``set`` gave, else density times the volume of the sphere, kg."""
        if self.set_mass is not None:
            return self.set_mass
        return self.density * 4.0 / 3.0 * math.pi * (self.diameter / 2.0) ** 3


@dataclass
class Coefficients:
    """Hold ``hertz K eta`` or ``hooke k eta`` of one pair of types, and the damping model's name."""

    model: str
    stiffness: float
    eta: float
    damping: str
    tangential: tuple[float, ...]
    clip: bool
    """``limit_damping``: the net force never pulls."""


@dataclass
class Table:
    """Hold one section of a table file: distance (m), energy (J) and force (N) of each line."""

    file: str
    keyword: str
    header: str
    distance: list[float]
    energy: list[float]
    force: list[float]
    slopes: tuple[float, float]
    """``FPRIME``: dF/dr at the first and the last line, N/m."""


@dataclass
class ReadDeck:
    """Hold all that LAMMPS would simulate: atoms, coefficients of pairs, forces, settings."""

    atoms: list[Atom]
    coefficients: dict[tuple[int, int], Coefficients]
    """Of ``granular``."""
    settings: dict[str, str]
    dt: float
    steps: int
    gravity: float
    types: int
    loads: dict[int, float] = field(default_factory=dict)
    """Atom -> constant force along x, N."""
    drives: dict[int, Callable[[int], float]] = field(default_factory=dict)
    """Atom -> force along x, N, at a step."""
    drag: float = 0.0
    """1/s: what moves loses mass * velocity * drag."""
    tables: dict[tuple[int, int], Table] = field(default_factory=dict)
    table_style: tuple[str, int] = ("", 0)
    """How LAMMPS interpolates, and on how many points; "": no tables."""

    @property
    def bodies(self) -> list[Atom]:
        return [atom for atom in self.atoms if atom.moves]

    @property
    def masses(self) -> list[float]:
        return [atom.mass for atom in self.bodies]

    @property
    def velocities(self) -> list[float]:
        return [atom.velocity[0] for atom in self.bodies]

    @property
    def wall_left(self) -> bool:
        return not self.atoms[0].moves

    @property
    def wall_right(self) -> bool:
        return not self.atoms[-1].moves

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Return the types of each contact along the line, walls included."""
        ends = zip(self.atoms, self.atoms[1:], strict=False)
        return [(min(a.kind, b.kind), max(a.kind, b.kind)) for a, b in ends]

    @property
    def found(self) -> list[Coefficients]:
        """Return the coefficients of each contact along the line."""
        return [self.coefficients[pair] for pair in self.pairs]

    @property
    def exponents(self) -> list[float]:
        """Return n of each contact along the line: the force goes as overlap^(n - 1)."""
        return [{"hertz": 2.5, "hooke": 2.0}[law.model] for law in self.found]

    @property
    def _effective(self) -> list[tuple[float, float]]:
        """Return radius and mass of each contact: 1/R_eff = 1/R_a + 1/R_b, and so the mass, of fixed atoms too."""
        ends = list(zip(self.atoms, self.atoms[1:], strict=False))
        return [
            (a.diameter * b.diameter / (2.0 * (a.diameter + b.diameter)), a.mass * b.mass / (a.mass + b.mass))
            for a, b in ends
        ]

    @property
    def stiffnesses(self) -> list[float]:
        """Return beta of each contact along the line: F = K sqrt(R_eff) overlap^1.5 (hertz), k overlap (hooke)."""
        return [
            law.stiffness * (math.sqrt(radius) if law.model == "hertz" else 1.0)
            for law, (radius, _) in zip(self.found, self._effective, strict=True)
        ]

    @property
    def dampings(self) -> list[tuple[float, float]]:
        """Return c and p of each contact along the line, F = c overlap^p overlap'.

        ``velocity``: eta and 0; ``mass_velocity``: eta m_eff and 0;
        ``viscoelastic``: eta m_eff times the contact's radius sqrt(R_eff overlap), of every model but JKR's;
        ``coeff_restitution``: alpha sqrt(m_eff F / overlap) with the elastic force F."""
        return [
            {
                "velocity": lambda eta, radius, mass, k, hertz: (eta, 0.0),
                "mass_velocity": lambda eta, radius, mass, k, hertz: (eta * mass, 0.0),
                "viscoelastic": lambda eta, radius, mass, k, hertz: (eta * mass * math.sqrt(radius), 0.5),
                "coeff_restitution": _by_restitution,
            }[model.damping](model.eta, radius, mass, model.stiffness, model.model == "hertz")
            for model, (radius, mass) in zip(self.found, self._effective, strict=True)
        ]

    @property
    def gaps(self) -> list[float]:
        """Return the clearance of each contact along the line, m."""
        ends = zip(self.atoms, self.atoms[1:], strict=False)
        return [b.place[0] - a.place[0] - 0.5 * (a.diameter + b.diameter) for a, b in ends]


def _by_restitution(e: float, radius: float, mass: float, k: float, hertz: bool) -> tuple[float, float]:
    """Return c and p as the engine's source has them: constants sqrt(3/2) and 2 sqrt(5/6) for Hertz, 2 for Hooke."""
    constant = math.sqrt(1.5) * 2.0 * math.sqrt(5.0 / 6.0) if hertz else 2.0
    alpha = -constant * math.log(e) / math.sqrt(math.pi**2 + math.log(e) ** 2)
    return alpha * math.sqrt(mass * k * (math.sqrt(radius) if hertz else 1.0)), 0.25 if hertz else 0.0


def read_deck(folder: Path, name: str) -> ReadDeck:
    """Return what LAMMPS would simulate, from ``in.NAME`` and the files that it reads."""
    variables: dict[str, str] = {}
    settings: dict[str, str] = {}
    atoms: list[Atom] = []
    coefficients: dict[tuple[int, int], Coefficients] = {}
    groups: dict[str, set[int]] = {}
    loads: dict[int, float] = {}
    drives: dict[int, Callable[[int], float]] = {}
    formulas: dict[str, str] = {}
    tables: dict[tuple[int, int], Table] = {}
    styles: list[str] = []
    table_style = ("", 0)
    files: dict[str, dict[int, float]] = {}
    types, dt, steps, gravity, drag = 0, math.nan, 0, 0.0, 0.0
    for line in _whole_lines(folder / f"in.{name}"):
        line = re.sub(r"\$\{(\w+)\}", lambda match: variables[match[1]], line.split("#")[0])
        words = line.split()
        if not words:
            continue
        command, rest = words[0], words[1:]
        if command == "variable":
            if rest[1] == "index":
                variables[rest[0]] = rest[2]
            elif rest[1] == "atomfile":
                files[rest[0]] = _read_atomfile(folder / rest[2])
            else:
                assert rest[1] in ("equal", "vector"), line
                formulas[rest[0]] = "".join(rest[2:]).strip('"')
        elif command == "read_data":
            atoms, types = _read_data(folder / rest[0])
            groups["all"] = {atom.number for atom in atoms}
        elif command == "set":
            assert rest[2] == "mass", line
            for atom in atoms:
                if rest[0] == "group" and atom.number in groups[rest[1]]:
                    atom.set_mass = files[rest[3].removeprefix("v_")].get(atom.number, 0.0)
                elif rest[0] == "atom" and atom.number in _numbers(rest[1], len(atoms)):
                    atom.set_mass = float(rest[3])
                else:
                    assert rest[0] in ("group", "atom"), line
        elif command == "pair_style":
            assert not styles, "a second pair_style forgets all coefficients"
            if rest[0] == "hybrid/overlay":
                rest = rest[1:]
                assert len(rest) == 4, line
            while rest:
                styles.append(rest[0])
                if rest[0] == "table":
                    table_style = (rest[1], int(rest[2]))
                    rest = rest[3:]
                else:
                    assert rest[0] == "granular", line
                    rest = rest[1:]
        elif command == "pair_coeff":
            # of several styles each line names its own; in an overlay one pair may have a line of each
            style, rest = (rest[2], rest[:2] + rest[3:]) if len(styles) > 1 else (styles[0], rest)
            assert style in styles, line
            if style == "granular":
                _pair_coeff(rest, types, coefficients)
            else:
                # the cutoff, where none is named, is the last line
                assert len(rest) == 4, line
                table = _read_table(folder / rest[2], rest[3])
                tables |= dict.fromkeys(_pairs(rest, types), table)
        elif command == "group":
            if rest[1] == "id":
                groups[rest[0]] = {int(word) for word in rest[2:]}
            else:
                assert rest[1] == "subtract", line
                groups[rest[0]] = groups[rest[2]].difference(*(groups[word] for word in rest[3:]))
        elif command == "fix" and rest[2] == "nve":
            for atom in atoms:
                atom.moves |= atom.number in groups[rest[1]]
        elif command == "fix" and rest[2] == "addforce":
            assert [float(word) for word in rest[4:]] == [0.0, 0.0], line
            for number in groups[rest[1]]:
                if rest[3].startswith("v_"):
                    assert number not in drives, line
                    drives[number] = _formula(formulas[rest[3].removeprefix("v_")], formulas, variables)
                    continue
                loads[number] = loads.get(number, 0.0) + float(rest[3])
        elif command == "fix" and rest[2] == "langevin":
            # a bath at zero temperature gives nothing, whatever the seed; -m v / t is all that is left
            assert [float(word) for word in rest[3:5]] == [0.0, 0.0], line
            assert int(rest[6]) > 0, line
            assert len(rest) == 7, line
            assert groups[rest[1]] == {atom.number for atom in atoms if atom.moves}, "drag on what does not move"
            drag += 1.0 / float(rest[5])
        elif command == "fix":
            assert rest[2] == "gravity", line
            assert rest[4] == "vector", line
            assert [float(word) for word in rest[6:]] == [0.0, 0.0], line
            assert groups[rest[1]] == {atom.number for atom in atoms if atom.moves}, "weight on what does not move"
            gravity += float(rest[3]) * math.copysign(1.0, float(rest[5]))
        elif command == "timestep":
            dt = float(rest[0])
        else:
            assert command in SILENT, f"not read: {line}"
            settings[command] = " ".join(rest)
            if command == "run":
                steps = int(rest[0])
    assert all(atom.place[1:] == (0.0, 0.0) for atom in atoms)
    assert all(atom.velocity[1:] == (0.0, 0.0) and atom.spin == (0.0, 0.0, 0.0) for atom in atoms)
    atoms.sort(key=lambda atom: atom.place[0])
    return ReadDeck(atoms, coefficients, settings, dt, steps, gravity, types, loads, drives, drag, tables, table_style)


def _whole_lines(file: Path) -> list[str]:
    """Return the commands, those of included files in their places; a line that ends with & goes on in the next."""
    lines: list[str] = []
    for line in re.sub(r"&[ \t]*\n", "", file.read_text()).splitlines():
        words = line.split("#")[0].split()
        lines += _whole_lines(file.parent / words[1]) if words[:1] == ["include"] else [line]
    return lines


def _formula(text: str, formulas: dict[str, str], variables: dict[str, str]) -> Callable[[int], float]:
    """Return an equal-style formula as a function of the step.

    A variable within a formula has 15 digits (LAMMPS,
    ``Variable::retrieve``), one of style index its own text; vectors count from 1."""

    def value(formula: str, step: int) -> float:
        def entry(match: re.Match[str]) -> str:
            return f"({formulas[match[1]]}[{value(formulas[match[2]], step):.0f} - 1])"

        def number(match: re.Match[str]) -> str:
            name = match[1]
            return f"({variables[name]})" if name in variables else f"({value(formulas[name], step):.15g})"

        written = re.sub(r"v_(\w+)", number, re.sub(r"v_(\w+)\[v_(\w+)\]", entry, formula))
        scope = {"step": step, "sin": math.sin, "floor": math.floor, "__builtins__": {}}
        return float(eval(written.replace("^", "**"), scope))

    return lambda step: value(text, step)


def _read_data(file: Path) -> tuple[list[Atom], int]:
    """Return the atoms and the number of types; as in LAMMPS, the first line is skipped whatever it says."""
    counts: dict[str, int] = {}
    section, atoms = "", {}
    box: tuple[float, float] = (math.nan, math.nan)
    for line in file.read_text().splitlines()[1:]:
        words = line.split("#")[0].split()
        if not words:
            continue
        if words[0] in ("Atoms", "Velocities"):
            section = words[0]
        elif section == "Atoms":
            number, kind = int(words[0]), int(words[1])
            diameter, density, x, y, z = map(float, words[2:])
            assert 1 <= kind <= counts["types"]
            assert box[0] <= x <= box[1], f"atom {number} stands outside of the box"
            atoms[number] = Atom(number, kind, diameter, density, (x, y, z))
        elif section == "Velocities":
            vx, vy, vz, wx, wy, wz = map(float, words[1:])
            atoms[int(words[0])].velocity, atoms[int(words[0])].spin = (vx, vy, vz), (wx, wy, wz)
        elif words[-2:] == ["xlo", "xhi"]:
            box = (float(words[0]), float(words[1]))
        elif words[-1] in ("atoms", "types"):
            counts[words[-1]] = int(words[0])
    assert sorted(atoms) == list(range(1, counts["atoms"] + 1))
    return list(atoms.values()), counts["types"]


def _read_atomfile(file: Path) -> dict[int, float]:
    """Return a number for each atom named; as in LAMMPS, comments and blank lines are skipped before the count."""
    lines = [words for line in file.read_text().splitlines() if (words := line.split("#")[0].split())]
    [count], rows = lines[0], lines[1:]
    assert int(count) == len(rows)
    return {int(number): float(value) for number, value in rows}


def _read_table(file: Path, keyword: str) -> Table:
    """Return the section ``keyword``: its name, ``N n FPRIME low high``, a blank line, ``index r energy force``."""
    lines = file.read_text().splitlines()
    at = next(i for i, line in enumerate(lines) if line.split() == [keyword])
    parameters = lines[at + 1].split()
    assert (parameters[0], parameters[2]) == ("N", "FPRIME"), parameters
    assert lines[at + 2] == ""
    count = int(parameters[1])
    rows = [line.split() for line in lines[at + 3 : at + 3 + count]]
    assert [int(row[0]) for row in rows] == list(range(1, count + 1))
    distance, energy, force = ([float(row[column]) for row in rows] for column in (1, 2, 3))
    assert lines[at + 3 + count :] == [], "a second section"
    return Table(file.name, keyword, lines[0], distance, energy, force, (float(parameters[3]), float(parameters[4])))


def _pairs(words: list[str], types: int) -> list[tuple[int, int]]:
    """Return all pairs I <= J that ``pair_coeff I J`` names."""
    pairs = [(i, j) for i in _numbers(words[0], types) for j in _numbers(words[1], types) if i <= j]
    assert pairs, f"LAMMPS rejects this line, I > J: {words}"
    return pairs


def _numbers(word: str, most: int) -> range:
    """Return the types that ``*``, ``n``, ``n*``, ``*m`` or ``n*m`` stands for."""
    if "*" not in word:
        return range(int(word), int(word) + 1)
    low, high = word.split("*")
    return range(int(low or 1), int(high or most) + 1)


def _pair_coeff(words: list[str], types: int, coefficients: dict[tuple[int, int], Coefficients]) -> None:
    """Read ``I J MODEL k eta tangential linear_nohistory kt xgamma damping NAME [limit_damping]`` for all I <= J."""
    assert words[2] in ("hertz", "hooke"), words
    assert words[5:7] == ["tangential", "linear_nohistory"], words
    assert words[9] == "damping", words
    assert words[11:] in ([], ["limit_damping"]), words
    tangential = (float(words[7]), float(words[8]))
    for pair in _pairs(words, types):
        coefficients[pair] = Coefficients(
            words[2], float(words[3]), float(words[4]), words[10], tangential, len(words) > 11
        )
