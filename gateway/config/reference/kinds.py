"""What may stand beside a key, in words, from the type of its field."""

from collections.abc import Mapping
from enum import Enum
from types import NoneType, UnionType
from typing import Annotated, Any, Final, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from gateway.compensation.settings import Gain, Outside
from gateway.config import values
from gateway.config.axis_values import GainValue, OutsideValue, ReversalValue
from gateway.config.bounds import bounds_text
from gateway.config.mqtt_model import FileName
from gateway.config.rights_model import Span
from gateway.drives.registers import PositionSpec
from gateway.drives.words import Address, Word

LAST_WORD: Final = 0xFFFF
_SIGNS: Final = {"at least ": "≥ ", "greater than ": "> ", "at most ": "≤ ", "less than ": "< "}
_UNITS: Final = {"_ms": "ms", "_us": "µs", "_s": "s"}
_ALIASES: Final[tuple[tuple[Any, str], ...]] = (
    (values.Name, "name"),
    (values.Tcp, "address"),
    (values.RtuOverTcp, "address"),
    (values.Device, "path from `/`"),
    (values.Network, "network"),
    (values.Length, "length"),
    (values.PositiveLength, "length > 0"),
    (values.LengthOrZero, "length ≥ 0"),
    (values.Counts, "number"),
    (values.CountsPerUnit, "number, not 0"),
    (values.Travel, "`[lowest, highest]`"),
    (values.Milliseconds, "ms > 0"),
    (values.Microseconds, "µs > 0"),
    (values.MillisecondsOrZero, "ms ≥ 0"),
    (GainValue, "0 to 1, or `{ forward = …, backward = … }`"),
    (OutsideValue, "see below"),
    (ReversalValue, "see below"),
    (FileName, "path"),
    (Span, 'address or `"FIRST-LAST"`'),
    (Address, "0 to 65535"),
    (Word, "0 to 0xFFFF"),
)
"""Types that have a name of their own in the reference; the first that is equal counts."""


def kind_text(model: type[BaseModel], key: str) -> str:
    """Say what may stand beside a key.

    >>> from gateway.config.line_model import ControllerSection
    >>> kind_text(ControllerSection, "timeout_ms"), kind_text(ControllerSection, "allow")
    ('ms > 0', 'list of networks')
    """
    return _kind(get_type_hints(model, include_extras=True)[key], model.model_fields[key], key)


def default_text(field: FieldInfo) -> str:
    """Say what holds without a key; empty where the model knows nothing.

    >>> from gateway.config.line_model import LineSection
    >>> default_text(LineSection.model_fields["drives"]), default_text(LineSection.model_fields["gap_ms"])
    ('required', '`0`')
    """
    if field.is_required():
        return "required"
    default = field.default
    if default is None or isinstance(default, BaseModel):
        return ""
    if isinstance(default, Gain):
        default = default.forward
    elif isinstance(default, Outside):
        default = default.kind
    if default == LAST_WORD:
        return f"`{default:#06X}`".replace("X", "x", 1)
    return f"`{_toml(default)}`"


def _toml(value: object) -> str:
    if isinstance(value, Enum):
        value = value.value
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, int | float):
        return f"{value:.15g}"
    return "[]" if value == () else str(value)


def _kind(hint: Any, field: FieldInfo, key: str) -> str:
    for alias, words in _ALIASES:
        if hint == alias:
            return words
    origin, parts = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        [inside] = [part for part in parts if part is not NoneType]
        return _kind(inside, field, key)
    if origin is Annotated:
        return _kind(parts[0], field, key)
    if origin is tuple and parts[0] == Word:
        return "list of values"
    if origin is tuple and parts[0] == Address:
        return "list of addresses"
    if origin is tuple:
        return f"list of {_plural(_kind(parts[0], FieldInfo.from_annotation(parts[0]), ''))}"
    return _plain_kind(hint, field, key)


def _plain_kind(hint: Any, field: FieldInfo, key: str) -> str:
    if isinstance(hint, type) and issubclass(hint, Enum):
        return ", ".join(f'`"{member.value}"`' for member in hint)
    if isinstance(hint, type) and issubclass(hint, PositionSpec):
        return "position"
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        return "table"
    if hint is bool:
        return "`true`, `false`"
    if hint is str:
        return "text"
    return _number(field, key)


def _number(field: FieldInfo, key: str) -> str:
    """Say between which numbers a value lies, with the unit that the key ends in."""
    said = bounds_text(field)
    bounds: Mapping[str, str] = {
        sign: part.removeprefix(words)
        for part in said.split(", ")
        for words, sign in _SIGNS.items()
        if part.startswith(words)
    }
    unit = next((unit for end, unit in _UNITS.items() if key.endswith(end)), "")
    if "≥ " in bounds and "≤ " in bounds:
        low, high = bounds["≥ "], bounds["≤ "]
        is_pair = low.isdecimal() and high.isdecimal() and int(high) == int(low) + 1
        span = low if low == high else f"{low} {'or' if is_pair else 'to'} {high}"
        return f"{span} {unit}".strip()
    limits = ", ".join(f"{sign}{limit}" for sign, limit in bounds.items())
    return f"{unit or 'number'} {limits}".strip()


def _plural(words: str) -> str:
    """Return the words for several of a kind.

    >>> _plural("network"), _plural("address"), _plural("0 to 8191")
    ('networks', 'addresses', '0 to 8191')
    """
    if not words.isalpha():
        return words
    return f"{words}{'es' if words.endswith('s') else 's'}"
