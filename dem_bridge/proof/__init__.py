"""Proved trajectories: balls that contain the true motion of a scene, a certificate, and its checker."""
