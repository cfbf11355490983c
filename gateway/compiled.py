"""Whether this installation runs compiled modules (docs/decisions/0028), and what the compiler is told."""

from collections.abc import Callable
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec
from typing import TYPE_CHECKING, Final, TypeVar

if TYPE_CHECKING:
    # The compiler knows it by this name. It comes with mypy, and what runs has no need of it.
    from mypy_extensions import mypyc_attr
else:
    _Class = TypeVar("_Class")

    def mypyc_attr(**_attributes: object) -> Callable[[_Class], _Class]:
        """Tell the compiler something about a class; without one it means nothing."""
        return lambda cls: cls


__all__ = ["HOT_MODULE", "is_compiled", "mypyc_attr"]

HOT_MODULE: Final = "gateway.exchange.line"
"""One that is compiled with all the others, or not at all."""


def is_compiled() -> bool:
    """Whether the hot path is machine code here, and not Python."""
    spec = find_spec(HOT_MODULE)
    origin = spec.origin if spec is not None else None
    return origin is not None and origin.endswith(tuple(EXTENSION_SUFFIXES))
