"""A file for decisions on fits whose residual is a given function of parameters and of the step of a method."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from dem_bridge.judging.decision import Decision
from dem_bridge.judging.fitting import Block, Stepping
from dem_bridge.judging.hypotheses import Hypothesis, Variant
from dem_bridge.trajectory.trajectory import Floats

#: residual in units of the noise for parameters, by the exact motion (None) or by a method at a step
Residual = Callable[[Floats, Stepping | None], Any]
#: step with which a run has more steps than are made for a hypothesis with parameters
ENDLESS = 1.0 / 400_100


def block(values: Any, *, sigma: Any = 1.0, scale: float = 1.0, quantity: int = 0) -> Block:
    """Return samples of a quantity with a noise for each value or for all of them."""
    array = np.array(values, dtype=float)
    noise = np.full(array.shape, 0.0) + sigma
    columns = np.arange(array.shape[1])
    return Block(quantity, array, columns, noise, np.isfinite(array), scale, np.zeros(array.shape))


def hypothesis(
    size: int = 0,
    *,
    method: int | None = None,
    bounds: tuple[float, float] = (-99.0, 99.0),
    factors: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> Hypothesis:
    """Return a hypothesis whose variants are their parameters."""
    make: Any = lambda p: SimpleNamespace(method=method, p=p, factors=factors)  # noqa: E731
    return Hypothesis("mass", make, "", starts=((0.0,) * size,), bounds=bounds)


class SyntheticFile:
    """Answer as the samples of a file do (``Data``), and keep what was predicted; the interval of samples is 0.5 s."""

    def __init__(
        self,
        residual: Residual = lambda p, stepping: np.zeros(4),
        *,
        blocks: Sequence[Block] = (),
        time: Sequence[float] | Floats = (0.0, 0.5, 1.0),
        dt: float | None = None,
        even: bool = True,
        interval: float = 0.5,
        scale: float = 1e4,
        size: float = 0.1,
        error_of_verlet: float = 1.0,
    ) -> None:
        self.function, self.size, self.over = residual, size, False
        self.error_of_verlet = error_of_verlet
        self.blocks = list(blocks) or [block(np.zeros((4, 1)), scale=scale)]
        self.floors = [1.0] * len(self.blocks)
        self.time, self.dt, self.even, self.interval = np.array(time), dt, even, interval
        system = SimpleNamespace(exponent=np.full(1, 2.5), stiffness=np.zeros(1), mass=np.ones(1))
        self.model = SimpleNamespace(system=system, depth=1.0)
        #: parameters, tolerance and step of each prediction
        self.predicted: list[tuple[list[float], float, Stepping | None]] = []

    def predict(
        self, variant: Any, rows: int, tolerance: float = 1e-9, stepping: Stepping | None = None
    ) -> list[Floats]:
        """Return the residual of a variant, or the samples themselves for the scene."""
        assert rows == len(self.time)
        if isinstance(variant, Variant):
            return [each.values for each in self.blocks]
        self.predicted.append((variant.p.tolist(), tolerance, stepping))
        return [np.asarray(self.function(variant.p, stepping), dtype=float)]

    def residual(self, prediction: Sequence[Floats], extra: float = 0.0) -> Floats:
        """Return what was predicted, which is a residual."""
        return np.concatenate([part.ravel() for part in prediction])

    def errors(self, prediction: Sequence[Floats]) -> Floats:
        """Return the largest error of each sample relative to the scale."""
        return np.array([0.0, self.size])

    def largest(self, first: Sequence[Floats], second: Sequence[Floats]) -> list[float]:
        """Return the largest difference of each block."""
        return [float(np.max(np.abs(a - b))) for a, b in zip(first, second, strict=True)]

    def decision(self, step: float | None = None) -> Any:
        """Return the decision on this file, with a step of the search."""
        data: Any = self
        decision = Decision(data)
        decision.step = decision.step if step is None else step
        # of the scene itself, in units of the noise
        vars(decision)["_error_of_verlet"] = np.full(
            sum(each.values.size for each in self.blocks), self.error_of_verlet
        )
        return decision

    def steps(self, method: int) -> list[float]:
        """Return the steps at which a method was predicted, s."""
        return [stepping.dt for *_, stepping in self.predicted if stepping is not None and stepping.method == method]

    def counts(self, method: int) -> list[int]:
        """Return how many of these steps make an interval of samples."""
        return [round(self.interval / dt) for dt in self.steps(method)]

    def parameters(self, method: int | None = None, tolerance: float = 1e-13) -> list[float]:
        """Return the first parameters that were predicted by a method, or by the exact motion at a tolerance."""
        return [
            p[0]
            for p, accuracy, stepping in self.predicted
            if accuracy == tolerance and (None if stepping is None else stepping.method) == method
        ]
