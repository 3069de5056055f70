"""The answer to whether an input script or a scene is right: its law, its time step, its release, and what to write."""
