"""A short chain of three bodies that touch, struck by the first."""

from __future__ import annotations

from dem_bridge.scene.scene import Scene

THREE = Scene(
    name="three",
    duration=1e-4,
    mass=(8.1e-3, 1e-2, 1e-2),
    stiffness=(4e9, 5e9),
    velocity=(0.8, 0.0, 0.0),
    samples=5,
    spacing=18e-3,
)
