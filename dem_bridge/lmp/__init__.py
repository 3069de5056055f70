"""Everything that knows LAMMPS' language: decks out, dumps in, and the child process between.

``deck`` and ``encoding`` are pure text; ``output`` reads; ``process`` starts the child; ``worker`` is the child.
"""
