"""Formulas with their sources. numpy and scipy only; knows nothing of scenes, backends or files."""
