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
    encoding: str = "utf-8"

    def parse(self, text: str | bytes, **facts: Any) -> LoadedTable:
        data = text.encode(self.encoding) if isinstance(text, str) else text
        return parse_table(data, self.name, FileContext(**{**self.told, **facts}))

    def refused(
        self, text: str | bytes, match: str | None = None, line: int | None = None, **facts: Any
    ) -> TabFileError:
        """Return why a text is refused; ``match`` is a pattern, and ``line`` the line that is named."""
        with pytest.raises(TabFileError, match=match) as caught:
            self.parse(text, **facts)
        assert line is None or caught.value.line == line
        return caught.value

    def said(self, text: str | bytes, **facts: Any) -> str:
        return str(self.refused(text, **facts))
