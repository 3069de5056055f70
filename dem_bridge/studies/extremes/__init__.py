"""Extreme scenes: a named catalogue, and the answer of every backend to each."""
