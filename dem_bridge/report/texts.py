"""Texts of pages: titles, captions, headings and sentences, from ``pages/NAME.toml`` of the package that uses them."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from importlib import resources
from string import Formatter
from types import MappingProxyType
from typing import Any, TypeVar

from dem_bridge.observables.verdict import Verdict
from dem_bridge.report.columns import Columns, table_cells
from dem_bridge.report.study import FigureData, Map, Panel, Series, Study, Table

Made = TypeVar("Made", Panel, FigureData, Verdict)
VERDICTS_COLUMNS = {
    "scene": "scene", "quantity": "quantity", "compared": "compared", "difference": "difference",
    "reference_uncertainty": "uncertainty", "tolerance": "tolerance", "outcome": "outcome",
}  # fmt: skip


class _PercentFormatter(Formatter):
    """Format as ``str.format``; a format that ends in " %" shows a share in per cent."""

    def format_field(self, value: Any, format_spec: str) -> str:
        if format_spec.endswith(" %"):
            return f"{100.0 * value:{format_spec[:-2]}} %"
        return str(super().format_field(value, format_spec))


_format = _PercentFormatter().vformat


def fill(text: str, **values: Any) -> str:
    """Return a text with its fields filled.

    >>> fill("{late:.2g %} too late at cylinder {body}", late=0.02345, body=40)
    '2.3 % too late at cylinder 40'
    """
    return _format(text, (), values)


class Texts:
    """Texts of one study, in the folder ``pages`` of a package.

    Each may hold fields in braces, which are filled with the values of the call.

    >>> Texts("scope", "dem_bridge.verification")("validation")
    'None: no result is compared with a measurement.'
    """

    def __init__(self, name: str, package: str) -> None:
        self.name, self.package = name, package

    @cached_property
    def data(self) -> Mapping[str, Any]:
        """Content of the file, read when the first text is needed."""
        file = resources.files(self.package) / "pages" / f"{self.name}.toml"
        return tomllib.loads(file.read_text(encoding="utf-8"))

    def __call__(self, key: str, group: str = "sentences", /, **values: Any) -> str:
        """Return a sentence, or another text of a group."""
        return fill(self.data[group][key], **values)

    def notes(self, **values: Any) -> tuple[str, ...]:
        """Return the notes that do not depend on the outcome."""
        return tuple(fill(note, **values) for note in self.data["notes"])

    def study(self, texts: Mapping[str, Any] = MappingProxyType({}), **parts: Any) -> Study:
        """Return the study of this name; ``texts`` fill its title and, unless others are given, its notes."""
        if "notes" not in parts:
            parts["notes"] = self.notes(**texts)
        return Study(id=self.name, title=self("title", **texts), **parts)

    def table(self, id: str, columns: Columns, rows: Iterable[Any], **values: Any) -> Table:
        """Return a table with a row for each item of ``rows``, whose numbers are in SI."""
        headings, cells = table_cells(columns, rows)
        return Table(id=id, **self._filled("tables", id, values), columns=headings, rows=cells)

    def panel(self, id: str, series: Iterable[Series] = (), map: Map | None = None, **values: Any) -> Panel:
        """Return a panel; values that are fields of a panel become these, and all of them fill its texts."""
        return self._made(Panel, "panels", id, values, series=tuple(series), map=map)

    def figure(self, id: str, panels: Iterable[Panel], **values: Any) -> FigureData:
        """Return a figure of these panels; values as of a panel."""
        return self._made(FigureData, "figures", id, values, id=id, panels=tuple(panels))

    def verdict(self, id: str, **values: Any) -> Verdict:
        """Return a verdict; values as of a panel."""
        return self._made(Verdict, "verdicts", id, values)

    def _made(self, kind: type[Made], group: str, key: str, values: Mapping[str, Any], **parts: Any) -> Made:
        """Return a panel, a figure or a verdict."""
        own = {key: value for key, value in values.items() if key in kind.__dataclass_fields__}
        return kind(**(self._filled(group, key, values) | own | parts))

    def _filled(self, group: str, id: str, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the texts of a table, a panel, a figure or a verdict, filled with values."""
        return {key: fill(text, **values) for key, text in self.data[group][id].items()}


def verdict_table(verdicts: Iterable[Verdict]) -> Table:
    """List verdicts with their numbers, which are relative to the scale of each."""
    rows = []
    for verdict in verdicts:
        compared = f"{verdict.backend} - {verdict.reference}" if verdict.reference else verdict.backend
        rows.append(vars(verdict) | {"quantity": verdict.quantity.replace("_", " "), "compared": compared})
    return Texts("verdicts", __package__).table("verdicts", VERDICTS_COLUMNS, rows)


def without_repeats(verdicts: Iterable[Verdict]) -> Iterator[Verdict]:
    """Yield verdicts, those after the first on a known defect with its name in place of the words on it.

    >>> words = {"quantity": "", "backend": "", "reference": "", "outcome": "FAIL", "known_defect": "d"}
    >>> found = [Verdict(scene=name, sentence=f"Known defect d: it is long: {name}.", **words) for name in ("a", "b")]
    >>> [verdict.sentence for verdict in without_repeats(found)]
    ['Known defect d: it is long: a.', 'Known defect d: b.']
    """
    described: dict[str, list[str]] = {}
    for verdict in verdicts:
        name, parts = verdict.known_defect, verdict.sentence.split(": ")
        if name and (before := described.setdefault(name, parts)) is not parts:
            # what both sentences begin with describes the defect
            same = next((k for k, (one, other) in enumerate(zip(before, parts, strict=False)) if one != other), 0)
            if same:
                verdict = replace(verdict, sentence=f"Known defect {name}: {': '.join(parts[same:])}")
        yield verdict
