"""A sentence with variable parts: text in English, and its parts for translation."""

from typing import Any, Self

from gateway.plain import JsonObject


class Text(str):
    """An English sentence that keeps its template and values, so that it can be translated.

    >>> text = Text("the drives at {address} cannot be reached{failure}", address="COM3", failure="")
    >>> text, text.as_data()["values"]
    ('the drives at COM3 cannot be reached', {'address': 'COM3', 'failure': ''})
    """

    __slots__ = ("template", "values")
    template: str
    values: dict[str, object]

    def __new__(cls, template: str, **values: object) -> Self:
        """Make the sentence; every name between braces must be in ``values``."""
        made = super().__new__(cls, template.format(**values))
        made.template = template
        made.values = values
        return made

    def as_data(self) -> JsonObject:
        """Return template and values as plain data; values that are sentences likewise."""
        return {
            "text": self.template,
            "values": {name: text_data(value) for name, value in self.values.items()},
        }


def text_data(text: object) -> Any:
    """Return a sentence as plain data; ordinary text stays text."""
    if isinstance(text, Text):
        return text.as_data()
    return str(text)
