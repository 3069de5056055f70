"""Compute the table of constants to take home."""
