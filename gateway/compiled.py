"""Whether this installation runs compiled modules (docs/decisions/0028), and attributes for the compiler."""

from collections.abc import Callable
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec
from typing import TYPE_CHECKING, Final, TypeVar

if TYPE_CHECKING:
    # The compiler knows it by this name. It comes with mypy, and the running program does not need it.
    from mypy_extensions import mypyc_attr
else:
    _Class = TypeVar("_Class")

    def mypyc_attr(**_attributes: object) -> Callable[[_Class], _Class]:
        """Give the compiler an attribute of a class; without a compiler it does nothing."""
        return lambda cls: cls


__all__ = ["HOT_MODULE", "is_compiled", "mypyc_attr"]

HOT_MODULE: Final = "gateway.exchange.line"
"""It is compiled with all the others, or not at all."""


def is_compiled() -> bool:
    """Whether the hot path is machine code here, and not Python."""
    spec = find_spec(HOT_MODULE)
    origin = spec.origin if spec is not None else None
    return origin is not None and origin.endswith(tuple(EXTENSION_SUFFIXES))
