"""LAMMPS' unit tests of granular models: judged, executed as its test program does, and written."""
