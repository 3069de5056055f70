"""Everything that depends on LAMMPS' formats: writing decks, reading dumps, and the child process that runs LAMMPS.

``deck`` and ``encoding`` produce text; ``output`` reads dumps; ``process`` starts the child; ``worker`` is the child.
"""
