"""Sensors: the temperatures that `thermal` of an axis asks for."""

from typing import Final

from gateway.catalogue.entry import EventEntry, Severity

TEMPERATURE_WRONG: Final = EventEntry(
    "temperature-wrong",
    Severity.WARNING,
    "what came is no temperature of the screw of an axis, and was not used; told once until another fault or "
    "a good value comes",
    "a sensor that is broken or not wired, another `scale` or `type`, a topic that carries something else",
    "look at what the detail shows: the sensor has to send °C. Mend the sensor or `thermal.source`, then "
    "`pitch-gateway reload CONFIG`; where the screw really is so warm, raise `largest_dt` and start the "
    "gateway again. Until a good value comes, the last one is held for `timeout_s` and `hold_s`",
)
TEMPERATURE_NOT_READ: Final = EventEntry(
    "temperature-not-read",
    Severity.WARNING,
    "the temperature of an axis cannot be read over Modbus; told once until it can, and tried again",
    "the device is off or unplugged, another address, unit id or register",
    "check the device, then `modbus`, `unit_id`, `address` and `function` of `thermal.source`; after a "
    "change `pitch-gateway reload CONFIG`. Where it is read through the gateway, name its unit id in "
    "`other_units`. `pitch-gateway explain term-held` says what holds meanwhile",
)
