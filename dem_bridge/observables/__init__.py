"""What the paper measures, computed from any Trajectory. The definition is part of each name."""
