"""Devices of the supervisor: the temperatures of `thermal`, and the contact of `[alarm_output]`."""

from typing import Final

from gateway.catalogue.entry import EventEntry, Severity

TEMPERATURE_WRONG: Final = EventEntry(
    "temperature-wrong",
    Severity.WARNING,
    "a value is no plausible screw temperature and was not used. The last good one is held for `timeout_s` "
    "and `hold_s`. Reported once until another fault or a good value",
    "a broken or unwired sensor, a wrong `scale` or `type`, or a topic with other content",
    "check the value in the detail: the sensor must send °C. Correct the sensor or `thermal.source`, "
    "then `pitch-gateway reload CONFIG`. If the screw really is so warm, raise `largest_dt` and restart "
    "the gateway",
)
TEMPERATURE_NOT_READ: Final = EventEntry(
    "temperature-not-read",
    Severity.WARNING,
    "the temperature of an axis cannot be read over Modbus. Reported once; the gateway keeps trying",
    "the device is off or unplugged, or address, unit id or register is wrong",
    "check the device, then `modbus`, `unit_id`, `address` and `function` of `thermal.source`; after a "
    "change `pitch-gateway reload CONFIG`. If it is read through the gateway, name its unit id in "
    "`other_units`. See also `term-held`",
)
ALARM_OUTPUT_FAILED: Final = EventEntry(
    "alarm-output-failed",
    Severity.WARNING,
    "the contact of `[alarm_output]` cannot be switched. Reported once; the gateway keeps trying",
    "the device is off or unplugged, or address, unit id or coil is wrong",
    "check the device, then `device`, `unit_id` and `coil` of `[alarm_output]`; after a change "
    "`pitch-gateway reload CONFIG`",
)
ALARM_OUTPUT_WORKS: Final = EventEntry(
    "alarm-output-works",
    Severity.INFO,
    "the contact of `[alarm_output]` can be switched again",
    "the fault was corrected",
)
