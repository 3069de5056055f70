"""Validation: measured values with standard uncertainties compared with a scene, and parameters fitted to them."""
