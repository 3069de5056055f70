"""Of many planted files none is given a cause that is not true for it; measure_causes counts more of them."""

from __future__ import annotations

import pytest

from tests.judging.measure_causes import LEAST, answer, table


@pytest.mark.slow  # test_cause names planted faults of a small chain
@pytest.mark.parametrize("kind", ["listed", "none", "pair"])
def test_no_cause_is_named_outside_of_the_true_set(kind: str) -> None:
    rows = [answer((seed, kind, None, "judge")) for seed in range(5000, 5012)]
    large = [row for row in rows if kind == "none" or row.effect >= LEAST]
    assert not [row for row in rows if row.grade in ("wrong", "broken")], table(rows)
    # a fault that is large is named, but for one file in twelve
    assert sum(row.grade != "unknown" for row in large) >= len(large) - 1, table(rows)
