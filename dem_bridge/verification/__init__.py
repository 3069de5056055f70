"""Runs of a scene beside each other: who plays which role, what is checked, and what the verdict is."""
