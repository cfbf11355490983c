"""The base of everything that is read from a file: nothing extra, nothing converted."""

from typing import Annotated, TypeVar

from pydantic import BaseModel, ConfigDict, Field


class StrictModel(BaseModel):
    """A table of a TOML file. Unknown keys, wrong types, nan and inf are errors."""

    # Deferred: else each part is built once for itself and once more in the whole, at every start.
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False, defer_build=True)


Element = TypeVar("Element")

# TOML knows neither enumerations nor tuples: a text stands for the one, an array for the other. Only that
# step is relaxed; what stands inside stays strict.
ByName = Annotated[Element, Field(strict=False)]
ListOf = Annotated[tuple[Element, ...], Field(strict=False)]
