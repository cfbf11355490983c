"""The base of everything that is read from a file: nothing extra, nothing converted."""

from collections.abc import Mapping
from enum import Enum
from functools import cache
from inspect import signature
from typing import Annotated, Any, TypeVar, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, JsonValue


class StrictModel(BaseModel):
    """A table of a TOML file. Unknown keys, wrong types, nan and inf are errors."""

    # Deferred: else each part is built once for itself and once more in the whole, at every start.
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False, defer_build=True)


Element = TypeVar("Element")

# TOML knows neither enumerations nor tuples: a text stands for the one, an array for the other. Only that
# step is relaxed; what stands inside stays strict.
ByName = Annotated[Element, Field(strict=False)]
ListOf = Annotated[tuple[Element, ...], Field(strict=False)]


class Mark(Enum):
    """What a key declares in its type, beside what may stand there."""

    PLANNED = "planned"
    LIVE = "live"


Planned = Annotated[Element, Mark.PLANNED]
"""The plan has a field of the same name and takes the value as it is (:func:`planned`)."""
Live = Annotated[Element, Mark.LIVE]
"""A gateway that runs can be given another value; of a table, of any key in it."""


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
    """Return the values of keys marked :data:`Planned`, by name: of those that ``plan`` takes.

    ``plan`` is a dataclass or a struct of msgspec.
    """
    taken = signature(plan).parameters  # not ``__match_args__``: that lacks what is given by its name only
    return {
        key: getattr(model, key)
        for model in models
        for key, marks in marks_of(type(model)).items()
        if key in taken and Mark.PLANNED in marks
    }


def documented(text: str = "", more: str = "", kind: str = "", default: str = "") -> dict[str, JsonValue]:
    """Return what the reference says of a key beyond its description, for ``json_schema_extra``.

    Args:
        text: in place of the description, which is short because errors show it.
        more: behind the description, as a sentence of its own.
        kind: what may stand there, where the type of the field does not say it well.
        default: what holds without the key, where the field does not know it: it depends on others.
    """
    return {"text": text, "more": more, "kind": kind, "default": default}
