"""Plain data, as JSON holds it."""

from collections.abc import Mapping, Sequence

Json = None | bool | int | float | str | Sequence["Json"] | Mapping[str, "Json"]
"""Any value."""
JsonObject = dict[str, Json]
"""What a result says to a program: an object that may still be completed."""
