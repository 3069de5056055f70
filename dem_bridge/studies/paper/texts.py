"""Texts of the study of the paper: ``pages/claims.toml`` and ``pages/paper.toml``."""

from __future__ import annotations

from dem_bridge.report.texts import Texts, fill

#: texts of tables, figures and the answer
PAPER = Texts("paper", "dem_bridge.studies")
#: texts of each claim by its id; the first lines of the file describe them
CLAIMS = Texts("claims", "dem_bridge.studies").data
#: id -> kind and name of a term of the error budget
TERMS = PAPER.data["terms"]


def percent(value: float, digits: int = 2) -> str:
    """Return a ratio in per cent as text.

    Examples
    --------
    >>> percent(0.02345), percent(-0.2)
    ('2.3 %', '-20 %')

    """
    return fill(f"{{value:.{digits}g %}}", value=value)
