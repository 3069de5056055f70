"""Reading of LAMMPS input scripts as scenes: text to Scene, without reading files itself."""
