"""Texts that a test has read as the file of a control."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import pytest

from gateway.tabfile import FileContext, LoadedTable, TabFileError, parse_table


@dataclass(frozen=True)
class Texts:
    """Texts that are read as files of one name, with what a person tells of them by the way."""

    name: str
    told: Mapping[str, Any] = field(default_factory=dict)

    def parse(self, text: str, **facts: Any) -> LoadedTable:
        return parse_table(text.encode(), self.name, FileContext(**{**self.told, **facts}))

    def refused(self, text: str, **facts: Any) -> TabFileError:
        with pytest.raises(TabFileError) as caught:
            self.parse(text, **facts)
        return caught.value
