"""Observables: quantities computed from any Trajectory. The definition is part of each name."""
