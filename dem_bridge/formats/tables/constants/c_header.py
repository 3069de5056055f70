"""The table of constants as a C header: a macro for each constant, and all of them as an array."""

from __future__ import annotations

from dem_bridge.errors import UsageError
from dem_bridge.formats.tables.table import Table
from dem_bridge.version import __version__

_NEEDED = ("name", "group", "quantity", "parameters", "value", "unit", "digits", "second_value", "source", "method")
_ARRAY = "DEM_BRIDGE_CONSTANTS_ARRAY"
_STRUCT = (
    "struct dem_bridge_constant {",
    "    const char *name;",
    "    double value;",
    "    double second_value; /* by an unrelated method */",
    "    int digits; /* significant digits that are certain */",
    "};",
)


def as_c_header(table: Table) -> str:
    """Return the table of constants as a header for C99 and C++; raise UsageError unless it has all its columns.

    The array of all constants is there where the macro ``DEM_BRIDGE_CONSTANTS_ARRAY`` is defined before the header is
    included.
    """
    names = [column.name for column in table.columns]
    if missing := [name for name in _NEEDED if name not in names]:
        raise UsageError(
            f"format = 'c' needs the column{'s' * (len(missing) > 1)} {', '.join(missing)}; allowed: the table"
            " 'constants' with all its columns"
        )
    rows = [dict(zip(names, row, strict=True)) for row in table.rows]
    lines = [_comment(f"{table.title}. Written by dem_bridge {__version__}; do not edit.")]
    lines += [_comment(note) for note in table.notes]
    groups = {(str(row["group"]), str(row["source"]), str(row["method"])) for row in rows}
    lines += [_comment(f"{group}: source {source}; method: {method}") for group, source, method in sorted(groups)]
    lines += ["#ifndef DEM_BRIDGE_CONSTANTS_H", "#define DEM_BRIDGE_CONSTANTS_H", ""]
    array = []
    for row in rows:
        unit = f", {row['unit']}" if row["unit"] else ""
        lines.append(_comment(f"{row['quantity']}; {row['parameters']}{unit}; {row['digits']} digits"))
        macro = f"DEM_BRIDGE_{str(row['name']).upper()}"
        lines.append(f"#define {macro} ({row['value']!r})")
        array.append(f'    {{"{row["name"]}", {macro}, {row["second_value"]!r}, {row["digits"]}}},')
    lines += ["", f"#ifdef {_ARRAY}", *_STRUCT, "static const struct dem_bridge_constant dem_bridge_constants[] = {"]
    return "\n".join([*lines, *array, "};", f"#endif /* {_ARRAY} */", "", "#endif /* DEM_BRIDGE_CONSTANTS_H */", ""])


def _comment(text: str) -> str:
    """Return a text as a comment of C, which a star before a slash would end."""
    return f"/* {text.replace('*/', '* /')} */"
