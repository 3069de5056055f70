"""Extremes of touch: grazes, gaps, distances, precompression, and nothing at all."""

from __future__ import annotations

from collections.abc import Iterator

from dem_bridge.scene import Wall
from dem_bridge.studies.extremes.entry import (
    BETA,
    ENGINE,
    MASS,
    SPEED,
    VERLET,
    Entry,
    chain,
    contact_time,
    plain,
    refused,
    theories_refuse,
)
from dem_bridge.studies.extremes.judge import Expected, Word
from dem_bridge.studies.extremes.truths import apart, by_others, nothing_happens, shorter, two_bodies


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
            expected=theories_refuse("the scene has walls"),
        )
    crawl = chain("closing-1e-12", bodies=2, velocity=(SPEED + SPEED * 2.0**-40, SPEED), samples=3,
                  duration=3.0 * contact_time(speed=SPEED * 2.0**-40))  # fmt: skip
    yield Entry(
        name=crawl.name,
        asks="two bodies in flight that close in on each other 1e-12 times as fast as they fly",
        scene=crawl,
        truths=(two_bodies(crawl), by_others(crawl)),
        expected=theories_refuse("bodies behind the first that move"),
    )
    early = chain("front-barely-begun", times=0.1)
    yield Entry(
        name=early.name,
        asks="a tenth of a contact time: forces ahead of the front down to nothing",
        scene=early,
        truths=(by_others(early), shorter(early, 8)),
    )


def gaps() -> Iterator[Entry]:
    closed = theories_refuse("the scene has gaps")
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
        truths=(by_others(cut), apart(cut, 4)), expected=theories_refuse("the scene has gaps"),
    )  # fmt: skip
    for far in (1e3, 1e6, 1e9, 1e12):
        scene = chain(f"far-{plain(far)}", gap=(far, *[0.0] * 8), velocity=(0.0, SPEED, *[0.0] * 8))
        # overlaps are of 1e-5 m; positions of 1e9 m are known to 1e-7 m, those of 1e12 m to 1e-4 m. The bars of all
        # fixed steps come from a twin in positions
        vague = {ENGINE: refused("known to 0.00012 m"), VERLET: Expected(Word.NO_BAR)} if far >= 1e12 else {}
        yield Entry(
            name=scene.name, asks=f"a chain {far:g} m from the origin", scene=scene,
            truths=(by_others(scene), apart(scene, 0)),
            expected=theories_refuse("the scene has gaps", **vague),
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
            expected=theories_refuse("the scene has precompression"),
        )


def nothing() -> Iterator[Entry]:
    rest = chain("at-rest", velocity=(0.0,) * 10)
    yield Entry(
        name=rest.name, asks="a striker at rest: nothing moves", scene=rest, truths=(nothing_happens(rest),),
        expected=theories_refuse("body 0 starts with a velocity of 0 m/s"),
    )  # fmt: skip
    flight = chain("all-together", velocity=(768.0,) * 10)
    yield Entry(
        name=flight.name, asks="all bodies fly on in touch, at 768 m/s", scene=flight,
        truths=(nothing_happens(flight),), expected=theories_refuse("bodies behind the first that move"),
    )  # fmt: skip
