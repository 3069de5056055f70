"""Ways to solve a scene, one protocol. See :mod:`dem_bridge.backends.base`."""
