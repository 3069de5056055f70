"""The numerical panels of the paper's figures 2 to 6: trajectories in, figures as data out. Letters are the paper's.

Maps are thinned to what a picture shows and rounded; lines are in full precision.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from dem_bridge.backends.base import ENGINE_BACKENDS
from dem_bridge.errors import UsageError
from dem_bridge.report.study import FigureData
from dem_bridge.studies.paper import PAPER
from dem_bridge.studies.paper import panels as panel
from dem_bridge.studies.paper.panels import GUIDE, ChainRuns, Ratios

DECELERATING, ACCELERATING = map(PAPER, ("decelerating", "accelerating"))
GRADIENTS = (
    "(a) 2° to 90°, γ = -0.01",
    "(b) 2° to 90°, γ = +0.01",
    "(d) 90° to 2°, γ = -0.01",
    "(e) 90° to 2°, γ = +0.01",
)
#: ends of maps, in units of the arrival at the last body: on that of the short chain the secondary pulses are visible
_SHORT, _LONG = 1.3, 1.1


def figure_2(decelerating: ChainRuns, accelerating: ChainRuns) -> FigureData:
    """Return figure 2: velocity over cylinder and time with the front by BCA (b and d are measurements)."""
    end = panel.window((decelerating, accelerating), _SHORT)
    panels = [
        panel.velocity_map(title, chain, end, shares=(0, 1), theories=("bca",))
        for title, chain in _titled("a", "c", (decelerating, accelerating))
    ]
    return PAPER.figure("figure-2", panels)


def figure_3(decelerating: ChainRuns, accelerating: ChainRuns) -> FigureData:
    """Return figure 3: residence time (a, b) and wave speed (c, d), with the power-law fit of the speed.

    Below them are the deviations of the residence times from the reference.
    """
    chains = (decelerating, accelerating)
    times = [panel.residence_times(title, chain, shares=(0, 1)) for title, chain in _titled("a", "b", chains)]
    speeds = [panel.wave_speeds(title, chain, shares=(2, 3)) for title, chain in _titled("c", "d", chains)]
    away = [
        panel.deviations(title, chain, "residence_time", shares=(4, 5))
        for title, chain in _titled("a, deviation", "b, deviation", chains)
    ]
    return PAPER.figure("figure-3", [*times, *speeds, *away])


def figure_4(decelerating_200: ChainRuns, accelerating_200: ChainRuns) -> FigureData:
    """Return figure 4, first part: velocity maps (a, d), with the inset of (a) and its counterpart for (d)."""
    chains = (decelerating_200, accelerating_200)
    end = panel.window(chains, _LONG)
    panels = [
        *(
            panel.velocity_map(title, chain, end, shares=(0, 1), theories=())
            for title, chain in _titled("a", "d", chains)
        ),
        *(
            panel.velocity_in_the_middle(title, chain, shares=(2, 3))
            for title, chain in _titled("a, inset", "d, inset", chains)
        ),
    ]
    return PAPER.figure("figure-4", panels)


def figure_4_spectra(decelerating_200: ChainRuns, accelerating_200: ChainRuns) -> FigureData:
    """Return figure 4, second part: frequency along the chain (b, e) and wavenumber in time (c, f)."""
    chains = (decelerating_200, accelerating_200)
    panels = [
        *panel.frequencies(_titled("b", "e", chains), place=0),
        *panel.wavenumbers(_titled("c", "f", chains), place=2),
    ]
    return PAPER.figure("figure-4-spectra", panels)


def figure_5(decelerating_200: ChainRuns, accelerating_200: ChainRuns) -> FigureData:
    """Return figure 5: peak force along the chain (a, b) and against stiffness (c, d).

    The insets, which show the force over time in the middle, and the deviations from the reference are included.
    """
    chains = (decelerating_200, accelerating_200)
    drawn = (
        ("a", "b", panel.peak_forces, (0, 1)),
        ("c", "d", panel.force_against_stiffness, (2, 3)),
        ("a, inset", "b, inset", panel.force_in_the_middle, (4, 5)),
        ("a, deviation", "b, deviation", partial(panel.deviations, name="peak_force"), (6, 7)),
    )
    panels = [
        draw(title, chain, shares=shares)
        for first, second, draw, shares in drawn
        for title, chain in _titled(first, second, chains)
    ]
    return PAPER.figure("figure-5", panels, guide=GUIDE - 1.0)


def figure_6(maps: Sequence[ChainRuns], decelerating: Ratios, accelerating: Ratios) -> FigureData:
    """Return figure 6: maps of chains with mass gradients (a, b, d, e) and V_out/V_in against the gradient (c, f).

    Below them are the deviations of arrivals and of V_out/V_in from the reference.

    Parameters
    ----------
    maps : sequence of ChainRuns
        Decelerating with gamma = -0.01 and +0.01, then accelerating with the same.
    decelerating, accelerating : Ratios
        Values of gamma with V_out/V_in by backend; nan, or no entry, where a backend has none.

    Raises
    ------
    UsageError
        For another number of maps.

    """
    if len(maps) != len(GRADIENTS):
        raise UsageError(f"{len(maps)} maps; figure 6 has {len(GRADIENTS)}: {', '.join(GRADIENTS)}")
    end = panel.window(maps, _SHORT)
    titled = list(zip(GRADIENTS, maps, strict=True))
    drawn = [panel.velocity_map(title, chain, end, shares=(0, 1, 3, 4)) for title, chain in titled]
    # the other codes would lie on these lines; their deviations are below
    shown = ("reference", *ENGINE_BACKENDS)
    of_ratio = [("(c)", decelerating), ("(f)", accelerating)]
    c, f = (panel.speed_ratios(f"{letter} V_out/V_in", ratios, shown) for letter, ratios in of_ratio)
    away = [
        panel.deviations(f"{title[:2]}, deviation) arrival", chain, "arrival", shares=(6, 7, 9, 10))
        for title, chain in titled
    ]
    c_away, f_away = (
        panel.ratio_deviations(f"{letter[:2]}, deviation) V_out/V_in", ratios, shares=(8, 11))
        for letter, ratios in of_ratio
    )
    panels = [*drawn[:2], c, *drawn[2:], f, *away[:2], c_away, *away[2:], f_away]
    return replace(PAPER.figure("figure-6", panels), columns=3)


def _titled(first: str, second: str, chains: tuple[ChainRuns, ChainRuns]) -> list[tuple[str, ChainRuns]]:
    """Return the titles of the two chains' panels, with these letters, and the chains."""
    titles = (f"({first}) {DECELERATING}", f"({second}) {ACCELERATING}")
    return list(zip(titles, chains, strict=True))


__all__ = ["ChainRuns", "Ratios", "figure_2", "figure_3", "figure_4", "figure_4_spectra", "figure_5", "figure_6"]
