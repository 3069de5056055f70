"""Stability: the largest stable and the largest accurate time step, beside the predicted ones."""
