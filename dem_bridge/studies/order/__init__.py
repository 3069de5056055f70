"""Order: what openings and closings of contacts do to orders and tolerances, and the conditioning of a scene."""
