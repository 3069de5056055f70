"""Grade the codes of this folder and LAMMPS by ``dem-bridge conform``: the table and the picture of docs/peers.md.

    python docs/recipes/grade.py [CODE ...]

``make peers`` runs this script after report.py. It writes docs/recipes/grades.txt, which docs/peers.md includes, and
docs/grades.svg. Codes that are not installed are left out; those of the extra "peers" run by the Python of
DEM_BRIDGE_PEERS.
"""

import shutil
import sys
from dataclasses import dataclass
from datetime import date

from report import CODES, HERE, command_of, missing, short, title_of

import dem_bridge as db

#: unseen scenes of each grade, and their seed
UNSEEN, SEED = 5, 1
TINY = HERE.parents[1] / "tests" / "judging" / "conformance" / "tiny_code.py"
LAWS = "dashpot,mass_velocity,kuwabara-kono,tsuji,coeff_restitution"
ALL = f"hertz,hooke,walls,gaps,gravity,precompression,several-moving,polydisperse,{LAWS}"
COLOURS = {"PASS": "#3a7d44", "FAIL": "#c8442f", "UNDECIDED": "#d9a441", "BROKEN": "#6b2d5c", "NOT_RUN": "#e4e4e4"}
#: what is in a field, so that it can be read without its colour
SIGNS = {"PASS": "", "FAIL": "x", "UNDECIDED": "?", "BROKEN": "!", "NOT_RUN": ""}
#: size of a field, and room for names and headings, px
WIDTH, HEIGHT, LEFT, TOP, RIGHT = 34, 22, 230, 150, 140


@dataclass(frozen=True)
class Code:
    """A code with its command and what it has."""

    title: str
    command: str
    features: str


def codes(names):
    """Yield the codes that can run here."""
    for name in names:
        if reason := missing(name):
            print(f"{name}: {reason}", file=sys.stderr)
            continue
        yield Code(title_of(name), command_of(name), CODES[name]["features"])
    lmp = shutil.which("lmp") or shutil.which("lmp", path=str(HERE.parents[1] / ".venv" / "bin"))
    if lmp:
        words = "-in {deck} -var dt {dt} -var dump {out.dump} -log none -screen none"
        yield Code("LAMMPS, velocity Verlet", f"{lmp} {words}", ALL)
    words = f"{sys.executable} {TINY} right {{scene}} {{dt}} {{out.csv}}"
    yield Code("a code of 60 lines, velocity Verlet", words, "hertz,walls,gaps,several-moving,polydisperse")


def columns(grade):
    """Return the names of the items; those of several scenes with the scene."""
    return [
        f"{item.name}: {item.scene}" if item.name == "restitution" and item.scene else item.name
        for item in grade.answers
    ]


def numbers(grade):
    """Return the numbers of all items by name."""
    return {item.name: item.numbers for item in grade.answers}


def share(value):
    """Return a step as a share of the contact time."""
    return "-" if value is None or value != value else f"1/{1.0 / value:.0f}"


def failing(item):
    """Return the cause of an item that failed, or the outcome of one without an answer."""
    return item.cause if item.outcome.value == "FAIL" else item.outcome.value


def rows(grades):
    """Yield the lines of the table."""
    heads = ["code", "items passed", "law: off by", "order of v", "order of x", "delay of v (dt)", "digits written"]
    heads += ["stable up to", "error 1e-2 up to", "what failed"]
    yield f"| {' | '.join(heads)} |"
    yield f"| {' | '.join(['---'] * len(heads))} |"
    for code, grade in grades:
        n, score = numbers(grade), grade["score"]
        asked = sum(score.values()) - score["not_run"]
        order, step = n["order"], n["largest-step"]
        bad = [item for item in grade.answers if item.outcome.value in ("FAIL", "UNDECIDED", "BROKEN")]
        cells = [
            code.title,
            f"{score['passed']} of {asked}",
            short(n["law"].get("difference", float("nan"))),
            *(f"{order[key]:.2f}" if key in order else "-" for key in ("order_of_velocity", "order_of_displacement")),
            f"{n['phase'].get('late_steps_of_velocity', 0.0):.2f}",
            f"{n['digits'].get('digits', 0.0):.1f}",
            *(share(step.get(key)) for key in ("stable", "error_0.01")),
            "; ".join(f"`{item.name}`: {failing(item)}" for item in bad) or "-",
        ]
        yield f"| {' | '.join(cells)} |"


def field(x, y, outcome, width, name):
    """Yield a coloured field with the sign of an outcome."""
    title = f"<title>{name}: {outcome}</title>"
    yield f'<rect x="{x}" y="{y}" width="{width}" height="{HEIGHT - 2}" fill="{COLOURS[outcome]}">{title}</rect>'
    if sign := SIGNS[outcome]:
        place = f'x="{x + width // 2}" y="{y + 15}" text-anchor="middle"'
        yield f'<text {place} fill="#fff" font-weight="bold">{sign}</text>'


def picture(grades):
    """Return a picture with a row for each code and a column for each item."""
    names = list(dict.fromkeys(name for _, grade in grades for name in columns(grade) if name != "restitution"))
    width, height = LEFT + WIDTH * len(names) + RIGHT, TOP + HEIGHT * (len(grades) + 2)
    size = f'width="{width}" height="{height}" font-family="sans-serif" font-size="12"'
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" {size}>']
    parts.append(f'<rect width="{width}" height="{height}" fill="#fff"/>')
    for at, name in enumerate(names):
        x = LEFT + WIDTH * (at + 0.5)
        parts.append(f'<text transform="translate({x:.0f},{TOP - 6}) rotate(-45)">{name}</text>')
    for row, (code, grade) in enumerate(grades):
        y = TOP + HEIGHT * row
        parts.append(f'<text x="{LEFT - 8}" y="{y + 15}" text-anchor="end">{code.title}</text>')
        outcomes = dict(zip(columns(grade), (item.outcome.value for item in grade.answers), strict=True))
        for at, name in enumerate(names):
            parts += field(LEFT + WIDTH * at + 1, y + 1, outcomes.get(name, "NOT_RUN"), WIDTH - 2, name)
    for at, outcome in enumerate(COLOURS):
        x, y = LEFT + 120 * at, TOP + HEIGHT * (len(grades) + 1)
        parts += field(x, y, outcome, HEIGHT, outcome)
        parts.append(f'<text x="{x + 28}" y="{y + 15}">{outcome}</text>')
    return "\n".join([*parts, "</svg>", ""])


def main():
    """Grade the codes and write table and picture."""
    grades = []
    for code in codes(sys.argv[1:] or CODES):
        print(code.title, file=sys.stderr)
        grade = db.conform(code.command, features=code.features, scenes=UNSEEN, seed=SEED)
        print(grade.card(), file=sys.stderr)
        grades.append((code, grade))
    (HERE.parent / "grades.svg").write_text(picture(grades), encoding="utf-8")
    text = [f"{date.today().isoformat()}, set 1, {UNSEEN} unseen scenes of the seed {SEED}.", "", *rows(grades), ""]
    (HERE / "grades.txt").write_text("\n".join(text), encoding="utf-8")


if __name__ == "__main__":
    main()
