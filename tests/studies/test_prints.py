"""A study prints in at most 15 lines, and has a picture in a notebook."""

from __future__ import annotations

import dem_bridge as db
from dem_bridge.foundation.wording import MOST_LINES


def test_a_study_prints_in_at_most_15_lines_and_has_a_picture() -> None:
    study = db.study("scatter", "decelerating-40", count=2, store=False)
    assert len(str(study).splitlines()) <= MOST_LINES
    assert study.answer[0].split()[0] in str(study).splitlines()[1]
    assert "array(" not in str(study)
    assert "data:image/png;base64," in (html := study._repr_html_())
    assert len(html) < 600_000
