"""The bounds of a model's numeric field, in words."""

from collections.abc import Iterator
from typing import Annotated, Any, Final, get_args, get_origin

from pydantic.fields import FieldInfo

_WORDS: Final = {"ge": "at least", "gt": "greater than", "le": "at most", "lt": "less than"}


def bounds_text(field: FieldInfo) -> str:
    """Return the bounds of a field's values in words, "" if it has none.

    >>> from gateway.config.line_model import ControllerSection
    >>> bounds_text(ControllerSection.model_fields["timeout_ms"])
    'greater than 0, at most 3600000'
    """
    texts = {
        attribute: f"{words} {_number(limit)}"
        for constraint in _constraints(field)
        for attribute, words in _WORDS.items()
        if isinstance(limit := getattr(constraint, attribute, None), int | float)
    }
    return ", ".join(texts[attribute] for attribute in _WORDS if attribute in texts)


def _constraints(part: Any) -> Iterator[Any]:
    """Yield the constraints of a field and of all parts of its type."""
    if isinstance(part, FieldInfo):
        yield from part.metadata
        yield from _constraints(part.annotation)
    elif get_origin(part) is Annotated:
        for inside in get_args(part):
            yield from _constraints(inside)
    else:
        yield part
        for inside in get_args(part):
            yield from _constraints(inside)


def _number(bound: float) -> str:
    return f"{bound:.0f}" if float(bound).is_integer() else f"{bound:g}"
