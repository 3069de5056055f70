"""One impact for every normal law, damping and wall of LAMMPS, compared with theory and an independent integrator."""
