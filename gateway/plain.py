"""Plain data, as in JSON."""

from collections.abc import Mapping, Sequence

Json = None | bool | int | float | str | Sequence["Json"] | Mapping[str, "Json"]
"""Any value."""
JsonObject = dict[str, Json]
"""The result for a program: an object that the caller may extend."""
