"""The adiabatic solitary wave (:mod:`dem_bridge.physics.adiabatic`) as a backend: times, velocities and forces.

Other equations than Hertz's chain: one pulse, locally the exact wave of a uniform chain. The striker's share and the
first contacts' forces and times are those of a striker on a uniform chain of the second contact's kind; from body 1 on
the pulse follows the gradients. Contact forces have the local wave's shape, with the peak and impulse that the theory
gives, and velocities and displacements follow from them by Newton's law, so momentum is kept. What comes behind the
leading pulse is not there, the reflection at the far end neither: once the pulse is within its width of the end, the
last bodies are wrong. Nothing can be said about the error from within (bars inf).
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

import numpy as np

from dem_bridge.backends.base import AlwaysAvailable, Resolution, Sampling, run_provenance
from dem_bridge.backends.bca import MOVES_TOWARDS_THE_CHAIN, has_contacts
from dem_bridge.foundation.stopwatch import Stopwatch
from dem_bridge.physics.adiabatic import LEAST_EXPONENT, MOST_EXPONENT, adiabatic_wave, launched
from dem_bridge.physics.solitary import wave_shape
from dem_bridge.scene import features
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Exponents, Support
from dem_bridge.trajectory.trajectory import Cost, Floats, Trajectory

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

#: points of a force profile from its centre to its end
PROFILE = 512


class AdiabaticWaves(AlwaysAvailable):
    """The leading pulse by its energy; single-pulse chains only."""

    name = "adiabatic"
    equations = "adiabatic solitary wave"
    supports = Support(
        {features.OTHER_EXPONENTS, features.GRADED_EXPONENTS},
        exponents=Exponents(least=LEAST_EXPONENT, most=MOST_EXPONENT),
        conditions=(MOVES_TOWARDS_THE_CHAIN, has_contacts(2)),
        scope="the adiabatic wave is a single pulse in a free chain of touching bodies at rest",
    )

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        """Evaluate the closed form at the sample times."""
        watch = Stopwatch()
        times, c, mass = sampling.times(scene.duration), scene.contacts, np.array(scene.mass)
        beta, n, striker = c.stiffness, c.exponent, scene.velocity[0]
        launch = launched(
            masses=(scene.mass[0], scene.mass[1]),
            stiffnesses=(float(beta[0]), float(beta[1])),
            exponents=(float(n[0]), float(n[1])),
            velocity=striker,
        )
        # the struck end is the launch's: for the wave the chain begins as it goes on
        wave = adiabatic_wave(
            mass=mass[np.maximum(np.arange(scene.n_body), 1)],
            stiffness=beta[(behind := np.maximum(np.arange(scene.n_contact), 1))],
            exponent=n[behind],
            energy=launch.energy,
            at=1,
        )
        first = min(scene.n_contact, len(launch.late))
        peak_force = wave.peak_force.copy()
        peak_force[:first] *= launch.force_ratio[:first]
        peak_time = launch.start + 0.5 / launch.speed + np.cumsum([0.0, 1.0 / launch.speed, *wave.transit[2:-1]])
        peak_time[:first] += launch.late[:first]
        force, impulse, travel = np.empty((3, len(times), scene.n_contact))
        by_exponent = np.argsort(n, kind="stable")
        for some in np.split(by_exponent, np.flatnonzero(np.diff(n[by_exponent])) + 1):
            pulses = _pulses(float(n[some[0]]), peak_force[some], wave.momentum[some], peak_time[some], times[:, None])
            force[:, some], impulse[:, some], travel[:, some] = pulses
        force[0] = 0.0  # at the start bodies only touch
        start = np.array(scene.velocity)
        return Trajectory(
            time=times,
            displacement=start * times[:, None] - np.diff(travel, prepend=0.0, append=0.0) / mass,
            velocity=start - np.diff(impulse, prepend=0.0, append=0.0) / mass,
            contact_force=force,
            peak_force=peak_force,
            crossing_time=np.where(peak_time <= scene.duration, peak_time, np.nan),
            cost=Cost.since(watch, steps=0, force_evaluations=0),
            provenance=run_provenance(self, scene, {"samples": sampling.count}),
        )


def _pulses(n: float, peak: Floats, momentum: Floats, at: Floats, times: Floats) -> tuple[Floats, Floats, Floats]:
    """Return forces of contacts, N, and their integrals over time from ``times[0]``: impulses (N s) and N s^2.

    ``peak`` (N), ``momentum`` (N s) and ``at`` (time of the peak, s) are ``(n_contact,)``, ``times (n_t, 1)``; the
    results are ``(n_t, n_contact)``. The contacts have the exponent ``n``.
    """
    force, impulse, travel = _profile(n)
    end = force.x[-1]
    rate = peak * float(impulse(end)) / momentum  # grains per second, so that the whole impulse is the momentum
    x = rate * (times - at)
    inside = np.clip(x, -end, end)
    f = np.where(np.abs(x) < end, force(inside), 0.0)
    g, h = impulse(inside), travel(inside) + impulse(end) * np.maximum(x - end, 0.0)
    return peak * f, peak / rate * (g - g[0]), peak / rate**2 * (h - h[0] - g[0] * (x - x[0]))


@functools.lru_cache(maxsize=256)
def _profile(n: float) -> tuple[PPoly, PPoly, PPoly]:
    """Return the wave's force over its peak against grains from its centre, and its integrals from far ahead."""
    from scipy.interpolate import CubicSpline  # what a scene's backends are is known without it

    shape = wave_shape(n)
    x = np.linspace(-shape.half_length, shape.half_length, 2 * PROFILE + 1)
    overlap = np.maximum(shape.series(shape.overlap, x), 0.0) / shape.peaks[0]
    force = CubicSpline(x, overlap ** (n - 1.0), bc_type="clamped")
    return force, force.antiderivative(), force.antiderivative(2)
