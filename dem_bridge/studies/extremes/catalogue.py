"""The extremes: what physics can be stretched to."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.lammps import LammpsTable
from dem_bridge.backends.reference import Reference
from dem_bridge.backends.survey import Survey
from dem_bridge.backends.tabled import tables_for
from dem_bridge.lmp.pairing import TableSet
from dem_bridge.physics.hertz import crossed_cylinders
from dem_bridge.scene import Scene, Wall
from dem_bridge.scene_file import load_scene
from dem_bridge.studies.extremes.entry import (
    BETA,
    ENGINE,
    FIXED_STEP,
    MASS,
    SPEED,
    Entry,
    chain,
    checked,
    contact_time,
    refused,
    theories_refuse,
)
from dem_bridge.studies.extremes.judge import Expected, Word
from dem_bridge.studies.extremes.truths import (
    apart,
    back_again,
    by_others,
    galilei,
    mirrored,
    nothing_happens,
    scaled,
    shorter,
    two_bodies,
)

NO_BAR = Expected(Word.NO_BAR)
ONE_CONTACT = refused("one contact")


def plain(value: float) -> str:
    """As people write it, and names of scenes may have it: 1e6, 1e-9, 0.001."""
    return f"{value:g}".replace("e+0", "e").replace("e+", "e").replace("e-0", "e-")


def speeds() -> Iterator[Entry]:
    for speed in (1e-9, 1e-3, 1e3):
        pair = chain(f"pair-at-{plain(speed)}", bodies=2, speed=speed, samples=3)
        # ode45's absolute tolerance of 1e-6 m/s sees nothing of 1e-9 m/s; that no step of it is longer than a tenth of
        # the duration is what leaves a number, with a wide bar
        yield Entry(
            name=pair.name,
            asks=f"two bodies at {speed:g} m/s, beside the closed form",
            scene=pair,
            truths=(two_bodies(pair), by_others(pair)),
            expected={"adiabatic": ONE_CONTACT},
        )
        scene = chain(f"speed-{plain(speed)}", speed=speed)
        yield Entry(
            name=scene.name,
            asks=f"a chain struck at {speed:g} m/s: nothing but scales changes",
            scene=scene,
            truths=(by_others(scene), scaled(scene, speed)),
        )
    quick = chain("speed-32-times", speed=32 * SPEED)
    yield Entry(
        name=quick.name,
        asks="v0 -> 32 v0 and dt -> dt/2: powers of two throughout, the twin repeats itself bit for bit",
        scene=quick,
        truths=(by_others(quick), scaled(quick, 32.0, to_the_bit=("verlet",))),
    )


def angles() -> Iterator[Entry]:
    angle = np.geomspace(90.0, 0.001, 9)
    beta = [crossed_cylinders(angle=a, radius=9e-3, young=72e9, poisson=0.17).stiffness for a in angle.tolist()]
    for name, betas, way in (
        ("angles-90-to-0.001", beta, "stiffer and stiffer"),
        ("angles-0.001-to-90", beta[::-1], "softer and softer"),
    ):
        scene = chain(name, stiffness=betas)
        yield Entry(
            name=name,
            asks=f"contact angles over {beta[-1] / beta[0]:.0f} in stiffness, {way}",
            scene=scene,
            truths=(by_others(scene),),
        )


def ratios() -> Iterator[Entry]:
    heavy = chain("mass-heavy-striker", mass=[1e6 * MASS, *[MASS] * 4], times=3.0)
    light = chain("mass-light-striker", mass=[1e-6 * MASS, *[MASS] * 4], times=0.1)
    for scene, what in ((heavy, "a striker of 1e6 masses"), (light, "a striker of 1e-6 masses")):
        yield Entry(name=scene.name, asks=what, scene=scene, truths=(by_others(scene),))
    between = chain("mass-light-between", mass=[MASS, 1e-6 * MASS, MASS], times=0.3)
    yield Entry(
        name=between.name,
        asks="a body of 1e-6 masses between two, which meets them some hundred times",
        scene=between,
        truths=(by_others(between),),
        slow=True,
    )
    stiff = chain("stiffness-1e8", stiffness=[BETA, 1e8 * BETA, BETA], times=1.0)
    yield Entry(
        name=stiff.name,
        asks="one contact 1e8 times as stiff as the others",
        scene=stiff,
        truths=(by_others(stiff),),
        phase=0.05,
        slow=True,
    )


def sizes() -> Iterator[Entry]:
    pair = chain("bodies-2", bodies=2, samples=3)
    yield Entry(
        name=pair.name,
        asks="the least chain",
        scene=pair,
        truths=(two_bodies(pair), by_others(pair)),
        expected={"adiabatic": ONE_CONTACT},
    )
    row = chain("bodies-100000", bodies=100_000, times=12.0, samples=2)
    yield Entry(
        name=row.name,
        asks="1e5 bodies, and a front that has passed some thirty: it knows nothing of the others",
        scene=row,
        truths=(shorter(row, 200, own=False), shorter(row, 200)),
        phase=0.1,
        left_out={"scipy": "it takes more than 500 s: 1e5 unknowns at each of a hundred events"},
        slow=True,
    )


def touches() -> Iterator[Entry]:
    # a ball thrown up at a ceiling, which is where it would turn, or next to it
    g, up = -1e3, SPEED
    height = up**2 / (2.0 * -g)
    for share in (1e-12, 1e-6, 1e-3, -1e-12, -1e-6):
        where = "below" if share > 0.0 else "above"
        name = f"graze-{plain(abs(share))}-{where}"
        scene = chain(
            name,
            bodies=1,
            gravity=g,
            wall_right=Wall(stiffness=BETA, gap=height * (1.0 - share)),
            duration=1.5 * up / -g,
        )
        yield Entry(
            name=name,
            asks=f"a ball that rises to a ceiling {abs(share):g} of its way {where} where it turns",
            scene=scene,
            truths=(by_others(scene),),
            expected=theories_refuse("there is a wall"),
        )
    crawl = chain("closing-1e-12", bodies=2, velocity=(SPEED + SPEED * 2.0**-40, SPEED), samples=3,
                  duration=3.0 * contact_time(speed=SPEED * 2.0**-40))  # fmt: skip
    yield Entry(
        name=crawl.name,
        asks="two bodies in flight that close in on each other 1e-12 times as fast as they fly",
        scene=crawl,
        truths=(two_bodies(crawl), by_others(crawl)),
        expected=theories_refuse("more than one body moves"),
    )
    early = chain("front-barely-begun", times=0.1)
    yield Entry(
        name=early.name,
        asks="a tenth of a contact time: forces ahead of the front down to nothing",
        scene=early,
        truths=(by_others(early), shorter(early, 8)),
    )


def gaps() -> Iterator[Entry]:
    closed = theories_refuse("there are gaps")
    narrow = chain("gaps-1e-15", bodies=6, gap=1e-15)
    yield Entry(name=narrow.name, asks="gaps of 1e-15 m", scene=narrow, truths=(by_others(narrow),), expected=closed)
    wide = chain("gaps-of-metres", bodies=4, speed=1e3, gap=2.0, duration=6.5e-3)
    yield Entry(
        name=wide.name, asks="gaps of 2 m, and a flight of 2 ms between contacts of 10 us", scene=wide,
        truths=(by_others(wide),), expected=closed,
    )  # fmt: skip
    pair = chain("gap-in-front", bodies=2, speed=1e3, gap=2.0, duration=6e-3, samples=3)
    yield Entry(
        name=pair.name, asks="one flight over 2 m into one contact, beside the closed form", scene=pair,
        truths=(two_bodies(pair), by_others(pair)), expected=closed,
    )  # fmt: skip
    cut = chain("cut-at-a-gap", gap=(*[0.0] * 4, 1.0, *[0.0] * 4), velocity=(SPEED, *[0.0] * 4, SPEED, *[0.0] * 4))
    yield Entry(
        name=cut.name, asks="two chains 1 m apart that never meet: each as if alone", scene=cut,
        truths=(by_others(cut), apart(cut, 4)), expected=theories_refuse("there are gaps"),
    )  # fmt: skip
    for far in (1e3, 1e6, 1e9, 1e12):
        scene = chain(f"far-{plain(far)}", gap=(far, *[0.0] * 8), velocity=(0.0, SPEED, *[0.0] * 8))
        # overlaps are of 1e-5 m; positions of 1e9 m are known to 1e-7 m, those of 1e12 m to 1e-4 m. The bars of all
        # fixed steps come from a twin in positions
        vague = {ENGINE: refused("known to 0.00012 m"), FIXED_STEP: NO_BAR} if far >= 1e12 else {}
        yield Entry(
            name=scene.name, asks=f"a chain {far:g} m from the origin", scene=scene,
            truths=(by_others(scene), apart(scene, 0)),
            expected=theories_refuse("there are gaps", **vague),
        )  # fmt: skip


def presses() -> Iterator[Entry]:
    dynamic = (1.25 * 0.5 * MASS * SPEED**2 / BETA) ** 0.4
    for share in (1e-9, 1e-3, 1.0, 1e3):
        force = BETA * (share * dynamic) ** 1.5
        # a wave in a chain pressed so much is faster
        times = 5.0 / max(1.0, share**0.25)
        scene = chain(f"pressed-{plain(share)}", precompression=force, times=times)
        yield Entry(
            name=scene.name,
            asks=f"a chain pressed to {share:g} of the dynamic overlap, and struck",
            scene=scene,
            truths=(by_others(scene),),
            expected=theories_refuse("there is precompression"),
        )


def nothing() -> Iterator[Entry]:
    rest = chain("at-rest", velocity=(0.0,) * 10)
    yield Entry(
        name=rest.name, asks="a striker at rest: nothing moves", scene=rest, truths=(nothing_happens(rest),),
        expected=theories_refuse("does not move"),
    )  # fmt: skip
    flight = chain("all-together", velocity=(768.0,) * 10)
    yield Entry(
        name=flight.name, asks="all bodies fly on in touch, at 768 m/s", scene=flight,
        truths=(nothing_happens(flight),), expected=theories_refuse("more than one body moves"),
    )  # fmt: skip


def symmetries() -> Iterator[Entry]:
    moving = theories_refuse("more than one body moves")
    for u, name in ((-3.0, "galilei-backwards"), (768.0, "galilei-fast")):
        scene = chain(name, velocity=(SPEED + u, *[u] * 9))
        yield Entry(
            name=scene.name, asks=f"all move at {u:g} m/s besides: nothing else changes", scene=scene,
            truths=(by_others(scene), galilei(scene, u)), expected=moving,
        )  # fmt: skip
    beta = np.geomspace(BETA, 20 * BETA, 9).tolist()
    mirror = chain("mirror", stiffness=beta[::-1], velocity=(*[0.0] * 9, -SPEED), wall_left=Wall(stiffness=BETA))
    yield Entry(
        name=mirror.name, asks="a chain struck from its other end, on a wall", scene=mirror,
        truths=(by_others(mirror), mirrored(mirror)), expected=moving,
    )  # fmt: skip
    there = chain("there", stiffness=beta, times=4.0)
    forward = Reference().run(there, Resolution(), Sampling(count=there.samples))
    scene, truth = back_again(forward, there)
    scene = replace(scene, name="time-reversal")
    yield Entry(
        name=scene.name, asks="all velocities reversed at the end: back to the start", scene=scene,
        truths=(by_others(scene), truth), expected=moving,
    )  # fmt: skip


def exponents() -> Iterator[Entry]:
    for n in (1.5, 2.0, 2.0001, 2.001, 5.0, 6.0):
        # the force of a Hertz contact at 10 um
        beta = BETA * 1e-5 ** (2.5 - n)
        # below n = 2 contacts are the stiffer the less deep they are: there is no highest frequency to take a step from
        period = contact_time(stiffness=beta, exponent=n)
        scene = chain(f"n-{n:g}", exponent=n, stiffness=beta, duration=5.0 * period)
        expected = {}
        if n != 2.0:
            expected["lammps-granular"] = refused("exponent n")
        if not 2.0 <= n <= 5.0:
            expected["lammps-table"] = refused("allowed in a table: 2 to 5")
        if n < 2.1:
            # no steady pulse, and near n = 2 it is too wide to form
            expected["adiabatic"] = refused("exponent")
        yield Entry(
            name=scene.name, asks=f"n = {n:g}", scene=scene, truths=(by_others(scene), scaled(scene, 0.5)),
            expected=expected, dt=period / 200 if n < 2.0 else None,
        )  # fmt: skip


def tables() -> Iterator[Entry]:
    scene = chain("table-7-lines")
    yield Entry(
        name=scene.name, asks="a table one line shorter than any may be", scene=scene, truths=(by_others(scene),),
        settings={"lammps-table": {"table_lines": 7}}, expected={"lammps-table": refused("table_lines = 7")},
    )  # fmt: skip
    scene = chain("table-8-lines")
    yield Entry(
        name=scene.name, asks="the shortest table", scene=scene, truths=(by_others(scene),),
        settings={"lammps-table": {"table_lines": 8}},
    )  # fmt: skip
    scene = chain("table-2-points")
    yield Entry(
        name=scene.name, asks="a table of two points", scene=scene, truths=(by_others(scene),),
        settings={"lammps-table": {"table_points": 2}},
    )  # fmt: skip
    scene = chain("table-ends-a-line-short")
    yield Entry(
        name=scene.name, asks="a table that ends a line short of the deepest overlap", scene=scene,
        truths=(by_others(scene),), instead={"lammps-table": ShortTable},
        expected={"lammps-table": refused("table inner cutoff")},
    )  # fmt: skip


class ShortTable(LammpsTable):
    """Tables that end where the deepest overlap is foreseen, a line short of it."""

    def _tables(self, scene: Scene, resolution: Resolution, look: Survey) -> TableSet | None:
        found = tables_for(scene, resolution, look)
        deepest = float(np.max(look.peak_overlap))
        cut = {}
        for law, table in found.tables.items():
            kept = table.distance > table.distance[-1] - deepest
            cut[law] = replace(table, distance=table.distance[kept], energy=table.energy[kept], force=table.force[kept])
        return replace(found, tables=cut)


def steps() -> Iterator[Entry]:
    # linear springs between walls, pressed so that none opens: the limit is 2 over the highest frequency
    bodies, spring = 8, BETA * 1e-5**0.5
    highest = 2.0 * math.sqrt(spring / MASS) * math.cos(0.5 * math.pi / (bodies + 1))
    wall = Wall(stiffness=spring, exponent=2.0)
    for share, name in ((0.99, "below"), (1.01, "above")):
        dt = share * 2.0 / highest
        scene = chain(f"step-just-{name}-the-limit", bodies=bodies, exponent=2.0, stiffness=spring,
                      wall_left=wall, wall_right=wall, precompression=100.0 * SPEED * math.sqrt(MASS * spring),
                      duration=400 * dt)  # fmt: skip
        yield Entry(
            name=scene.name,
            asks=f"a step of {share:g} of the limit of velocity-Verlet",
            scene=scene,
            truths=(by_others(scene),),
            dt=dt,
            expected=theories_refuse(
                "there is precompression", **{FIXED_STEP: Expected(Word.NO_BAR, otherwise=Word.REFUSED)}
            ),
        )
    trap = replace(load_scene("decelerating-40"), name="step-in-the-trap", samples=60)
    yield Entry(
        name=trap.name,
        asks="a step of 4e-6 s on the paper's chain, where momentum and final energy look right and velocities are not",
        scene=trap,
        truths=(by_others(trap),),
        dt=4e-6,
    )
    over = chain("step-over-contacts", samples=3, times=12.0)
    yield Entry(
        name=over.name,
        asks="a step of four contact times",
        scene=over,
        truths=(by_others(over),),
        dt=over.duration / 3,
        expected={FIXED_STEP: Expected(Word.NO_BAR, otherwise=Word.REFUSED)},
    )


PARTS: tuple[Callable[[], Iterator[Entry]], ...] = (
    speeds, angles, ratios, sizes, touches, gaps, presses, nothing, symmetries, exponents, tables, steps,
)  # fmt: skip


def catalogue() -> dict[str, Entry]:
    """All entries by name."""
    return checked([entry for part in PARTS for entry in part()])
