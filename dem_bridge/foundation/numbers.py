"""Checks of numbers from outside: real, finite, whole, in a range, of a magnitude within double precision.

:func:`is_within` answers for all; :func:`check_number` says it of arguments, :func:`checked_number` of the entries of a
scene. Formulas (``physics/numbers``) have checks of their own, because they import nothing of the package.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeGuard, cast

from dem_bridge.errors import SceneError, UsageError, shown

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


#: largest number of bodies of a scene
MOST_BODIES = 1_000_000
#: magnitudes between which products and powers of inputs stay within double precision
SMALLEST, LARGEST = 1e-40, 1e40
#: kinds of numpy's types that are integers or real numbers
KINDS = "fiu"


def is_number(value: Any, *, whole: bool = False) -> TypeGuard[float]:
    """Return True for a real number of Python or numpy, not a bool, that a float can hold.

    >>> is_number(3), is_number(3.0, whole=True), is_number(True), is_number("3"), is_number(10**400)
    (True, False, False, False, False)
    """
    kind = getattr(getattr(value, "dtype", None), "kind", "?")
    of_numpy = kind in ("iu" if whole else KINDS) and not hasattr(value, "__len__")
    if isinstance(value, bool) or not (of_numpy or isinstance(value, int if whole else int | float)):
        return False
    try:
        float(value)
    except OverflowError:
        return whole
    return True


def is_within(
    value: Any,
    *,
    whole: bool = False,
    above: float = -math.inf,
    at_least: float = -math.inf,
    at_most: float = math.inf,
    below: float = math.inf,
) -> TypeGuard[float]:
    """Return True for a finite number within bounds, of which ``above`` and ``below`` themselves are not allowed.

    >>> is_within(1, above=0), is_within(0.0, above=0), is_within(math.inf, above=0), is_within(math.nan)
    (True, False, False, False)
    """
    return is_number(value, whole=whole) and above < value < below and at_least <= value <= at_most


def check_number(name: str, value: object, allowed: str, *, whole: bool = False, **bounds: float) -> Any:
    """Return an argument as a float, or as an int where it must be whole.

    Parameters
    ----------
    name, allowed : str
        Name of the argument and description of the allowed values, for the message.
    value : object
        The value to check.
    whole : bool
        Whether it must be a whole number.
    **bounds
        Bounds as in :func:`is_within`.

    Raises
    ------
    UsageError
        If the value is not such a number.

    Examples
    --------
    >>> check_number("share", 1.5, "a number above 0 and below 1", above=0.0, below=1.0)
    Traceback (most recent call last):
    dem_bridge.errors.UsageError: share = 1.5; allowed: a number above 0 and below 1
    """
    if not is_within(value, whole=whole, **bounds):
        raise UsageError(f"{name} = {shown(value)}; allowed: {allowed}")
    return int(value) if whole else float(value)


def whole_number(text: str) -> int | None:
    """Return a whole number of at most 18 digits; None for any other text.

    >>> whole_number("42"), whole_number("-1"), whole_number("9" * 19)
    (42, None, None)
    """
    return int(text) if text.isascii() and text.isdigit() and len(text) <= 18 else None


class Numbers(NamedTuple):
    """The numbers that a field of a frozen dataclass may hold."""

    allowed: str
    """Description of the allowed values, for error messages."""
    bounds: Mapping[str, float] = MappingProxyType({})
    """Bounds as in :func:`checked_number`."""
    per: str = ""
    """Object that each of several numbers belongs to; "" for a single number."""


def check_fields(
    instance: Any, table: Mapping[str, Numbers], prefix: str = "", sizes: Mapping[str, int] = MappingProxyType({})
) -> None:
    """Check the fields of a frozen dataclass and set them to floats or tuples of floats.

    Parameters
    ----------
    instance : dataclass
        Object that is being created. A field whose default is None may be None.
    table : mapping
        Name of each field -> allowed numbers.
    prefix : str
        Text in front of a field's name in error messages.
    sizes : mapping
        Number of objects of each kind that numbers belong to.

    Raises
    ------
    SceneError
        If a value is outside its range or the number of values is wrong.
    """
    for name, (allowed, bounds, per) in table.items():
        value: Any = getattr(instance, name)
        if value is None and instance.__dataclass_fields__[name].default is None:
            continue
        if per:
            checked: Any = checked_numbers(prefix + name, value, allowed, count=sizes[per], per=per, **bounds)
        else:
            checked = checked_number(prefix + name, value, allowed, **bounds)
        object.__setattr__(instance, name, checked)


def checked_number(
    key: str,
    value: object,
    allowed: str,
    *,
    above: float = -math.inf,
    at_least: float = -math.inf,
    at_most: float = math.inf,
) -> float:
    """Return ``value`` as a float.

    Parameters
    ----------
    key : str
        Entry of the scene, for the error message.
    value : object
        The value to check.
    allowed : str
        Description of the allowed values, for the error message.
    above, at_least, at_most : float
        Bounds; ``above`` itself is not allowed.

    Raises
    ------
    SceneError
        If the value is not a number in the allowed range.
    """
    if not is_number(value) and not is_number(value, whole=True):
        raise SceneError(key, value=value, allowed=allowed)
    number = float(value) if is_number(value) else math.inf
    if not is_within(number, above=above, at_least=at_least, at_most=at_most):
        raise SceneError(key, value=number, allowed=allowed)
    # speeds and gaps may be tiny, as they are ahead of a wave front; masses and stiffnesses may not
    if abs(number) > LARGEST or (above >= 0.0 and number < SMALLEST):
        raise SceneError(key, value=number, allowed=f"{allowed} of magnitude {SMALLEST:g} to {LARGEST:g}")
    return number


def checked_numbers(
    key: str,
    values: Sequence[float] | NDArray[np.float64] | float,
    allowed: str,
    *,
    count: int | None = None,
    per: str = "",
    **bounds: float,
) -> tuple[float, ...]:
    """Return ``values`` as a tuple of floats; a single number stands for ``count`` equal ones.

    Parameters
    ----------
    key : str
        Entry of the scene, for the error message.
    values : sequence of float, array or float
        The values to check.
    allowed : str
        Description of the allowed values, for the error message.
    count : int, optional
        Number of values that is required.
    per : str
        Object that each value belongs to, for the error message.
    **bounds
        Bounds of each value as in :func:`checked_number`.

    Raises
    ------
    SceneError
        If a value is outside its range or their number is wrong.
    """
    import numpy as np

    a_list = f"a list; each entry {allowed}"
    if isinstance(values, int | float | np.number) and count is not None:
        return (checked_number(key, values, allowed, **bounds),) * count
    # an array can be masked only where numpy.ma is imported, which takes 0.04 s
    if "numpy.ma" in sys.modules and np.ma.is_masked(values):
        raise SceneError(key, problem="has masked entries", allowed=a_list)
    if not isinstance(values, Sequence) and hasattr(values, "__array__"):  # arrays and pandas Series
        values = np.asarray(values)
        if values.ndim != 1:
            raise SceneError(key, problem=f"has the shape {values.shape}", allowed=a_list)
    # the entries of bytes are whole numbers
    if isinstance(values, str | bytes | bytearray | memoryview) or not isinstance(values, Sequence | np.ndarray):
        raise SceneError(key, value=values, allowed=a_list)
    if count is not None and len(values) != count:
        raise SceneError(key, problem=f"has {len(values)} entries", allowed=f"{count}, one per {per}")
    if set(map(type, values)) == {float}:  # a long chain at once
        array, above = np.array(values), bounds.get("above", -math.inf)
        smallest = max(bounds.get("at_least", -LARGEST), SMALLEST if above >= 0.0 else -LARGEST)
        if np.all((array > above) & (array >= smallest) & (array <= bounds.get("at_most", LARGEST))):
            return tuple(values)
    return tuple(checked_number(f"{key}[{i}]", value, allowed, **bounds) for i, value in enumerate(values))


def constant_doubles(name: str, values: Any) -> NDArray[np.float64]:
    """Return an array of real numbers as doubles that cannot be written to: itself where nobody can, or a copy.

    Raises UsageError for anything but an array of real numbers.

    >>> bool(constant_doubles("times", [1, 2]).flags.writeable)
    False
    """
    import numpy as np

    try:
        if np.asarray(values).dtype.kind in "biuf":
            with np.errstate(over="ignore"):
                array = values if _is_constant(values) else np.array(values, dtype=np.float64)
            array.setflags(write=False)
            return cast("NDArray[np.float64]", array)
    except (TypeError, ValueError):  # lists of unequal lengths
        pass
    raise UsageError(f"{name} is of type {type(values).__name__}; allowed: an array of real numbers")


def _is_constant(values: Any) -> bool:
    """Return True for an array of doubles that cannot be written to, neither by itself nor by what it is a view of."""
    import numpy as np

    if type(values) is not np.ndarray or values.dtype != np.float64:
        return False
    if not (values.flags.aligned and values.flags.forc):  # sums over another layout have other last digits
        return False
    owner: Any = values
    while isinstance(owner, np.ndarray):
        if owner.flags.writeable:
            return False
        owner = owner.base
    return owner is None or isinstance(owner, bytes)
