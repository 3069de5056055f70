"""Compare runs with baselines (SAME or CHANGED), and with a reference (right or wrong): two separate outcomes."""
