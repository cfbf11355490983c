"""Objects of a plan to plain data and back, whatever fields they have.

Dataclasses, named tuples and enumerations carry the name of their class, so a new field needs nothing here:
the classes are found by the type hints of the one that stands at the top. Every sequence becomes a tuple.
"""

from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from ipaddress import IPv4Network, IPv6Network, ip_network
from typing import Any, Final, get_args, get_type_hints

_KIND: Final = "is"
_CONTENT: Final = "of"
_NETWORK: Final = "network"
_SET: Final = "set"
_MAP: Final = "map"
_SPECIAL: Final = "special"


class WrongDataError(Exception):
    """Plain data that is not what this release writes."""


Special = Callable[[Any], object | None]
"""Returns plain data for an object that is kept in a way of its own; None for every other object."""


def to_plain(value: Any, special: Special) -> object:
    """Return an object as numbers, texts, lists and dictionaries."""
    kept = special(value)
    if kept is not None:
        return {_KIND: _SPECIAL, _CONTENT: kept}
    if isinstance(value, Enum):
        return {_KIND: type(value).__name__, _CONTENT: value.name}
    if value is None or isinstance(value, bool | int | float | str):
        return value
    return _composed(value, special)


def _composed(value: Any, special: Special) -> object:
    if is_dataclass(value) and not isinstance(value, type):
        content = {f.name: to_plain(getattr(value, f.name), special) for f in fields(value) if f.init}
        return {_KIND: type(value).__name__, _CONTENT: content}
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        content = {name: to_plain(part, special) for name, part in value._asdict().items()}
        return {_KIND: type(value).__name__, _CONTENT: content}
    if isinstance(value, tuple | list):
        return [to_plain(part, special) for part in value]
    if isinstance(value, frozenset):
        return {_KIND: _SET, _CONTENT: sorted((to_plain(part, special) for part in value), key=repr)}
    if isinstance(value, Mapping):
        pairs = [[to_plain(key, special), to_plain(part, special)] for key, part in value.items()]
        return {_KIND: _MAP, _CONTENT: pairs}
    if isinstance(value, IPv4Network | IPv6Network):
        return {_KIND: _NETWORK, _CONTENT: str(value)}
    raise TypeError(f"a {type(value).__name__} in a plan: it has to be plain data")


class PlainReader:
    """Reads what :func:`to_plain` made of a ``top`` class; ``special`` gets the content of such objects."""

    def __init__(self, top: type, special: Callable[[Any], object]) -> None:
        found = _classes_of(top)
        self._classes = {each.__name__: each for each in found}
        assert len(self._classes) == len(found), "two classes of one name in a plan"
        self._special = special

    def read(self, data: Any) -> Any:
        """Return the object.

        Raises:
            WrongDataError: the data is not what this release would have written.
        """
        try:
            return self._read(data)
        except (TypeError, ValueError, KeyError, AttributeError) as error:
            raise WrongDataError(str(error) or type(error).__name__) from None

    def _read(self, data: Any) -> Any:
        if isinstance(data, list):
            return tuple(map(self._read, data))
        if not isinstance(data, dict):
            return data
        kind, content = data[_KIND], data[_CONTENT]
        if kind == _SPECIAL:
            return self._special(content)
        if kind == _NETWORK:
            return ip_network(content)
        if kind == _SET:
            return frozenset(map(self._read, content))
        if kind == _MAP:
            return {self._read(key): self._read(part) for key, part in content}
        found = self._classes[kind]
        if issubclass(found, Enum):
            return found[content]
        return found(**{name: self._read(part) for name, part in content.items()})


def _classes_of(top: type) -> list[type]:
    """Return every class of a project's own that an object of ``top`` may hold, by its type hints."""
    found: dict[type, None] = {}
    waiting: list[Any] = [top]
    while waiting:
        hint = waiting.pop()
        waiting += get_args(hint)
        if not isinstance(hint, type) or hint in found or hint.__module__ == "builtins":
            continue
        if issubclass(hint, Enum):
            found[hint] = None
        elif is_dataclass(hint) or hasattr(hint, "_fields"):
            found[hint] = None
            waiting += get_type_hints(hint).values()
    return list(found)
