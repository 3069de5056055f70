"""The estimated numerical error of a run, from further runs that are made for it: backends solve, and nothing else."""
