"""Verdicts where a role has no run: what does not need it is judged, and nothing else is made up."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

from dem_bridge.verification import assess
from dem_bridge.verification.roles import assign_roles
from tests.helpers.export_chains import PAIR
from tests.helpers.fake_runs import NO_ERROR, free_flight


def _roles(**runs: Any) -> Any:
    names = ("engine", "twin", "tabled_twin", "positional_twin", "reference", "second_reference", "theory")
    return SimpleNamespace(**{**dict.fromkeys(names), **runs})


def test_without_a_reference_no_accuracy_is_judged() -> None:
    run = free_flight(bodies=2, contacts=1)
    roles = _roles(engine=run, twin=run)
    assert list(assess._observables(assign_roles(PAIR), roles)) == []
    assert list(assess._accuracy(assign_roles(PAIR), _roles(), roles, {}, 1e-3)) == []


def test_without_a_twin_lammps_has_nothing_beside_it_and_without_a_positional_one_no_budget() -> None:
    parts = {"round_off": 1e-12, "last_digit": 1e-16}
    run = free_flight(bodies=2, contacts=1, uncertainty=replace(NO_ERROR, parts=parts))
    assert list(assess._implementation(assign_roles(PAIR), _roles(), ())) == []
    assert list(assess._implementation(assign_roles(PAIR), _roles(engine=run), ())) == []
    [verdict] = assess._implementation(assign_roles(PAIR), _roles(engine=run, twin=run), ())
    assert (verdict.outcome.value, verdict.difference) == ("PASS", 0.0)
