"""Files of other programs: trajectories read and written, and tables in the formats that people paste."""
