"""Where things break: a named catalogue of extreme scenes, and what every backend makes of each."""
