"""A foreign code in few lines of Python, and a small scene for it."""

from dem_bridge.scene.scene import Scene

#: two bodies; 50 samples
PAIR = Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=50)
#: velocity Verlet for any chain in touch; further words: "half" stores v at t - dt/2, "soft" has 0.97 of the stiffness
FAKE = """
import json, sys
scene = json.load(open(sys.argv[1]))
dt, out, mode = float(sys.argv[2]), sys.argv[3], sys.argv[4:]
m, k, v = (scene["chain"][key] for key in ("mass", "stiffness", "velocity"))
k = [0.97 * value if "soft" in mode else value for value in k]
n, x, count = len(m), [0.0] * len(m), scene["sampling"]["count"]
every = round(scene["duration"] / count / dt)
def acceleration():
    f = [c * max(x[i] - x[i + 1], 0.0) ** 1.5 for i, c in enumerate(k)]
    return [((f[i - 1] if i else 0.0) - (f[i] if i < n - 1 else 0.0)) / m[i] for i in range(n)]
a = acceleration()
with open(out, "w") as file:
    print(",".join(["time_s", *(f"displacement_{i}_m,velocity_{i}_m_per_s" for i in range(n))]), file=file)
    for step in range(count * every + 1):
        if step:
            half = v = [v[i] + 0.5 * dt * a[i] for i in range(n)]
            x = [x[i] + dt * v[i] for i in range(n)]
            a = acceleration()
            v = [v[i] + 0.5 * dt * a[i] for i in range(n)]
        if step % every == 0:
            shown = half if step and "half" in mode else v
            print(",".join(map(repr, [step * dt, *(w for pair in zip(x, shown) for w in pair)])), file=file)
"""
