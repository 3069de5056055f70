"""The predictability horizon: the time up to which single velocities are known, and the quantities that hold beyond
it."""
