"""Sensors: the temperatures that `thermal` of an axis asks for."""

from typing import Final

from gateway.catalogue.entry import EventEntry, Severity

TEMPERATURE_WRONG: Final = EventEntry(
    "temperature-wrong",
    Severity.WARNING,
    "what came is no temperature of the screw of an axis, and was not used; told once until another fault or "
    "a good value comes",
    "a sensor that is broken or not wired, another `scale` or `type`, a topic that carries something else",
    "look at what the detail shows, and at `thermal.source` and `largest_dt` of the axis; until a good value "
    "comes, the last one is held for `timeout_s` and `hold_s`",
)
TEMPERATURE_NOT_READ: Final = EventEntry(
    "temperature-not-read",
    Severity.WARNING,
    "the temperature of an axis cannot be read over Modbus; told once until it can, and tried again",
    "the device is off or unplugged, another address, unit id or register",
    "check `modbus`, `unit_id`, `address` and `function` of `thermal.source`; `pitch-gateway explain "
    "term-held` says what holds meanwhile",
)
