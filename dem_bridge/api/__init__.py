"""The public facade; ``import dem_bridge`` has all of it."""
