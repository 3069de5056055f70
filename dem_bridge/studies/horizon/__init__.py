"""The predictability horizon of single velocities, and the quantities that hold beyond it."""
