"""Keep with a frozen scene what pure functions derive from it, so that each derives it once."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

Value = TypeVar("Value")
Arguments = ParamSpec("Arguments")
Kind = TypeVar("Kind", bound=np.generic)


def derived(function: Callable[Arguments, Value]) -> Callable[Arguments, Value]:
    """Return a pure function or method whose last argument is a scene, which keeps its value with the scene.

    The value must not be changed, and the other arguments, which are hashed, are given by position. What is kept is not
    sent to other processes.

    >>> import dem_bridge as db
    >>> count = derived(lambda scene: [len(scene.mass)])
    >>> scene = db.load_scene("decelerating-40")
    >>> count(scene) is count(scene)
    True
    """

    @wraps(function)
    def kept(*arguments: Arguments.args, **named: Arguments.kwargs) -> Value:
        *others, scene = arguments
        values = cast(dict[object, Value], vars(scene).setdefault("_derived", {}))
        name = (function, *others)
        if name not in values:
            values[name] = function(*arguments, **named)
        return values[name]

    return kept


def frozen(values: NDArray[Kind]) -> NDArray[Kind]:
    """Return an array after making it read-only."""
    values.setflags(write=False)
    return values
