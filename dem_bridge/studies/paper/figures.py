"""The numerical panels of the paper's figures 2 to 6: trajectories in, Exhibits out. Letters are the paper's.

Maps are thinned to what a picture shows and rounded; lines are in full precision.
"""

from __future__ import annotations

from collections.abc import Sequence

from dem_bridge.errors import UsageError
from dem_bridge.studies.paper import panels as panel
from dem_bridge.studies.paper.panels import GUIDE, MAP_DIGITS, MAP_ROWS, ChainRuns, Ratios
from dem_bridge.studies.study import FigureData

DECELERATING, ACCELERATING = "2° to 90°, decelerating", "90° to 2°, accelerating"
GRADIENTS = (
    "(a) 2° to 90°, gamma = -0.01",
    "(b) 2° to 90°, gamma = +0.01",
    "(d) 90° to 2°, gamma = -0.01",
    "(e) 90° to 2°, gamma = +0.01",
)
#: times the arrival at the end: the secondary pulses of the short chain are then on the map
_SHORT, _LONG = 1.3, 1.1
_THINNED = (
    f"Maps are thinned to {MAP_ROWS} times or frequencies at most and rounded to 1e-{MAP_DIGITS} of their largest"
    " value."
)


def figure_2(decelerating: ChainRuns, accelerating: ChainRuns) -> FigureData:
    """Velocity over cylinder and time with the fronts by theory (panels a and c; b and d are measurements)."""
    chains = (decelerating, accelerating)
    end = panel.window(chains, _SHORT)
    return FigureData(
        id="figure-2",
        title="Figure 2: velocity of the cylinders",
        caption="Velocity over cylinder and time, with the front as theories have it. The striker is left out. Panels b"
        f" and d of the paper are measurements. {_THINNED}",
        panels=tuple(
            panel.velocity_map(title, chain, end, shares=(0, 1))
            for title, chain in zip(_titles("a", "c"), chains, strict=True)
        ),
    )


def figure_3(decelerating: ChainRuns, accelerating: ChainRuns) -> FigureData:
    """Residence time (a, b) and wave speed (c, d) along the chains, with the power-law fit of the speed."""
    chains = (decelerating, accelerating)
    times = zip(_titles("a", "b"), chains, strict=True)
    speeds = zip(_titles("c", "d"), chains, strict=True)
    return FigureData(
        id="figure-3",
        title="Figure 3: residence time and wave speed along the chain",
        caption="Residence time between crossings and wave speed, spacing over residence time. The fit is the paper's"
        " V = (b1 + b2 i)^(1/n), here to the reference; the paper fits it to measurements.",
        panels=(
            *(panel.residence_times(title, chain, shares=(0, 1)) for title, chain in times),
            *(panel.wave_speeds(title, chain, shares=(2, 3)) for title, chain in speeds),
        ),
    )


def figure_4(decelerating_200: ChainRuns, accelerating_200: ChainRuns) -> FigureData:
    """Return figure 4: velocity maps (a, d), frequency along the chain (b, e) and wavenumber in time (c, f).

    The inset of (a), and its counterpart for (d), are included.
    """
    chains = (decelerating_200, accelerating_200)
    end = panel.window(chains, _LONG)
    maps = zip(_titles("a", "d"), chains, strict=True)
    insets = zip(_titles("a, inset", "d, inset"), chains, strict=True)
    return FigureData(
        id="figure-4",
        title="Figure 4: spectra of the impulse",
        caption="Velocity, its spectrum in time along the chain, its spectrum along the chain in time. Power is"
        " relative to the largest of its column; that in c and f is the mean over the times that a column stands for."
        f" The striker is left out. {_THINNED}",
        panels=(
            *(panel.velocity_map(title, chain, end, shares=(0, 1), theories=()) for title, chain in maps),
            *panel.frequencies(_titles("b", "e"), chains, place=2),
            *panel.wavenumbers(_titles("c", "f"), chains, place=4),
            *(panel.velocity_in_the_middle(title, chain, shares=(6, 7)) for title, chain in insets),
        ),
    )


def figure_5(decelerating_200: ChainRuns, accelerating_200: ChainRuns) -> FigureData:
    """Peak force along the chain (a, b) and against stiffness (c, d), and the insets: force over time in the middle."""
    chains = (decelerating_200, accelerating_200)
    along = zip(_titles("a", "b"), chains, strict=True)
    against = zip(_titles("c", "d"), chains, strict=True)
    insets = zip(_titles("a, inset", "b, inset"), chains, strict=True)
    return FigureData(
        id="figure-5",
        title="Figure 5: scaling of the contact force",
        caption="Largest force of each contact along the chain and against its stiffness. The guide has the slope 2/5"
        f" of binary collisions and stands {GUIDE - 1.0:.0%} above the fit in its middle. In the paper the stiffness"
        " axis of c runs the other way.",
        panels=(
            *(panel.peak_forces(title, chain, shares=(0, 1)) for title, chain in along),
            *(panel.force_against_stiffness(title, chain, shares=(2, 3)) for title, chain in against),
            *(panel.force_in_the_middle(title, chain, shares=(4, 5)) for title, chain in insets),
        ),
    )


def figure_6(maps: Sequence[ChainRuns], decelerating: Ratios, accelerating: Ratios) -> FigureData:
    """Maps of chains with mass gradients (a, b, d, e) and V_out/V_in against the gradient (c, f).

    ``maps``: decelerating with gamma = -0.01 and +0.01, then accelerating with the same; UsageError for another
    number. ``decelerating`` and ``accelerating``: gamma with V_out/V_in by backend; nan, or no entry, where a backend
    has none.
    """
    if len(maps) != len(GRADIENTS):
        raise UsageError(f"{len(maps)} maps; figure 6 has {len(GRADIENTS)}: {', '.join(GRADIENTS)}")
    end = panel.window(maps, _SHORT)
    letters = _titles("c", "f")
    return FigureData(
        id="figure-6",
        title="Figure 6: mass gradients",
        caption="Velocity in chains whose masses follow m (1 + gamma i), with the front as theories have it, and the"
        f" ratio of the wave speeds at both ends. The striker is left out. {_THINNED}",
        panels=(
            *(
                panel.velocity_map(title, chain, end, shares=(0, 1, 2, 3))
                for title, chain in zip(GRADIENTS, maps, strict=True)
            ),
            panel.speed_ratios(letters[0], decelerating),
            panel.speed_ratios(letters[1], accelerating),
        ),
    )


def _titles(first: str, second: str) -> tuple[str, str]:
    return f"({first}) {DECELERATING}", f"({second}) {ACCELERATING}"


__all__ = ["ChainRuns", "Ratios", "figure_2", "figure_3", "figure_4", "figure_5", "figure_6"]
