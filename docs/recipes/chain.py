"""Read the scene that ``dem-bridge judge --command`` writes as JSON, and write the samples of a code as CSV.

The recipes in this folder import this module; it needs the standard library only,
because every code has its own Python.
"""

import json
import sys


class Chain:
    """Hold a chain of Hertzian contacts without walls, and the steps between two samples.

    ``mass`` and ``velocity`` have an entry per body, ``stiffness`` (N/m^1.5) one per contact. All other physics of a
    scene is refused, because a recipe that ignored it would compute another motion.
    """

    def __init__(self, path, dt):
        with open(path, encoding="utf-8") as file:
            scene = json.load(file)
        chain = scene["chain"]
        other = {*chain} - {"mass", "stiffness", "velocity", "exponent", "gap", "spacing"}
        other |= {key for key, value in scene.get("environment", {}).items() if value}
        if other or any(chain["gap"]) or set(chain["exponent"]) != {2.5}:
            sys.exit(
                f"this recipe is for Hertzian contacts in touch; the scene has {sorted(other) or 'other laws or gaps'}"
            )
        self.mass, self.stiffness, self.velocity = chain["mass"], chain["stiffness"], chain["velocity"]
        self.samples = scene["sampling"]["count"]
        interval = scene["duration"] / self.samples
        self.every = round(interval / dt)
        self.dt = interval / self.every
        if abs(self.dt / dt - 1.0) > 1e-9:
            sys.exit(f"dt = {dt} s does not divide the sampling interval of {interval} s")
        self.duration = scene["duration"]

    def radius(self):
        """Return a radius larger than all overlaps, m: a power of two, so that start positions are exact."""
        energy = 0.5 * sum(m * v * v for m, v in zip(self.mass, self.velocity, strict=True))
        overlap = (2.5 * energy / min(self.stiffness)) ** 0.4
        radius = 1.0
        while radius > 4.0 * overlap:
            radius /= 2.0
        return radius

    def moduli(self, radius, poisson=0.3):
        """Return Young's modulus of each body, Pa, that gives the contacts their stiffness where all radii are equal.

        stiffness = 4/3 sqrt(R/2) E* with 1/E* = (1 - nu^2)(1/E_k + 1/E_(k+1)).
        """
        factor = 4.0 / 3.0 * (radius / 2.0) ** 0.5 / (1.0 - poisson**2)
        offsets = [0.0]  # 1/E_k = offset + (-1)^k y
        for stiffness in self.stiffness:
            offsets.append(factor / stiffness - offsets[-1])
        low = max(-offset for offset in offsets[0::2])
        high = min(offsets[1::2])
        if low >= high:
            sys.exit("no Young's moduli give these stiffnesses; the code has none for a single contact")
        first = 0.5 * (low + high)
        return [1.0 / (offset + first * (-1) ** k) for k, offset in enumerate(offsets)]


def arguments():
    """Return the chain and the path of the output from the arguments SCENE.json DT OUT."""
    if len(sys.argv) < 4:
        sys.exit("usage: python RECIPE.py SCENE.json DT OUT")
    return Chain(sys.argv[1], float(sys.argv[2])), sys.argv[3]


def write_csv(path, time, displacement, velocity):
    """Write samples with all their digits; rows of ``displacement`` and ``velocity`` are times."""
    bodies = range(len(velocity[0]))
    headings = ["time_s", *(f"displacement_{k}_m" for k in bodies), *(f"velocity_{k}_m_per_s" for k in bodies)]
    with open(path, "w", encoding="utf-8") as file:
        print(",".join(headings), file=file)
        for t, x, v in zip(time, displacement, velocity, strict=True):
            print(",".join(repr(float(value)) for value in (t, *x, *v)), file=file)
