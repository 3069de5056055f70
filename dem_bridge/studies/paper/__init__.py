"""Verify the whole paper (Chaunsali, Kim & Yang 2018): its scenes, its claims, and the effects that it leaves out.

| module | content |
|---|---|
| ``runs`` | the scenes that are run by each backend, and the results |
| ``measures`` | numbers of one run with their uncertainties; the tables of pulses, fits and theories of every scene |
| ``claims_*`` | the statements of the paper and the values that support or contradict them |
| ``effects`` | the effect of each parameter and each model term: the error budget of the predictions |
| ``validity`` | where contacts are points and bodies lumped masses |
| ``figures`` | figures 2 to 6 as data |
| ``study`` | the whole study, in order |

The titles, captions and sentences, from ``studies/pages``, are here.
"""

from __future__ import annotations

from dem_bridge.report.texts import Texts, fill

#: texts of tables, figures and the answer
PAPER = Texts("paper", "dem_bridge.studies")
#: texts of each claim by its id; the first lines of the file describe them
CLAIMS = Texts("claims", "dem_bridge.studies").data


def percent(value: float, digits: int = 2) -> str:
    """Return a ratio in per cent as text.

    Examples
    --------
    >>> percent(0.02345), percent(-0.2)
    ('2.3 %', '-20 %')

    """
    return fill(f"{{value:.{digits}g %}}", value=value)
