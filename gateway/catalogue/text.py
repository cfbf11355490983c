"""A sentence with what differs in it: in English a text like any other, and for others its two parts."""

from typing import Any, Self

from gateway.plain import JsonObject


class Text(str):
    """An English sentence that knows the words it was made of, so that it can be said in another language.

    >>> text = Text("the drives at {address} cannot be reached{failure}", address="COM3", failure="")
    >>> text, text.as_data()["values"]
    ('the drives at COM3 cannot be reached', {'address': 'COM3', 'failure': ''})
    """

    __slots__ = ("template", "values")
    template: str
    values: dict[str, object]

    def __new__(cls, template: str, **values: object) -> Self:
        """Make the sentence; every name between braces has to be in ``values``."""
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
    """Return a sentence as plain data: a text that knows nothing more stays what it is."""
    if isinstance(text, Text):
        return text.as_data()
    return str(text)
