"""LAMMPS scripts of others read as scenes: pure, text in, Scene out."""
