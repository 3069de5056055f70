"""Formulas of contact mechanics and wave propagation, each with its source.

The modules import only numpy and scipy; they do not depend on scenes, backends or files.
"""
