"""Extremes of touch: grazes, gaps, distances, precompression, and nothing at all."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

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
    entry,
    plain,
    refused,
    theories_refuse,
)
from dem_bridge.studies.extremes.judge import Expected, Word
from dem_bridge.studies.extremes.truths import apart, by_others, nothing_happens, shorter, two_bodies

GAPS, MOVING = theories_refuse("the scene has gaps"), theories_refuse("bodies behind the first that move")


def touches() -> Iterator[Entry]:
    """Yield contacts that hardly touch."""
    # a ball thrown up at a ceiling, which is where it would turn, or next to it
    g, up = -1e3, SPEED
    height = up**2 / (2.0 * -g)
    for share in (1e-12, 1e-6, 1e-3, -1e-12, -1e-6):
        where = "below" if share > 0.0 else "above"
        ceiling = Wall(stiffness=BETA, gap=height * (1.0 - share))
        name = f"graze-{plain(abs(share))}-{where}"
        yield entry(
            chain(name, bodies=1, gravity=g, wall_right=ceiling, duration=1.5 * up / -g),
            f"a ball that rises to a ceiling {abs(share):g} of its way {where} where it turns",
            expected=theories_refuse("the scene has walls"),
        )
    crawl = chain("closing-1e-12", bodies=2, velocity=(SPEED + SPEED * 2.0**-40, SPEED), samples=3,
                  duration=3.0 * contact_time(speed=SPEED * 2.0**-40))  # fmt: skip
    asks = "two bodies in flight that close in on each other 1e-12 times as fast as they fly"
    yield entry(crawl, asks, two_bodies, by_others, expected=MOVING)
    asks = "a tenth of a contact time: forces ahead of the front down to nothing"
    yield entry(chain("front-barely-begun", times=0.1), asks, by_others, partial(shorter, bodies=8))


def gaps() -> Iterator[Entry]:
    """Yield gaps from the last digits of a position to a thousand kilometres."""
    yield entry(chain("gaps-1e-15", bodies=6, gap=1e-15), "gaps of 1e-15 m", expected=GAPS)
    wide = chain("gaps-of-metres", bodies=4, speed=1e3, gap=2.0, duration=6.5e-3)
    yield entry(wide, "gaps of 2 m, and a flight of 2 ms between contacts of 10 us", expected=GAPS)
    pair = chain("gap-in-front", bodies=2, speed=1e3, gap=2.0, duration=6e-3, samples=3)
    asks = "one flight over 2 m into one contact, beside the closed form"
    yield entry(pair, asks, two_bodies, by_others, expected=GAPS)
    still = [0.0] * 4
    cut = chain("cut-at-a-gap", gap=(*still, 1.0, *still), velocity=(SPEED, *still, SPEED, *still))
    asks = "two chains 1 m apart that never meet: each as if alone"
    yield entry(cut, asks, by_others, partial(apart, at=4), expected=GAPS)
    for far in (1e3, 1e6, 1e9, 1e12):
        scene = chain(f"far-{plain(far)}", gap=(far, *[0.0] * 8), velocity=(0.0, SPEED, *[0.0] * 8))
        # overlaps are of 1e-5 m; positions of 1e9 m are known to 1e-7 m, those of 1e12 m to 1e-4 m. The bars of all
        # fixed steps come from a twin in positions
        vague = {ENGINE: refused("known to 0.00012 m"), VERLET: Expected(Word.NO_BAR)} if far >= 1e12 else {}
        yield entry(scene, f"a chain {far:g} m from the origin", by_others, partial(apart, at=0), expected=GAPS | vague)


def presses() -> Iterator[Entry]:
    """Yield precompressed chains."""
    dynamic = (1.25 * 0.5 * MASS * SPEED**2 / BETA) ** 0.4
    for share in (1e-9, 1e-3, 1.0, 1e3):
        force = BETA * (share * dynamic) ** 1.5
        # a wave in a chain pressed so much is faster
        scene = chain(f"pressed-{plain(share)}", precompression=force, times=5.0 / max(1.0, share**0.25))
        asks = f"a chain pressed to {share:g} of the dynamic overlap, and struck"
        yield entry(scene, asks, expected=theories_refuse("the scene has precompression"))


def nothing() -> Iterator[Entry]:
    """Yield scenes in which nothing happens."""
    rest, start = chain("at-rest", velocity=(0.0,) * 10), theories_refuse("body 0 starts with a velocity of 0 m/s")
    yield entry(rest, "a striker at rest: nothing moves", nothing_happens, expected=start)
    flight = chain("all-together", velocity=(768.0,) * 10)
    yield entry(flight, "all bodies fly on in touch, at 768 m/s", nothing_happens, expected=MOVING)
