"""How long single trajectories can be trusted, and what holds beyond."""
