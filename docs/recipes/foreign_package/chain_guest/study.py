"""The speed of the last body."""

from __future__ import annotations

import dem_bridge as db
from dem_bridge.report.study import Study, Table
from dem_bridge.scene.scene import Scene


def study_guest_speed(scene: Scene, *, dt: float = 1e-6) -> Study:
    """Measure the largest speed of the last body.

    Parameters
    ----------
    scene : Scene
        Scene to be solved.
    dt : float
        Time step, s.
    """
    run = db.solve(scene, backend="guest-verlet", dt=dt, uncertainty=False)
    speed = float(abs(run.velocity[:, -1]).max())
    table = Table(id="speed", title="Speed", caption="Of all samples.", columns=("v (m/s)",), rows=((speed,),))
    return Study(id="guest-speed", title="Speed of the last body", answer=(f"It is {speed:.3g} m/s.",), tables=(table,))
