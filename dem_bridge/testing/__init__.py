"""Conformance checks of backends, generated from what a backend declares; for backends outside this package, too.

>>> from dem_bridge.testing import ExactPair, check_backend
>>> check_backend(ExactPair())

With pytest, each check becomes a test of its own::

    @pytest.mark.parametrize("check", backend_checks(MyBackend()), ids=str)
    def test_my_backend(check):
        check()
"""

from __future__ import annotations

from dem_bridge.testing.checks import Check, backend_checks, check_backend
from dem_bridge.testing.exact_pair import ExactPair
from dem_bridge.testing.examples import example, plain_scene

__all__ = ["Check", "ExactPair", "backend_checks", "check_backend", "example", "plain_scene"]
