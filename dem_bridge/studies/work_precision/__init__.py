"""Error against cost: every backend with each of its knobs, timed one by one, in one tidy table and in diagrams."""
