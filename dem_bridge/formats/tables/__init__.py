"""Write and read tables and trajectories in the formats of other programs."""
