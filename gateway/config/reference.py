"""The reference of all keys: name, allowed values, default.

All of it is declared with the fields of the models. The documents, ``explain`` and completion show it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from types import NoneType, UnionType
from typing import Annotated, Any, Final, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from gateway.compensation.settings import Gain, Outside
from gateway.config import values
from gateway.config.axis_model import AxisSection, GroupSection
from gateway.config.axis_values import GainValue, OutsideValue, ReversalValue
from gateway.config.bounds import bounds_text
from gateway.config.gateway_model import (
    AlarmOutputSection,
    CaptureSection,
    GatewaySection,
    GpioLine,
    StatusUnitSection,
)
from gateway.config.http_model import HttpSection
from gateway.config.line_model import ControllerSection, DrivesEndpoint, LineSection
from gateway.config.mqtt_model import MqttSection
from gateway.config.relay_model import RelaySection
from gateway.config.rights_model import RoleKeys, Span
from gateway.config.table_options import TableOptionsSection
from gateway.config.terms_model import CrossSpec, TemperatureSource, ThermalSpec
from gateway.config.tls_model import ControllerTls
from gateway.drives.registers import ActualSpec, BitSpec, CommandSpec, PositionSpec, RegisterMap
from gateway.drives.rules import ModeSpec, TriggerSpec
from gateway.drives.strict import Mark, documented
from gateway.drives.words import Address, Word


@dataclass(frozen=True, slots=True)
class KeyTable:
    """One table of the reference: the keys of ``models``, each once, without ``elsewhere``."""

    models: tuple[type[BaseModel], ...]
    elsewhere: frozenset[str] = frozenset()
    """Keys with the same meaning in another table; the document's text points to it."""

    def fields(self) -> Iterator[tuple[type[BaseModel], str]]:
        """Yield every key with the model that has it."""
        seen = set(self.elsewhere)
        for model in self.models:
            for key in model.model_fields:
                if key not in seen:
                    seen.add(key)
                    yield model, key


@dataclass(frozen=True, slots=True)
class KeyRow:
    """A key as the reference shows it."""

    key: str
    kind: str
    default: str
    description: str


_SERIAL: Final = frozenset({"baudrate", "parity", "stop_bits", "data_bits", "low_latency"})

TABLES: Final[Mapping[str, KeyTable]] = {
    "gateway": KeyTable((GatewaySection,)),
    "relay": KeyTable((RelaySection,)),
    "line": KeyTable((LineSection,)),
    "line.drives": KeyTable((DrivesEndpoint,)),
    "line.controllers": KeyTable((ControllerSection,), _SERIAL),
    "line.controllers.tls": KeyTable((ControllerTls,)),
    "line.controllers.roles": KeyTable((RoleKeys,)),
    "axis": KeyTable((AxisSection,)),
    "axis.table_options": KeyTable((TableOptionsSection,)),
    "axis.thermal": KeyTable((ThermalSpec,)),
    "axis.thermal.source": KeyTable((TemperatureSource,)),
    "axis.cross": KeyTable((CrossSpec,)),
    "axis.registers": KeyTable((RegisterMap,)),
    "axis.registers.position": KeyTable((PositionSpec, ActualSpec, CommandSpec)),
    "axis.registers.bit": KeyTable((BitSpec,)),
    "axis.registers.mode": KeyTable((ModeSpec,)),
    "axis.registers.trigger": KeyTable(
        (TriggerSpec,), frozenset(ModeSpec.model_fields) - {"address", "mask"}
    ),
    "http": KeyTable((HttpSection,)),
    "mqtt": KeyTable((MqttSection,)),
    "status_unit": KeyTable((StatusUnitSection,)),
    "capture": KeyTable((CaptureSection,)),
    "alarm_output": KeyTable((AlarmOutputSection,)),
    "alarm_output.gpio": KeyTable((GpioLine,)),
    "group": KeyTable((GroupSection,)),
}
"""By the name of their markers in the document."""


def rows(table: KeyTable) -> list[KeyRow]:
    """Return the rows of a table."""
    found = []
    for model, key in table.fields():
        field = model.model_fields[key]
        extra = field.json_schema_extra
        texts: dict[str, Any] = extra if isinstance(extra, dict) else documented()

        found.append(
            KeyRow(
                key,
                texts["kind"] or kind_text(model, key),
                texts["default"] or default_text(field),
                texts["text"] or ". ".join(filter(None, (field.description, texts["more"]))),
            )
        )
    return found


def find_keys(asked: str) -> list[tuple[str, KeyRow]]:
    """Return the keys with this name, each with the name of its table; a path starts with the section.

    >>> [name for name, _ in find_keys("axis.x.gain")], [name for name, _ in find_keys("gap_ms")]
    (['axis'], ['line', 'axis.registers'])
    """
    *path, key = asked.strip().strip("[]").split(".")
    return [
        (name, row)
        for name, table in TABLES.items()
        if not path or name.split(".")[0] == path[0]
        for row in rows(table)
        if row.key == key
    ]


def all_keys() -> list[str]:
    """Return every key once, for completion."""
    return list(dict.fromkeys(row.key for table in TABLES.values() for row in rows(table)))


# --- The allowed values of a key

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
    (values.FileName, "path"),
    (Span, 'address or `"FIRST-LAST"`'),
    (Address, "0 to 65535"),
    (Word, "0 to 0xFFFF"),
)
"""Types with a name of their own in the reference; the first equal one counts."""


def kind_text(model: type[BaseModel], key: str) -> str:
    """Return the allowed values of a key, in words.

    >>> from gateway.config.line_model import ControllerSection
    >>> kind_text(ControllerSection, "timeout_ms"), kind_text(ControllerSection, "allow")
    ('ms > 0', 'list of networks')
    """
    hint = get_type_hints(model, include_extras=True)[key]
    return _kind(_without_marks(hint), model.model_fields[key], key)


def _without_marks(hint: Any) -> Any:
    """Return a type without the marks of the key."""
    inside, *annotations = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    rest = tuple(each for each in annotations if not isinstance(each, Mark))
    return Annotated[(inside, *rest)] if rest else inside


def default_text(field: FieldInfo) -> str:
    """Return the default of a key; empty if the model has none.

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
    """Return the bounds of a value, with the unit in the key's suffix."""
    limits_text = bounds_text(field)
    bounds: Mapping[str, str] = {
        sign: part.removeprefix(words)
        for part in limits_text.split(", ")
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
    """Return the plural of a word.

    >>> _plural("network"), _plural("address"), _plural("0 to 8191")
    ('networks', 'addresses', '0 to 8191')
    """
    if not words.isalpha():
        return words
    return f"{words}{'es' if words.endswith('s') else 's'}"
