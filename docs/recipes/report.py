"""Write docs/peers.md: one chain in several codes, judged. ``make peers`` runs this script.

    python docs/recipes/report.py [-o docs/peers.md] [CODE ...]

Codes that are not installed are left out, with what to install. The Python that has the packages of the extra "peers"
is that of the environment variable DEM_BRIDGE_PEERS, or the one that runs this script.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tomllib
from datetime import date
from pathlib import Path

import dem_bridge as db

HERE = Path(__file__).parent
DATA = HERE.parents[1] / "tests" / "data" / "foreign"
CODES = tomllib.loads((HERE / "codes.toml").read_text(encoding="utf-8"))
PYTHON = os.environ.get("DEM_BRIDGE_PEERS", sys.executable)
#: s; 1000, 2000 and 4000 steps
STEPS = (1e-7, 5e-8, 2.5e-8)


def command_of(name):
    """Return the command that runs a recipe."""
    return f"{PYTHON} {HERE}/{CODES[name]['recipe']}"


def title_of(name):
    """Return the name of a code with its integrator, in few words."""
    return f"{CODES[name]['title']}, {CODES[name]['integrator'].partition(' (')[0].partition(';')[0]}"


def short(value):
    """Return a number with two digits after the point, which no line breaks."""
    digits, _, power = f"{value:.2e}".partition("e")
    return f"`{digits}e{int(power)}`"


def missing(name):
    """Return why a code cannot run here; '' if it can."""
    needs, install = CODES[name]["needs"], CODES[name]["install"]
    found = shutil.which(needs) is not None
    if not found and install.startswith("pip"):
        found = subprocess.run([PYTHON, "-c", f"import {needs}"], capture_output=True, check=False).returncode == 0
    return "" if found else f"not installed here: {install}"


def judge(name, scene, steps=STEPS):
    """Return the judgement of a code on a scene of tests/data/foreign."""
    return db.judge(scene=DATA / f"{scene}.toml", command=command_of(name), dt=steps)


def order_text(judgement, quantity):
    """Return an observed order with its uncertainty."""
    order = judgement.order.get(quantity)
    if order is None:
        return "-"
    bar = max(order["uncertainty"], 0.001)
    return f"`{order['value']:.3f}`" + (f" +- {bar:.3f}" if bar >= 0.0015 else "")


def rows_of(table, code):
    """Return error and CPU time of a code at each step from the table of work-precision, coarse to fine."""
    return [(row[2], row[5]) for row in sorted(table.rows, key=lambda row: -row[1]) if row[0] == code]


def line(cells):
    """Return a row of a table in Markdown."""
    return f"| {' | '.join(cells)} |"


def table(scene, names):
    """Yield the lines of the table of one scene."""
    heads = ["code", "fault", *(f"error at {dt:g} s" for dt in STEPS), "order of v", "order of x", "CPU time (s)"]
    yield line(heads)
    yield line(["---"] * len(heads))
    ours = {}
    for name in names:
        if reason := missing(name):
            yield line([title_of(name), reason, *[""] * (len(heads) - 2)])
            continue
        print(f"{scene}: {name}", file=sys.stderr)
        judgement = judge(name, scene)
        (runs,) = (item for item in judgement.study.tables if item.id == "work-precision")
        own = runs.rows[0][0]
        values = rows_of(runs, own)
        orders = [order_text(judgement, quantity) for quantity in ("velocity", "displacement")]
        fault = " or ".join([judgement.cause, *judgement.alternative_causes])
        errors = [short(error) for error, _ in values]
        yield line([title_of(name), fault, *errors, *orders, f"{values[-1][1]:.2g}"])
        ours = {row[0]: rows_of(runs, row[0]) for row in runs.rows if row[0] != own} or ours
    for name, values in ours.items():
        errors = [short(error) for error, _ in values]
        yield line([f"{name}, velocity Verlet", "", *errors, "", "", f"{values[-1][1]:.2g}"])


def main():
    """Write the page."""
    parser = argparse.ArgumentParser(description="Write the page that compares codes on one chain.")
    parser.add_argument("codes", nargs="*", metavar="CODE", help=f"of {', '.join(CODES)}; default: all")
    parser.add_argument("-o", "--output", type=Path, default=HERE.parent / "peers.md")
    options = parser.parse_args()
    names = options.codes or list(CODES)
    if unknown := [name for name in names if name not in CODES]:
        sys.exit(f"there is no recipe {unknown[0]}; allowed: {', '.join(CODES)}")
    text = (HERE / "peers.md.template").read_text(encoding="utf-8")
    beware = [line(["code", "integrator", "how the contact is given", "beware"]), line(["---"] * 4)]
    beware += [line([CODES[name][key] for key in ("title", "integrator", "law", "beware")]) for name in names]
    parts = {
        "equal": "\n".join(table("ten-beads", names)),
        "graded": "\n".join(table("ten-beads-graded", names)),
        "beware": "\n".join(beware),
        "date": date.today().isoformat(),
    }
    for key, part in parts.items():
        text = text.replace(f"@{key}@", part)
    options.output.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
