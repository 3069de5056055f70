"""Variants of input scripts as users write them, what a check should answer, and the lines of an answer written."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

#: a chain of steel balls, in SI units; every part can be changed by its name
RADIUS, DENSITY, SPEED, MODULUS, POISSON = 5e-3, 7800.0, 0.5, 2e11, 0.3
MASS = 4.0 / 3.0 * math.pi * RADIUS**3 * DENSITY
#: stiffness of LAMMPS' hertz and the time of a collision of two balls at this speed (Hertz)
STIFFNESS = 4.0 / 3.0 * MODULUS / (2.0 * (1.0 - POISSON**2))
CONTACT = 2.94 * (0.5 * MASS / (0.8 * STIFFNESS * math.sqrt(0.5 * RADIUS))) ** 0.4 / SPEED**0.2
NO_FRICTION = "tangential linear_nohistory 0 0"
UNDAMPED = f"{NO_FRICTION} damping velocity"
BALLS = f"hertz/material {MODULUS:g} 0 {POISSON:g} {UNDAMPED}"
UNITS = {"si": (1.0, 1.0, 1.0), "cgs": (1e-2, 1.0, 1e-3), "micro": (1e-6, 1e-6, 1e-15), "nano": (1e-9, 1e-9, 1e-21)}


@dataclass(frozen=True, kw_only=True)
class Variant:
    """A script and what a check should answer."""

    name: str
    files: Mapping[str, str]
    outcome: str
    """PASS, FAIL, UNDECIDED or BROKEN."""
    law: str = "PASS"
    said: str = ""
    """Words that the answer must have: what is wrong, or which line."""
    variables: Mapping[str, str] = field(default_factory=dict)

    def write(self, folder: Path) -> Path:
        """Write the files into a folder and return the script."""
        for name, text in self.files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text)
        return folder / "in.chain"


def script(
    *,
    per_contact: Any = 100.0,
    bodies: Any = 5,
    length: Any = 6.0,
    contact: Any = CONTACT,
    **parts: Any,
) -> str:
    """Return a script with a step of the contact time over ``per_contact``, which runs so many contact times.

    ``parts`` replaces parts by their names; an empty text leaves a part out.
    """
    step = contact / per_contact
    end = 2.0 * RADIUS * bodies
    across = f"{-3 * RADIUS:g} {3 * RADIUS:g}"
    written = {
        "units": "units si",
        "style": "atom_style sphere\natom_modify map array sort 0 0.0",
        "boundary": "boundary m f f",
        "comm": "comm_modify vel yes",
        "box": f"region box block {-4 * RADIUS:g} {end + 4 * RADIUS:g} {across} {across} units box\ncreate_box 2 box",
        "atoms": "\n".join(f"create_atoms 1 single {2.0 * RADIUS * k:.15g} 0 0 units box" for k in range(bodies)),
        "sizes": f"set group all diameter {2.0 * RADIUS:g}\nset group all density {DENSITY:g}",
        "start": f"group first id 1\nvelocity first set {SPEED:g} 0 0 units box",
        "neighbour": f"neighbor {RADIUS:g} bin\nneigh_modify delay 0 every 1 check yes",
        "pair": "pair_style granular",
        "coefficients": f"pair_coeff * * {BALLS}",
        "fixes": "fix move all nve",
        "more": "",
        "step": f"timestep {step:.4g}",
        "dump": "dump own all custom 50 own.dump id x vx",
        "run": f"run {math.ceil(length * contact / float(f'{step:.4g}'))}",
    }
    assert set(parts) <= set(written), set(parts) - set(written)
    return "\n".join(text for text in {**written, **parts}.values() if text) + "\n"


def in_units(name: str, per_contact: float) -> str:
    """Return the chain in another unit style."""
    length, time, mass = UNITS[name]
    lines = []
    for line in script(per_contact=per_contact).splitlines():
        words = line.split()
        factors = {
            "region": 1.0 / length,
            "create_atoms": 1.0 / length,
            "neighbor": 1.0 / length,
            "velocity": time / length,
            "timestep": 1.0 / time,
        }
        if words[:2] == ["set", "group"]:
            factor = 1.0 / length if words[3] == "diameter" else length**3 / mass
            words[4] = f"{float(words[4]) * factor:.15g}"
        elif words[0] == "pair_coeff":
            words[4] = f"{float(words[4]) * length * time**2 / mass:.15g}"
        elif words[0] == "units":
            words[1] = name
        elif words[0] in factors:
            first = 2 if words[0] in ("create_atoms",) else 1
            for place, word in enumerate(words):
                if (place > first and re.fullmatch(r"-?[\d.]+(e[-+]?\d+)?", word)) or (place, words[0]) in (
                    (1, "neighbor"),
                    (1, "timestep"),
                ):
                    words[place] = f"{float(word) * factors[words[0]]:.15g}"
        lines.append(" ".join(words))
    return "\n".join(lines) + "\n"


def _deck(name: str, outcome: str, text: str, law: str = "PASS", said: str = "", **files: str) -> Variant:
    return Variant(
        name=name,
        files={"in.chain": text, **{key.replace("_", "."): value for key, value in files.items()}},
        outcome=outcome,
        law=law,
        said=said,
    )


def _coefficients(law: str) -> dict[str, str]:
    return {"coefficients": f"pair_coeff * * {law}"}


def steps() -> Iterable[Variant]:
    """Yield steps from far too coarse to fine."""
    for per_contact, outcome in (
        (1.2, "FAIL"), (3.0, "FAIL"), (6.0, "FAIL"), (10.0, "FAIL"), (15.0, "FAIL"), (20.0, "FAIL"), (30.0, "FAIL"),
        (70.0, "PASS"), (100.0, "PASS"), (300.0, "PASS"), (1000.0, "PASS"),
    ):  # fmt: skip
        yield _deck(f"step 1/{per_contact:g} of the contact", outcome, script(per_contact=per_contact))


def units() -> Iterable[Variant]:
    """Yield unit styles, each with a coarse and a fine step."""
    for name in ("cgs", "micro", "nano"):
        yield _deck(f"units {name}, coarse", "FAIL", in_units(name, 10.0))
        yield _deck(f"units {name}, fine", "PASS", in_units(name, 100.0))
    reduced = {
        "units": "units lj",
        "box": "region box block -4 14 -3 3 -3 3 units box\ncreate_box 2 box",
        "atoms": "\n".join(f"create_atoms 1 single {k} 0 0 units box" for k in range(5)),
        "sizes": "set group all diameter 1.0\nset group all mass 1.0",
        "start": "group first id 1\nvelocity first set 0.1 0 0 units box",
        "neighbour": "neighbor 0.3 bin",
        **_coefficients(f"hertz 1000 0 {UNDAMPED}"),
    }
    yield _deck("units lj, default step", "PASS", script(**reduced, step="", run="run 400"))
    yield _deck("units lj, coarse", "FAIL", script(**reduced, step="timestep 0.05", run="run 40"))
    yield _deck("units cgs with numbers in SI", "PASS", script(units="units cgs"), said="are the units right")


def laws() -> Iterable[Variant]:
    """Yield contact laws."""
    hertz = f"hertz {STIFFNESS:.9g} 0 {UNDAMPED}"
    linear = STIFFNESS * math.sqrt(0.5 * RADIUS) * math.sqrt(1e-5)
    period = math.pi * math.sqrt(0.5 * MASS / linear)
    for n, outcome in ((10.0, "FAIL"), (100.0, "PASS")):
        word = "coarse" if outcome == "FAIL" else "fine"
        yield _deck(f"hertz, {word}", outcome, script(per_contact=n, **_coefficients(hertz)))
        yield _deck(
            f"hooke, {word}",
            outcome,
            script(per_contact=n, contact=period, **_coefficients(f"hooke {linear:.9g} 0 {UNDAMPED}")),
            said="hooke: the force is proportional",
        )
        yield _deck(
            f"gran/hertz/history, {word}",
            outcome,
            script(
                per_contact=n,
                pair=f"pair_style gran/hertz/history {STIFFNESS:.9g} 0 0 0 0 0",
                coefficients="pair_coeff * *",
            ),
        )
        yield _deck(
            f"gran/hooke, {word}",
            outcome,
            script(
                per_contact=n,
                contact=period,
                pair=f"pair_style gran/hooke {linear:.9g} 0 0 0 0 0",
                coefficients="pair_coeff * *",
            ),
        )
    yield _deck(
        "gran/hooke/history, coarse",
        "FAIL",
        script(
            per_contact=10.0,
            contact=period,
            pair=f"pair_style gran/hooke/history {linear:.9g} 0 0 0 0 0",
            coefficients="pair_coeff * *",
        ),
    )
    yield _deck(
        "mass in place of density",
        "FAIL",
        script(per_contact=12.0, sizes=f"set group all diameter {2 * RADIUS:g}\nset group all mass {MASS:.9g}"),
    )
    soft = f"hertz/material {MODULUS / 1e6:g} 0 {POISSON:g} {UNDAMPED}"
    yield _deck(
        "modulus a million times too small",
        "PASS",
        script(per_contact=100.0, contact=CONTACT * 1e6**0.4, **_coefficients(soft)),
        said="overlap",
    )


def dampings() -> Iterable[Variant]:
    """Yield damping models."""
    dashpot = 0.1 * 2.0 * math.sqrt(0.5 * MASS * 1e8)
    models = {
        "velocity": f"{dashpot:.4g} {POISSON:g} {NO_FRICTION} damping velocity",
        "velocity, clipped": f"{dashpot:.4g} {POISSON:g} {NO_FRICTION} damping velocity limit_damping",
        "mass_velocity, clipped": f"{2e4:g} {POISSON:g} {NO_FRICTION} damping mass_velocity limit_damping",
        "viscoelastic": f"{3e9:g} {POISSON:g} {NO_FRICTION}",
        "coeff_restitution 0.9": f"0.9 {POISSON:g} {NO_FRICTION} damping coeff_restitution",
        "coeff_restitution 0.5": f"0.5 {POISSON:g} {NO_FRICTION} damping coeff_restitution",
    }
    for name, rest in models.items():
        law = f"hertz/material {MODULUS:g} {rest}"
        yield _deck(f"damping {name}, coarse", "FAIL", script(per_contact=10.0, **_coefficients(law)))
        yield _deck(f"damping {name}, fine", "PASS", script(per_contact=3000.0, length=3.0, **_coefficients(law)))
    for e, n in ((0.9, 200.0), (0.5, 200.0), (0.3, 10.0)):
        law = f"hertz/material {MODULUS:g} {e:g} {POISSON:g} {NO_FRICTION} damping tsuji"
        yield _deck(
            f"damping tsuji {e:g}, 1/{n:g}",
            "FAIL",
            script(per_contact=n, **_coefficients(law)),
            "FAIL",
            "tsuji-prefactor",
        )
    law = f"hertz/material {MODULUS:g} 0 {POISSON:g} {NO_FRICTION} damping coeff_restitution"
    yield _deck("coeff_restitution 0", "FAIL", script(**_coefficients(law)), "", "zero-restitution")
    law = f"pair_style gran/hertz/history {STIFFNESS:.9g} 0 1e4 0 0 0"
    yield _deck("gran/hertz/history, damped", "FAIL", script(per_contact=10.0, pair=law, coefficients="pair_coeff * *"))


def walls() -> Iterable[Variant]:
    """Yield walls at the end."""
    end = 2.0 * RADIUS * 4 + RADIUS
    granular = f"fix wall all wall/gran granular {BALLS} xplane NULL {end:g}"
    classic = f"fix wall all wall/gran hertz/history {STIFFNESS:.9g} 0 0 0 0 0 xplane NULL {end:g}"
    region = f"region w plane {end:g} 0 0 -1 0 0 units box\nfix wall all wall/gran/region granular {BALLS} region w"
    frozen = "group clamp id 5\ngroup free id 1 2 3 4\nfix move free nve\nfix hold clamp freeze"
    yield _deck("wall/gran granular, coarse", "FAIL", script(per_contact=10.0, length=8.0, more=granular))
    yield _deck("wall/gran granular, fine", "PASS", script(per_contact=200.0, length=8.0, more=granular))
    yield _deck("wall/gran classic undamped", "FAIL", script(length=8.0, more=classic), "FAIL", "undamped-classic-wall")
    yield _deck(
        "wall/gran classic undamped, coarse", "FAIL", script(per_contact=10.0, length=8.0, more=classic), "FAIL",
        "undamped-classic-wall",
    )  # fmt: skip
    yield _deck("wall/gran/region, coarse", "FAIL", script(per_contact=10.0, length=8.0, more=region))
    yield _deck("frozen ball as a wall", "FAIL", script(per_contact=10.0, length=8.0, fixes=frozen))
    left = f"fix other all wall/gran granular {BALLS} xplane {-RADIUS - 1e-5:g} NULL"
    yield _deck("two walls", "FAIL", script(per_contact=10.0, length=10.0, more=f"{granular}\n{left}"))


def conditions() -> Iterable[Variant]:
    """Yield gaps, weight, load, drag, and other starts."""
    gaps = "\n".join(f"create_atoms 1 single {2.02 * RADIUS * k:.15g} 0 0 units box" for k in range(5))
    slow = {"length": 60.0, "atoms": gaps}
    yield _deck("gaps, coarse", "FAIL", script(per_contact=10.0, **slow))
    yield _deck("gaps, fine", "PASS", script(per_contact=150.0, **slow))
    yield _deck("gravity", "FAIL", script(per_contact=10.0, more="fix weight all gravity 9.81 vector 1 0 0"))
    yield _deck("drag by fix viscous", "FAIL", script(per_contact=10.0, more="fix air all viscous 1.0"))
    yield _deck("drag by fix langevin", "FAIL", script(per_contact=10.0, more="fix air all langevin 0 0 1e-3 1"))
    both = (
        "group first id 1\nvelocity first set 0.5 0 0 units box\ngroup last id 5\nvelocity last set -0.5 0 0 units box"
    )
    yield _deck("two ends move", "FAIL", script(per_contact=10.0, start=both))
    back = "group last id 5\nvelocity last set -0.5 0 0 units box"
    yield _deck("the last body moves", "FAIL", script(per_contact=10.0, start=back))
    pressed = "\n".join(f"create_atoms 1 single {1.999 * RADIUS * k:.15g} 0 0 units box" for k in range(5))
    yield _deck("overlaps at the start", "FAIL", script(per_contact=20.0, atoms=pressed), said="begin with overlaps")
    yield _deck("along z", "FAIL", _along_z(script(per_contact=10.0)))


def _along_z(text: str) -> str:
    """Return a script whose chain lies along z."""
    text = text.replace("boundary m f f", "boundary f f m").replace(
        "velocity first set 0.5 0 0", "velocity first set 0 0 0.5"
    )
    text = re.sub(r"single (\S+) 0 0", r"single 0 0 \1", text)
    return re.sub(r"block (\S+ \S+) (\S+ \S+) (\S+ \S+)", r"block \2 \3 \1", text)


def languages() -> Iterable[Variant]:
    """Yield what the language of scripts allows: files, loops, variables, several runs."""
    coarse, fine = script(per_contact=10.0), script(per_contact=100.0)
    step, count = re.search(r"timestep (\S+)", coarse), re.search(r"run (\d+)", coarse)
    assert step is not None
    assert count is not None
    dt, n = step[1], int(count[1])
    loop = (
        "variable k loop 5\nlabel again\nvariable x equal 2*5e-3*(v_k-1)\n"
        "create_atoms 1 single ${x} 0 0 units box\nnext k\njump SELF again"
    )
    rows = "\n".join(f"{k + 1} 1 {2 * RADIUS:g} {DENSITY:g} {2 * RADIUS * k:.15g} 0 0" for k in range(5))
    box = "-0.02 0.07 xlo xhi\n-0.02 0.02 ylo yhi\n-0.02 0.02 zlo zhi"
    data = f"balls\n\n5 atoms\n2 atom types\n{box}\n\nAtoms # sphere\n\n{rows}\n"
    of_data = {"box": "", "atoms": "read_data balls.data", "sizes": ""}
    yield _deck("loop of atoms", "FAIL", script(per_contact=10.0, atoms=loop))
    yield _deck("read_data, coarse", "FAIL", script(per_contact=10.0, **of_data), balls_data=data)
    yield _deck("read_data, fine", "PASS", script(per_contact=100.0, **of_data), balls_data=data)
    yield _deck(
        "include of the law", "FAIL", script(per_contact=10.0, pair="", coefficients="include law.inc"),
        law_inc=f"pair_style granular\npair_coeff * * {BALLS}\n",
    )  # fmt: skip
    yield _deck(
        "include of step and run", "FAIL", script(per_contact=10.0, step="", run="include run.inc"),
        run_inc=f"timestep {dt}\nrun {n}\n",
    )  # fmt: skip
    yield _deck(
        "variables of step and run", "FAIL",
        script(step=f"variable dt equal {dt}\nvariable n equal {n}\ntimestep ${{dt}}", run="run ${n}"),
    )  # fmt: skip
    yield _deck("number of steps from dt", "FAIL", script(per_contact=10.0, run=f"run $(ceil({6 * CONTACT:.6g}/dt))"))
    yield _deck("several runs", "FAIL", script(per_contact=10.0, run=f"run {n // 2}\nrun {n - n // 2}"))
    yield _deck(
        "run in a loop", "FAIL",
        script(per_contact=10.0, run=f"variable r loop 6\nlabel more\nrun {n // 6}\nnext r\njump SELF more"),
    )  # fmt: skip
    yield _deck("run upto", "FAIL", script(per_contact=10.0, run=f"run {n} upto"))
    yield _deck(
        "two time steps", "FAIL",
        script(per_contact=10.0, run=f"run {n // 2}\ntimestep {float(dt) / 2:g}\nrun {n}"),
    )  # fmt: skip
    yield _deck("no timestep", "PASS", script(step="", run="run 20000"))
    yield _deck("no run, coarse", "FAIL", script(per_contact=10.0, run=""))
    yield _deck("run 0, fine", "PASS", script(per_contact=100.0, run="run 0"))
    yield _deck("run every", "FAIL", script(per_contact=10.0, run=f'run {n} every {n // 3} "print hello"'))
    yield _deck("comments and continued lines", "FAIL", coarse.replace(f"run {n}", f"run &\n {n} # steps"))
    yield _deck("own dump of a step that is fine", "PASS", fine + "write_data end.data\n")
    yield Variant(
        name="a variable of -var",
        files={"in.chain": coarse.replace(f"timestep {dt}", "timestep ${dt}")},
        outcome="FAIL",
        variables={"dt": dt},
    )


def mixtures() -> Iterable[Variant]:
    """Yield two types, of which no line names the pair, and other faults of contacts."""
    kinds = "set atom 3*5 type 2"
    sizes = f"{kinds}\nset group all diameter {2 * RADIUS:g}\nset group all density {DENSITY:g}"
    brass = f"hertz/material 1e11 0 0.35 {UNDAMPED}"
    two = {"sizes": sizes, "coefficients": f"pair_coeff 1 1 {BALLS}\npair_coeff 2 2 {brass}"}
    yield _deck("two materials, mixed", "FAIL", script(per_contact=10.0, **two))
    stiff = {
        "sizes": sizes,
        "coefficients": f"pair_coeff 1 1 hertz 1e11 0 {UNDAMPED}\npair_coeff 2 2 hertz 1e10 0 {UNDAMPED}",
    }
    yield _deck("two stiffnesses, mixed", "FAIL", script(per_contact=10.0, **stiff), said="geometric mean")
    seldom = "neighbor 1e-6 bin\nneigh_modify delay 100000 every 100000 check no"
    gaps = "\n".join(f"create_atoms 1 single {2.02 * RADIUS * k:.15g} 0 0 units box" for k in range(5))
    yield _deck(
        "contacts missed", "FAIL",
        script(per_contact=100.0, length=60.0, neighbour=seldom, atoms=gaps, comm="comm_modify vel yes cutoff 0.02"),
        "FAIL", "contacts are missed",
    )  # fmt: skip
    yield _deck(
        "bodies leave the box",
        "BROKEN",
        script(
            boundary="boundary f f f",
            box="region box block -0.011 0.046 -0.02 0.02 -0.02 0.02 units box\ncreate_box 2 box",
            length=900.0,
        ),
        "BROKEN",
        "leaves the box",
    )
    yield _deck(
        "bodies leave the box, and the step is too coarse",
        "FAIL",
        script(
            per_contact=3.0,
            boundary="boundary f f f",
            box="region box block -0.011 0.046 -0.02 0.02 -0.02 0.02 units box\ncreate_box 2 box",
            length=900.0,
        ),
        "BROKEN",
        "leaves the box",
    )


def beyond() -> Iterable[Variant]:
    """Yield what cannot be read as a chain: it is named by its line, and is not called wrong."""
    off = "\n".join(f"create_atoms 1 single {2.0 * RADIUS * k:.15g} {1e-3 * (k == 2):g} 0 units box" for k in range(5))
    yield _deck("a body off the line, coarse", "FAIL", script(per_contact=10.0, atoms=off), "UNDECIDED", "off the line")
    yield _deck(
        "a body off the line, lost by the step", "FAIL",
        script(per_contact=1.2, length=20.0, atoms=off, boundary="boundary f f f"), "UNDECIDED", "loses bodies",
    )  # fmt: skip
    yield _deck("a body off the line, fine", "UNDECIDED", script(per_contact=200.0, atoms=off), "UNDECIDED", "line ")
    pair = "\n".join(
        f"create_atoms 1 single {2.0 * RADIUS * k:.15g} {row * 0.012:g} 0 units box" for row in (0, 1) for k in range(3)
    )
    yield _deck("two chains", "UNDECIDED", script(per_contact=200.0, atoms=pair), "UNDECIDED", "line ")
    table = "# table\n\nBALLS\nN 400 R 0.009 0.01\n\n" + "".join(
        f"{k + 1} {0.009 + 0.001 * k / 399:.12g} {0.4 * 1e9 * (0.001 - 0.001 * k / 399) ** 2.5:.12g}"
        f" {1e9 * (0.001 - 0.001 * k / 399) ** 1.5:.12g}\n"
        for k in range(400)
    )
    yield _deck(
        "a table", "FAIL",
        script(
            per_contact=300.0, contact=3e-4, pair="pair_style table linear 400",
            coefficients="pair_coeff * * t.table BALLS",
        ),
        "FAIL", "its lines are wrong or too far apart", t_table=table,
    )  # fmt: skip
    jkr = f"jkr {MODULUS:g} 0 {POISSON:g} 0.1 tangential linear_nohistory 0 0 damping velocity"
    yield _deck("jkr", "FAIL", script(per_contact=200.0, **_coefficients(jkr)), "UNDECIDED", "jkr-breaks-early")
    yield _deck(
        "an unknown fix",
        "UNDECIDED",
        script(per_contact=200.0, more="fix cap all nve/limit 1e-3", fixes=""),
        "UNDECIDED",
        "nve/limit",
    )
    yield _deck("an unknown pair style", "BROKEN", script(pair="pair_style granulr"), "BROKEN", "granulr")


def variants() -> tuple[Variant, ...]:
    """Return all variants."""
    parts = (steps, units, laws, dampings, walls, conditions, languages, mixtures, beyond)
    return tuple(variant for part in parts for variant in part())


def written(files: Mapping[str, str], advice: Iterable[str]) -> dict[str, str]:
    """Return the files of a script with the lines of an answer written as it says: in place of a line, or before it."""
    changed = {name: text.splitlines() for name, text in files.items()}
    shift: dict[tuple[str, int], int] = {}
    for entry in advice:
        line, place = entry.rsplit("  # ", 1)
        match = re.fullmatch(r"(before )?line (\d+) of (\S+)", place)
        assert match is not None, entry
        at, file = int(match[2]), match[3]
        moved = sum(number for (name, other), number in shift.items() if name == file and other <= at)
        lines = changed[file]
        if match[1]:
            lines.insert(at - 1 + moved, line)
            shift[file, at] = shift.get((file, at), 0) + 1
        else:
            last = at - 1 + moved
            while lines[last].rstrip().endswith("&"):  # a continued line is replaced as a whole
                lines[last] = ""
                last += 1
            lines[last] = ""
            lines[at - 1 + moved] = line
    return {name: "\n".join(lines) + "\n" for name, lines in changed.items()}
