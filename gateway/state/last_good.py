"""The last compiled plan: a table whose file is bad now was good then.

Until version 6 a plan was a tree in which each object had the name of its class, and an enumeration that of
its member.
"""

import contextlib
import hashlib
from enum import Enum
from pathlib import Path
from typing import Any, Final

import msgspec

from gateway.compensation import settings, units
from gateway.drives import motion
from gateway.exchange import plan as exchange_plan
from gateway.modbus import registers
from gateway.state.folder import StateError
from gateway.state.plan import UNSEALED, VERSION, CompiledPlan, read_file, with_tables

OLDEST: Final = 2
_ENUMS: Final[dict[str, type[Enum]]] = {
    name: each
    for module in (settings, units, motion, exchange_plan, registers)
    for name, each in vars(module).items()
    if isinstance(each, type) and issubclass(each, Enum)
}
_IN_ORDER: Final = frozenset({"Deed", "RegisterSpan"})
"""Named tuples, of which only the values are written now."""


def last_plan(state: Path) -> CompiledPlan | None:
    """Return the last compiled plan, whatever has changed since; None if none can be read.

    A plan of an older release is converted.
    """
    with contextlib.suppress(StateError, msgspec.MsgspecError, LookupError, TypeError, ValueError):
        writer, body = read_file(state, "")
        if writer.version == VERSION:
            return with_tables(state, msgspec.msgpack.decode(body, type=CompiledPlan))
        if OLDEST <= writer.version < VERSION:
            return with_tables(state, _upgraded(writer.version, msgspec.msgpack.decode(body)))
    return None


def _upgraded(version: int, file: dict[str, Any]) -> CompiledPlan:
    """Return the content of an older file; missing settings get their defaults."""
    content = file["plan"] + file["configuration"].encode()
    if version <= UNSEALED and hashlib.sha256(content).hexdigest() != file["sha256"]:
        raise ValueError("its digest is another")
    plan = _untagged(msgspec.msgpack.decode(file["plan"]))
    axes = [axis for line in plan["lines"] for axis in line["axes"]]
    tables = {axis["name"]: axis["table"] for axis in axes if axis["table"] is not None}
    for axis in axes:
        axis["table"] = None
    return msgspec.convert(file | {"plan": plan, "shape": "", "tables": tables}, CompiledPlan)


def _untagged(data: Any) -> Any:
    if isinstance(data, list):
        return [_untagged(each) for each in data]
    if not isinstance(data, dict):
        return data
    kind, content = data["is"], data["of"]
    if kind in _ENUMS:
        return _ENUMS[kind][content].value
    if kind == "map":
        return {_untagged(key): _untagged(part) for key, part in content}
    if not isinstance(content, dict):
        return _untagged(content)
    fields = {name: _untagged(part) for name, part in content.items()}
    return list(fields.values()) if kind in _IN_ORDER else {"type": kind, **fields}
