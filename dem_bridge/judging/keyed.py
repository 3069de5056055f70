"""Answers that are mappings: their keys are the names of attributes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar


class KeyedAnswer(Mapping[str, Any]):
    """A mapping whose values are the attributes that ``answer_keys`` names, in this order."""

    answer_keys: ClassVar[tuple[str, ...]] = ()

    def __getitem__(self, key: str) -> Any:
        if key not in self.answer_keys:
            raise KeyError(key)
        return getattr(self, key)

    def __iter__(self) -> Iterator[str]:
        return iter(self.answer_keys)

    def __len__(self) -> int:
        return len(self.answer_keys)
