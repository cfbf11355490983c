"""Whether this installation runs compiled modules (docs/decisions/0014)."""

from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec
from typing import Final

HOT_MODULE: Final = "gateway.exchange.line"
"""One that is compiled with all the others, or not at all."""


def is_compiled() -> bool:
    """Whether the hot path is machine code here, and not Python."""
    spec = find_spec(HOT_MODULE)
    origin = spec.origin if spec is not None else None
    return origin is not None and origin.endswith(tuple(EXTENSION_SUFFIXES))
