"""The base of all file content: no unknown keys, no conversions."""

from collections.abc import Mapping
from enum import Enum
from functools import cache
from inspect import signature
from typing import Annotated, Any, TypeVar, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, JsonValue


class StrictModel(BaseModel):
    """A table of a TOML file. Unknown keys, wrong types, nan and inf are errors."""

    # Deferred: otherwise each part is built once alone and once more in the whole, at every start.
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False, defer_build=True)


Element = TypeVar("Element")

# TOML has neither enumerations nor tuples: it uses a text for the one, an array for the other. Only that step
# is relaxed; the content stays strict.
ByName = Annotated[Element, Field(strict=False)]
ListOf = Annotated[tuple[Element, ...], Field(strict=False)]


class Mark(Enum):
    """What a key declares in its type, besides its values."""

    PLANNED = "planned"
    LIVE = "live"
    SECRET = "secret"  # noqa: S105 - the name of a mark


Planned = Annotated[Element, Mark.PLANNED]
"""The plan has a field of the same name and takes the value as it is (:func:`planned`)."""
Live = Annotated[Element, Mark.LIVE]
"""A running gateway can take another value; for a table, of any key in it."""
Secret = Annotated[Element, Mark.SECRET]
"""The value names a file with a secret."""


@cache
def marks_of(model: type[BaseModel]) -> Mapping[str, frozenset[Mark]]:
    """Return what the keys of a model declare in their types.

    Not from pydantic's own metadata: 2.10 keeps none of it beside a ``Field`` inside the type.
    """
    hints = get_type_hints(model, include_extras=True)
    return {
        key: frozenset(each for each in getattr(hint, "__metadata__", ()) if isinstance(each, Mark))
        for key, hint in hints.items()
    }


def planned(plan: type[Any], *models: StrictModel) -> dict[str, Any]:
    """Return the values of keys marked :data:`Planned` that ``plan`` takes, by name.

    ``plan`` is a dataclass or a struct of msgspec.
    """
    taken = signature(plan).parameters  # not ``__match_args__``: that lacks keyword-only fields
    return {
        key: getattr(model, key)
        for model in models
        for key, marks in marks_of(type(model)).items()
        if key in taken and Mark.PLANNED in marks
    }


def documented(text: str = "", more: str = "", kind: str = "", default: str = "") -> dict[str, JsonValue]:
    """Return what the reference adds to a key's description, for ``json_schema_extra``.

    Args:
        text: replaces the description, which is short because errors show it.
        more: a sentence after the description.
        kind: the possible values, if the type of the field does not show them well.
        default: the value without the key, if the field does not know it because it depends on others.
    """
    return {"text": text, "more": more, "kind": kind, "default": default}
