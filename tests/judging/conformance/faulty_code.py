"""A code for chains with a switch for each of its faults: ``python faulty_code.py SCENE.json DT OUT.csv [FAULT]``.

It is a code as somebody else would write it, to be graded by ``dem-bridge conform``: it shares nothing with the
package, reads the scene as JSON and writes CSV. Without FAULT it is right: velocity Verlet, with the velocity
predicted at the end of the step where a force depends on it. :data:`FAULTS` names the faults and the item of the grade
that asks for each.
"""

from __future__ import annotations

import json
import math
import struct
import sys
from itertools import accumulate
from pathlib import Path
from typing import Any

#: fault -> (item of the grade that must fail, what is wrong)
FAULTS: dict[str, tuple[str, str]] = {
    "stiffness-4/3": ("law", "stiffness is multiplied by 4/3 a second time"),
    "modulus-not-reduced": ("law", "twice the stiffness: the modulus of one body in place of both"),
    "exponent-1.4": ("exponent", "force goes as overlap^1.4, with the right force at the largest overlap of the pair"),
    "exponent-linear": ("exponent", "a linear spring with the right force at the largest overlap of the pair"),
    "last-contact-missing": ("contacts", "the loop over contacts stops one too early in chains of three and more"),
    "no-reaction": ("contacts", "the last contact acts on its left body only"),
    "mean-stiffness": ("mixing", "all contacts have the mean stiffness"),
    "stiffness-reversed": ("mixing", "stiffnesses are given to contacts from the other end"),
    "one-mass": ("mixing", "all bodies have the mass of the first"),
    "hooke-half": ("hooke", "a linear spring has half its stiffness"),
    "no-walls": ("walls", "walls are ignored"),
    "wall-right-doubled": ("walls", "the right wall is twice as stiff"),
    "wall-as-body": ("walls", "the stiffness of a wall is that of the first contact"),
    "no-gaps": ("gaps", "all bodies start in touch"),
    "last-gap-missing": ("gaps", "the last gap is zero"),
    "gravity-reversed": ("gravity", "gravity acts toward the first body"),
    "no-gravity": ("gravity", "gravity is ignored"),
    "no-initial-overlap": ("precompression", "forces hold the ends, and initial overlaps are missing"),
    "no-static-force": ("precompression", "initial overlaps are right, and nothing holds the ends"),
    "only-first-moves": ("several-moving", "start velocities of the others are ignored"),
    "damping-doubled": ("restitution", "damping uses twice its coefficient"),
    "tsuji-without-sqrt2": ("restitution", "prefactor of tsuji as LAMMPS has it in 2025"),
    "always-clipped": ("restitution", "the net force is always clipped at zero"),
    "explicit-euler": ("order", "positions and velocities go on with the values at the start of the step"),
    "first-order-positions": ("order", "the term a dt^2/2 of the positions is missing"),
    "half-step-velocity": ("phase", "velocities of half a step before are written"),
    "six-digits": ("digits", "numbers are written with six digits"),
    "single-precision": ("digits", "positions and velocities are kept in single precision"),
    "milliseconds": ("units", "times are written in ms under a heading that says s"),
    "negative-axis": ("units", "positive is toward the first body"),
    "background-drag": ("momentum", "all bodies have a drag of 50 per s"),
    "contact-loss": ("energy", "every contact loses 1 % of its force while it opens"),
}
#: faults that were thought of after the grader had been changed for those above
LATER_FAULTS: dict[str, tuple[str, str]] = {
    "effective-mass-mean": ("restitution", "damping by a restitution takes the mean mass for the effective one"),
    "wall-has-mass": ("walls", "a wall is a body like its neighbour, free to move"),
    "force-at-half-drift": ("order", "forces are those of the positions in the middle of the step"),
    "velocity-step-old": ("phase", "velocities of the step before are written"),
    "gaps-cumulative": ("gaps", "each gap is counted from the first body"),
    "stiffness-of-next": ("mixing", "each contact takes the stiffness of the next one"),
    "exponent-2.5": ("exponent", "the exponent of the energy is used for the force, with the number of the stiffness"),
    "damping-sign": ("restitution", "damping forces have the other sign"),
    "rounded-times": ("phase", "written times are numbers of steps times the step rounded to three digits"),
    "pull-off": ("law", "a contact attracts with 1 N as long as it lasts"),
    "constant-drag": ("momentum", "each body that moves has a friction of 0.3 N"),
    "opening-at-half-force": ("energy", "a contact has half its force while it opens"),
    "gravity-on-first": ("gravity", "gravity acts on the first body only"),
    "columns-exchanged": ("units", "velocities are written under the headings of displacements, and the reverse"),
}
#: faults that were thought of after the grader had been changed for the later ones, too
LAST_FAULTS: dict[str, tuple[str, str]] = {
    "damping-on-left": ("restitution", "damping forces act on the left body only"),
    "damping-power": ("restitution", "the damping force of a restitution goes as overlap^(1/2) in place of 1/4"),
    "stiffness-mixed-twice": ("mixing", "each contact takes the harmonic mean of its stiffness and that of the next"),
    "left-wall-missing": ("walls", "there is no left wall"),
    "wall-late": ("walls", "a wall acts from an overlap of 2 um on, as one that is 2 um away"),
    "positions-single": ("digits", "displacements are written in single precision"),
    "gravity-twice": ("gravity", "gravity is added to the forces and to the accelerations"),
    "load-on-last": ("precompression", "the static force acts on the last body only"),
    "third-velocity-reversed": ("several-moving", "the third body starts in the other direction"),
    "force-capped": ("law", "no contact force is above 100 N"),
    "displacement-step-old": ("phase", "displacements of the step before are written"),
    "step-bounded-below": ("order", "steps below 0.3 us are made 0.3 us at most"),
}
FAULTS |= LATER_FAULTS | LAST_FAULTS


