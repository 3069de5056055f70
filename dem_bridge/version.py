"""The version of the package, the date of the format of decks, and the versions of file formats.

Each format has a schema, ``dem-bridge/KIND/NUMBER``. The number grows where a reader of the one before would go wrong.
"""

import re

__version__ = "0.1.0"
#: date of the format of decks and tables, not the day of writing, so that the same scene gives the same bytes
FORM_DATE = "2026-11-21"


def schema_fault(schema: object, *read: str) -> str:
    """Return the sentence of an error: a file is of ``schema``, and this version reads the schemas ``read``.

    >>> schema_fault("dem-bridge/store/3", "dem-bridge/store/2")
    "schema = 'dem-bridge/store/3'; allowed: 'dem-bridge/store/2'; a newer dem_bridge wrote it: update"
    >>> schema_fault([1], "dem-bridge/store/2")
    "schema = not a text; allowed: 'dem-bridge/store/2'"
    """
    text = schema if isinstance(schema, str) else ""
    shown = repr(schema) if schema is None or (text and len(text) < 100) else "a long text" if text else "not a text"
    sentence = f"schema = {shown}; allowed: {', '.join(map(repr, read))}"
    return "; ".join(filter(None, (sentence, advice_on_schema(schema, read[-1]))))


def advice_on_schema(schema: object, latest: str) -> str:
    """Return what to do about a file of ``schema`` where ``latest`` is the newest one that is known; '' for others."""
    kind, _, number = latest.rpartition("/")
    newer = re.fullmatch(rf"{kind}/(\d{{1,9}})", schema if isinstance(schema, str) else "")
    return "a newer dem_bridge wrote it: update" if newer and int(newer[1]) > int(number) else ""