class Chain:
    """A chain with walls, read from the JSON of a scene; ``fault`` is '' for a right code."""

    def __init__(self, scene: dict[str, Any], fault: str = "") -> None:
        chain, environment = scene["chain"], scene.get("environment", {})
        self.fault, n = fault, len(chain["mass"])
        self.mass = chain["mass"] if fault != "one-mass" else [chain["mass"][0]] * n
        self.velocity = list(chain["velocity"])
        if fault == "only-first-moves":
            self.velocity[1:] = [0.0] * (n - 1)
        elif fault == "third-velocity-reversed" and n > 2:
            self.velocity[2] *= -1.0
        stiffness = self._stiffness(chain["stiffness"])
        gaps = list(chain["gap"])
        if fault == "no-gaps":
            gaps = [0.0] * (n - 1)
        elif fault == "last-gap-missing" and gaps:
            gaps[-1] = 0.0
        elif fault == "gaps-cumulative":
            gaps = list(accumulate(gaps))
        #: body on the left or -1, body on the right or -1, stiffness, power of the force, gap
        self.contacts = [(k, k + 1, stiffness[k], chain["exponent"][k] - 1.0, gaps[k]) for k in range(n - 1)]
        for side, left, right in (("wall_left", -1, 0), ("wall_right", n - 1, -1)):
            if side in chain and fault != "no-walls" and not (fault == "left-wall-missing" and side == "wall_left"):
                wall = chain[side]
                late = 2e-6 if fault == "wall-late" else 0.0
                k = wall["stiffness"]
                if fault == "wall-right-doubled" and side == "wall_right":
                    k *= 2.0
                elif fault == "wall-as-body":
                    k = chain["stiffness"][0]
                self.contacts.append((left, right, k, wall["exponent"] - 1.0, wall["gap"] + late))
        sign = {"gravity-reversed": -1.0, "no-gravity": 0.0, "gravity-twice": 2.0}.get(fault, 1.0)
        self.gravity = sign * environment.get("gravity", 0.0)
        self.drag = environment.get("drag", 0.0) + (50.0 if fault == "background-drag" else 0.0)
        self.ends = [0.0] * n
        self.eta: list[tuple[float, float]] = []
        self._compress(chain, n)
        self._damp(chain.get("damping"))
        if fault == "exponent-2.5":
            self.contacts = [(left, right, k, power + 1.0, gap) for left, right, k, power, gap in self.contacts]
        elif fault.startswith("exponent"):
            self._change_exponents()
        if fault == "wall-has-mass":
            self._free_walls()
        if fault == "last-contact-missing" and n > 2:
            del self.contacts[n - 2 : n - 1]
            self.eta = self.eta[: n - 2] + self.eta[n - 1 :]

    def _free_walls(self) -> None:
        """Make a body of each wall, behind all others."""
        for number, (left, right, k, power, gap) in enumerate(self.contacts):
            if left < 0 or right < 0:
                wall = len(self.mass)
                self.mass = [*self.mass, self.mass[max(left, right)]]
                self.velocity.append(0.0)
                self.ends.append(0.0)
                self.contacts[number] = (wall, right, k, power, gap) if left < 0 else (left, wall, k, power, gap)

    def _stiffness(self, given: list[float]) -> list[float]:
        """Return the stiffness of each contact."""
        if self.fault == "mean-stiffness":
            return [sum(given) / len(given)] * len(given)
        if self.fault == "stiffness-reversed":
            return given[::-1]
        if self.fault == "stiffness-of-next":
            return [*given[1:], given[-1]]
        if self.fault == "stiffness-mixed-twice":
            return [2.0 * k * other / (k + other) for k, other in zip(given, [*given[1:], given[-1]], strict=True)]
        return [{"stiffness-4/3": 4.0 / 3.0, "modulus-not-reduced": 2.0}.get(self.fault, 1.0) * k for k in given]

    def _compress(self, chain: dict[str, Any], n: int) -> None:
        """Add the overlaps of a static force, and the forces at ends that no wall holds."""
        force = chain.get("precompression", {}).get("force", 0.0)
        if force and self.fault != "no-initial-overlap":
            self.contacts = [
                (left, right, k, power, gap - (force / k) ** (1.0 / power))
                for left, right, k, power, gap in self.contacts
            ]
        if force and self.fault != "no-static-force":
            if "wall_left" not in chain and self.fault != "load-on-last":
                self.ends[0] += force
            if "wall_right" not in chain:
                self.ends[n - 1] -= force

    def _damp(self, damping: dict[str, Any] | None) -> None:
        """Set factor and power of the overlap of each damping force."""
        self.clip = (damping is not None and damping.get("clip", True)) or self.fault == "always-clipped"
        if damping is None:
            self.clip, self.eta = False, [(0.0, 0.0)] * len(self.contacts)
            return
        self.eta = []
        for (left, right, k, power, _), coefficient in zip(self.contacts, damping["coefficient"], strict=True):
            mass = 1.0 / sum(1.0 / self.mass[body] for body in (left, right) if body >= 0)
            if self.fault == "effective-mass-mean" and left >= 0 and right >= 0:
                mass = 0.5 * (self.mass[left] + self.mass[right])
            factor, p = self._damping_force(damping["law"], coefficient, mass, k, power)
            self.eta.append((factor * {"damping-doubled": 2.0, "damping-sign": -1.0}.get(self.fault, 1.0), p))

    def _damping_force(self, law: str, c: float, mass: float, k: float, power: float) -> tuple[float, float]:
        """Return factor and power of the overlap of one damping force, which is proportional to the closing speed."""
        if law == "dashpot":
            return c, 0.0
        if law == "mass_velocity":
            return c * mass, 0.0
        if law == "kuwabara-kono":
            return c * k, power - 1.0
        if law == "tsuji":  # Marshall 2009, J. Comput. Phys. 228, 1541, polynomial of the restitution
            polynomial = 1.2728 + c * (
                -4.2783 + c * (11.087 + c * (-22.348 + c * (27.467 + c * (-18.022 + c * 4.8218))))
            )
            alpha = polynomial * (1.0 if self.fault == "tsuji-without-sqrt2" else math.sqrt(2.0))
        else:
            alpha = -2.0 * math.sqrt((power + 1.0) / 2.0) * math.log(c) / math.hypot(math.log(c), math.pi)
        return alpha * math.sqrt(mass * k), (power - 1.0) * (1.0 if self.fault == "damping-power" else 0.5)

    def _change_exponents(self) -> None:
        """Give Hertz contacts another power, with the right force at the overlap that the first body alone reaches."""
        new = 1.0 if self.fault == "exponent-linear" else 1.4
        for number, (left, right, k, power, gap) in enumerate(self.contacts):
            if power == 1.5:
                mass = 1.0 / sum(1.0 / self.mass[body] for body in (left, right) if body >= 0)
                overlap = (1.25 * mass * max(map(abs, self.velocity)) ** 2 / k) ** 0.4
                self.contacts[number] = left, right, k * overlap ** (power - new), new, gap

    def accelerations(self, x: list[float], v: list[float]) -> list[float]:
        """Return the acceleration of each body at displacements and velocities."""
        force = list(self.ends)
        for number, ((left, right, k, power, gap), (eta, p)) in enumerate(zip(self.contacts, self.eta, strict=True)):
            overlap = (x[left] if left >= 0 else 0.0) - (x[right] if right >= 0 else 0.0) - gap
            if overlap <= 0.0:
                continue
            if self.fault == "hooke-half" and power == 1.0:
                k *= 0.5
            closing = (v[left] if left >= 0 else 0.0) - (v[right] if right >= 0 else 0.0)
            f = k * overlap**power
            if closing < 0.0:
                f *= {"contact-loss": 0.99, "opening-at-half-force": 0.5}.get(self.fault, 1.0)
            if self.fault == "pull-off":
                f -= 1.0
            if self.fault == "force-capped":
                f = min(f, 100.0)
            elastic = f
            if eta:
                f += eta * overlap**p * closing
            if self.clip and f < 0.0:
                continue
            if left >= 0:
                force[left] -= f
            if self.fault == "damping-on-left":
                f = elastic
            if right >= 0 and not (self.fault == "no-reaction" and number == len(self.mass) - 2):
                force[right] += f
        if self.fault == "constant-drag":
            force = [f - (math.copysign(0.3, u) if u else 0.0) for f, u in zip(force, v, strict=True)]
        free = [self.gravity] * len(force)
        if self.fault == "gravity-on-first":
            free[1:] = [0.0] * (len(force) - 1)
        return [f / m + g - self.drag * u for f, m, g, u in zip(force, self.mass, free, v, strict=True)]

    def step(self, x: list[float], v: list[float], a: list[float], dt: float) -> tuple[list[float], ...]:
        """Return displacements, velocities and accelerations after a step, and the velocities in its middle."""
        half = [u + 0.5 * dt * b for u, b in zip(v, a, strict=True)]
        if self.fault == "explicit-euler":
            x, v = [y + dt * u for y, u in zip(x, v, strict=True)], [u + dt * b for u, b in zip(v, a, strict=True)]
            return x, v, self.accelerations(x, v), half
        drift = v if self.fault == "first-order-positions" else half
        middle = [y + 0.5 * dt * u for y, u in zip(x, drift, strict=True)]
        x = [y + dt * u for y, u in zip(x, drift, strict=True)]
        a = self.accelerations(
            middle if self.fault == "force-at-half-drift" else x,
            [u + 0.5 * dt * b for u, b in zip(half, a, strict=True)],
        )
        v = [u + 0.5 * dt * b for u, b in zip(half, a, strict=True)]
        if self.fault == "single-precision":
            x, v = ([struct.unpack("f", struct.pack("f", number))[0] for number in row] for row in (x, v))
        return x, v, a, half


def rows(scene: dict[str, Any], dt: float, fault: str) -> list[list[float]]:
    """Return a row a sample: time, displacements, velocities."""
    chain, count = Chain(scene, fault), scene["sampling"]["count"]
    interval = scene["duration"] / count
    if fault == "step-bounded-below":
        dt = max(dt, 3e-7)
    every = round(interval / dt)
    dt = interval / every
    x, v = [0.0] * len(chain.mass), list(chain.velocity)
    a = chain.accelerations(x, v)
    written, result = v, [[0.0, *x, *v]]
    for sample in range(1, count + 1):
        for _ in range(every):
            old, place = v, x
            x, v, a, half = chain.step(x, v, a, dt)
            written = {"half-step-velocity": half, "velocity-step-old": old}.get(fault, v)
        time = sample * interval * (1e3 if fault == "milliseconds" else 1.0)
        if fault == "rounded-times":
            time = sample * every * float(f"{dt:.3g}")
        sign = -1.0 if fault == "negative-axis" else 1.0
        n = len(scene["chain"]["mass"])
        first, second = (written, x) if fault == "columns-exchanged" else (x, written)
        if fault == "displacement-step-old":
            first = place
        elif fault == "positions-single":
            first = [struct.unpack("f", struct.pack("f", number))[0] for number in first]
        result.append([time, *(sign * number for number in (*first[:n], *second[:n]))])
    if fault == "negative-axis":
        result[0] = [0.0, *(-number for number in result[0][1:])]
    elif fault == "columns-exchanged":
        result[0] = [0.0, *scene["chain"]["velocity"], *[0.0] * n]
    elif fault == "wall-has-mass":
        result[0] = [0.0, *[0.0] * n, *scene["chain"]["velocity"]]
    return result


def main(scene: str, dt: str, out: str, fault: str = "") -> None:
    """Run the scene of a file and write its samples."""
    if fault and fault not in FAULTS:
        sys.exit(f"faulty_code: fault {fault!r} is unknown; known: {', '.join(FAULTS)}")
    problem = json.loads(Path(scene).read_text(encoding="utf-8"))
    bodies = range(len(problem["chain"]["mass"]))
    heading = ["time_s", *(f"displacement_{k}_m" for k in bodies), *(f"velocity_{k}_m_per_s" for k in bodies)]
    form = "%.5e" if fault == "six-digits" else "%.17g"
    lines = [",".join(form % number for number in row) for row in rows(problem, float(dt), fault)]
    Path(out).write_text("\n".join([",".join(heading), *lines, ""]), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
