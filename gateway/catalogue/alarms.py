"""Kinds of alarms: what can be wrong now, as ``supervisor.active_alarms`` finds it in the status."""

from collections.abc import Mapping
from typing import Final

from gateway.catalogue.entry import AlarmEntry, Severity

SILENT_S: Final = 2.0
"""A drive counts as silent after so long without a response; one lost reply is not enough."""
FEWEST_ASKED: Final = 3
"""Fewer unanswered requests to a unit id without an axis are a scan."""
CONTROLLER_SILENT_S: Final = 5.0
"""A line without a request of a motion controller for so long has none. Motion controllers poll several times
a second, and one that reconnects is back sooner. ``writer_hold_s`` is as long for the same reason."""
RELAY_DOWN: Final = AlarmEntry(
    "relay-down",
    Severity.ERROR,
    "the relay is not running: no command reaches a drive",
    "it was not started, failed to start, or ended",
    "check its log, then start the gateway",
    title="Relay down",
    cuts_off=True,
)
RELAY_SILENT: Final = AlarmEntry(
    "relay-silent",
    Severity.ERROR,
    "the relay has reported nothing for some seconds: the machine may not obey",
    "the computer is overloaded, or the relay was stopped",
    "if the machine moves, stop it by its own switch. Check the load of the computer and the relay's log",
    title="Relay silent",
    cuts_off=True,
)
LINE_DOWN: Final = AlarmEntry(
    "line-down",
    Severity.ERROR,
    "the drives of a line cannot be reached",
    "power, cable, adapter, or the address in the configuration",
    "check the power of the drives, the cable and the adapter",
    title="Line down",
    cuts_off=True,
)
ADAPTER_ECHOES: Final = AlarmEntry(
    "adapter-echoes",
    Severity.ERROR,
    "an unconfigured echo: what the gateway sends comes back. The echo of a write passes for the drive's "
    "acknowledgement; from a controller it is removed",
    "an RS-485 adapter whose receiver stays on while it sends, or a device server with an echo",
    "set `echo = true` for the drives or the controller named, and restart the gateway. Or switch off "
    "the echo of the device server",
)
DRIVE_MALFORMED: Final = AlarmEntry(
    "drive-malformed",
    Severity.ERROR,
    "the drives of a line answer with headers of an impossible length; the connection is closed each time",
    "a device that does not speak Modbus/TCP, speaks RTU over TCP, or sends a wrong length",
    "if the device sends RTU frames, set `rtu_over_tcp` instead of `tcp` and restart the gateway. "
    "Otherwise send its maker the bytes in the event `line-down`",
    title="Drive not understood",
)
DRIVE_GARBLED: Final = AlarmEntry(
    "drive-garbled",
    Severity.ERROR,
    "bytes come from the drive of an axis, but no valid frame",
    "wrong baud rate or parity, A and B exchanged, no termination, or two drives with one unit id",
    "compare baud rate and parity with the drive, then exchange A and B, then check termination and unit "
    "ids. With the gateway stopped, `pitch-gateway probe CONFIG` shows the bytes",
    title="Drive not understood",
    cuts_off=True,
)
OTHER_ID: Final = AlarmEntry(
    "other-transaction-id",
    Severity.ERROR,
    "a Modbus/TCP drive replies with another transaction id than requested: its replies are discarded",
    "a server or converter that always answers with transaction id 0 or another fixed one",
    "update its firmware, or use a converter that returns the transaction id. If it speaks RTU over TCP, "
    "set `rtu_over_tcp` instead of `tcp` and restart the gateway",
    title="Wrong transaction id",
    cuts_off=True,
)
DRIVE_SILENT: Final = AlarmEntry(
    "drive-silent",
    Severity.ERROR,
    "the drive of an axis does not answer",
    "power, cable, or a drive that hangs. If it has never answered, also unit id, baud rate or parity",
    "check power, cable, unit id, baud rate and parity. `pitch-gateway capture CONFIG --follow` shows "
    "requests and replies. To search for its unit id, stop the gateway and run `pitch-gateway probe "
    "CONFIG --scan`",
    title="Drive silent",
    cuts_off=True,
)
PORT_CLOSED: Final = AlarmEntry(
    "controller-port-closed",
    Severity.ERROR,
    "the serial port of a controller cannot be opened: its requests do not arrive",
    "the adapter is unplugged, another program uses the port, or its name in the configuration is wrong",
    "plug the adapter in, or end the other program; the gateway keeps trying. If the name is wrong, "
    "correct `rtu` of the controller and restart the gateway",
    title="No controller",
    cuts_off=True,
)
CONTROLLER_GARBLED: Final = AlarmEntry(
    "controller-garbled",
    Severity.ERROR,
    "bytes come from the port of a controller, but no valid frame",
    "wrong baud rate or parity, A and B exchanged, or a device with another protocol",
    "compare baud rate and parity with the controller, then exchange A and B",
    title="Controller not understood",
    cuts_off=True,
)
CONTROLLER_ABSENT: Final = AlarmEntry(
    "controller-absent",
    Severity.WARNING,
    "no controller is connected: the axes get no commands",
    "the controller is off, unplugged, or connects to another address or port",
    "switch the controller on, and check its cable and the address that it connects to. If it may stay "
    "away for long, set its `silent_after_s`, then `pitch-gateway reload CONFIG`",
    title="No controller",
)
CONTROLLER_SILENT: Final = AlarmEntry(
    "controller-silent",
    Severity.WARNING,
    "a controller is connected but sends no requests: the axes get no commands",
    "its program does not run, it is off, or its serial cable is unplugged",
    "check the controller, its program and its cable. If it may be silent for long, set its "
    "`silent_after_s`, then `pitch-gateway reload CONFIG`",
    title="Controller silent",
)
CONTROLLER_DAMAGED: Final = AlarmEntry(
    "controller-damaged",
    Severity.WARNING,
    "many frames from the port of a controller are damaged and stay unanswered",
    "cable, screen, termination, two masters on one line, or a slightly wrong baud rate",
    "check the cable, its screen and its termination",
)
DRIVE_DAMAGED: Final = AlarmEntry(
    "drive-damaged",
    Severity.WARNING,
    "many replies of drives are damaged: their requests stay unanswered",
    "cable, screen, termination, two drives with one unit id, or a slightly wrong baud rate",
    "check the cable, its screen and termination, and that each unit id is used once",
)
TWO_WRITERS: Final = AlarmEntry(
    "two-writers",
    Severity.ERROR,
    "two motion controllers try to move the same axis",
    "a second program, panel or PLC, or one controller with two addresses",
    "let only one of them move the axis. Or give the other the `role` operator or monitor, and restart "
    "the gateway",
    title="Two controllers",
)
UNIT_SILENT: Final = AlarmEntry(
    "unit-silent",
    Severity.WARNING,
    "controllers address a unit id without axis, and no device answers: trials delay the others, with "
    "`retry_ms = 0` each request",
    "a device that is off, or a wrong unit id in the controller",
    "switch the device on, or remove it from the controller's program",
)
UNHEARD_CONTROLLER: Final = AlarmEntry(
    "unheard-controller",
    Severity.WARNING,
    "a motion controller addresses only unit ids without axis: its moves are not corrected",
    "a wrong unit id in controller or configuration, or a controller of another line",
    "set `unit_id` of the axis to the one that the controller uses, or name the other device in "
    "`other_units`. Then restart the gateway",
)
WRONG_UNIT_ID: Final = AlarmEntry(
    "wrong-unit-id",
    Severity.WARNING,
    "controllers address a unit id without axis, and an axis of the line gets no requests: their moves "
    "are not corrected",
    "the unit id of controller or drive differs from the configuration",
    "set `unit_id` of the axis to the one that the controller uses, or name the other device in "
    "`other_units`. Then restart the gateway",
)
UNKNOWN_UNIT: Final = AlarmEntry(
    "unknown-unit",
    Severity.WARNING,
    "controllers address a unit id of a Modbus/TCP line that is neither an axis nor in `other_units`",
    "another device behind the same connection, or a wrong unit id",
    "name the device in `other_units` or correct `unit_id`, then restart the gateway",
)
ANSWERS_AS: Final = AlarmEntry(
    "answers-as-another",
    Severity.WARNING,
    "a Modbus/TCP drive replies with another unit id than requested",
    "a drive that always answers so, or two drives with one address",
    "if it is the only drive of the line, set `answers_as` and restart the gateway. Otherwise check the "
    "unit ids of the drives",
)
BLOCKED: Final = AlarmEntry(
    "blocked",
    Severity.ERROR,
    "a target was lost before it reached the drive: starts are refused until a complete target arrives",
    "the drive refused or did not answer a write, or the gateway refused a request",
    "have the controller send the target again, for a group the targets of all its axes. If the gateway "
    "refused it, the event `refused-value` in the log says why",
)
GROUP_SKEWED: Final = AlarmEntry(
    "group-skewed",
    Severity.ERROR,
    "one axis of a group has moved, and the target of another was refused",
    "the drive refused or did not answer its trigger, or its target was lost before",
    "stop the axes if the machine cannot bear the skew. Otherwise write an allowed target to the refused "
    "axis again, and run it",
    title="Beam skewed",
)
GROUP_HELD: Final = AlarmEntry(
    "group-held",
    Severity.WARNING,
    "the axes of a group move as the first one did; a change since then applies when all have moved",
    "the compensation was switched, or a homed bit fell, between the triggers of the axes of a group",
    "move the other axes, or stop them. After ten seconds the change applies anyway",
)
UNREFERENCED: Final = AlarmEntry(
    "unreferenced",
    Severity.WARNING,
    "not referenced: positions pass uncorrected",
    "the axis was not homed since power-on, or lost its reference",
    "home the axis. If it is homed and its drive cannot report that, run `pitch-gateway reference CONFIG "
    "AXIS`",
)
OFF: Final = AlarmEntry(
    "off",
    Severity.WARNING,
    "the compensation is off: positions pass uncorrected",
    'it was switched off, `compensation = "off"`, a gain of 0, or a `remap` register was written',
    "switch it on with `pitch-gateway enable CONFIG AXIS`. If the configuration says `compensation = "
    '"off"`, change it to `compensation = "on"` too, or the next start switches it off again. If its gain '
    "is 0, set `gain` to 1, then `pitch-gateway reload CONFIG`. After `compensation-ended` restart the "
    "gateway",
)
SHADOW: Final = AlarmEntry(
    "shadow",
    Severity.WARNING,
    "shadow mode: corrections are shown but not applied",
    '`compensation = "shadow"`',
    'to apply them, set `compensation = "on"`, then `pitch-gateway reload CONFIG` at standstill',
)
NO_TABLE: Final = AlarmEntry(
    "no-table",
    Severity.WARNING,
    "no table: positions pass uncorrected",
    "no table configured, for example before the first measurement, or its file was never good",
    "measure the axis and name its file with `table`, then `pitch-gateway reload CONFIG`. To leave it "
    'uncorrected, set `compensation = "off"` and restart the gateway',
)
GAIN_DIFFERS: Final = AlarmEntry(
    "gain-differs",
    Severity.WARNING,
    "another share of the table is applied than the configured one",
    "a command over MQTT; it lasts until the gateway is started again",
    "give the configured gain again over MQTT, or restart the gateway. To keep the other one, write it as "
    "`gain` into the configuration, then `pitch-gateway reload CONFIG`",
)
RECORD_NOT_USED: Final = AlarmEntry(
    "record-not-used",
    Severity.WARNING,
    "it started without its record: what it reads is not corrected until its first target",
    "the axis was moved while the gateway did not run, or its record cannot be used: the event "
    "`record-not-used` in the log says why. Or the drive of another axis of its group does not answer yet",
    "have the controller send a target, or home the axis. Until then its position is off by the correction",
    title="Reads uncorrected",
)
RECORD_NOT_KEPT: Final = AlarmEntry(
    "record-not-kept",
    Severity.WARNING,
    "no record of the axis can be kept: after a restart it would read 1:1 until its first target",
    "the disk is full or read-only, or the permissions of the state folder changed",
    "make room, or correct the permissions. The gateway tries again, at least every five minutes; do not "
    "restart it before",
)
OUTSIDE: Final = AlarmEntry(
    "outside",
    Severity.WARNING,
    "the last target is outside the table",
    "the table is shorter than the travel of the axis",
    "measure the whole travel",
)
TABLE_REJECTED: Final = AlarmEntry(
    "table-rejected",
    Severity.ERROR,
    "a table file is faulty: the last good table stays, if there was one",
    "a mistake in the file, or a table that does not fit the axis",
    "correct the file: it is read again when saved",
    title="Table rejected",
)
TABLE_REMOVED: Final = AlarmEntry(
    "table-removed",
    Severity.WARNING,
    "a table file is missing: positions pass uncorrected",
    "the file was renamed or removed",
    "put the file back, or remove it from the configuration, then `pitch-gateway reload CONFIG`",
)
TABLE_WAITING: Final = AlarmEntry(
    "table-waiting",
    Severity.WARNING,
    "a table file is not taken: for more than 30 s it has changed, or a program has had it open for writing",
    "a program that holds the file open, or writes to it again and again",
    "end the program: `fuser -v FILE` names it. Or save the table under another name and rename it",
)
OVER_BUDGET: Final = AlarmEntry(
    "over-budget",
    Severity.WARNING,
    "exchanges of an axis take longer than `budget_us` in the gateway",
    "the computer is busy with something else",
    "check the load of the computer. Set `fifo` and `cpus` in `[relay]`, then restart the gateway. If "
    "the axis can bear it, raise `budget_us`, then `pitch-gateway reload CONFIG`",
)
SENSOR_SILENT: Final = AlarmEntry(
    "sensor-silent",
    Severity.WARNING,
    "the temperature sensor of an axis gives no value",
    "sensor, cable or broker off, or another topic or address",
    "check the sensor, its broker or its address. The events `temperature-wrong` and "
    "`temperature-not-read` in the log give details",
)
OTHER_AXIS_UNKNOWN: Final = AlarmEntry(
    "other-axis-unknown",
    Severity.WARNING,
    "the position of an axis that `cross` of another one needs is unknown: its correction returns to 0",
    "it lost its reference; or it was stopped or jogged, has had no target since, and its position is "
    "not read",
    "give the other axis a target, or home it first if it lost its reference",
)
TERM_TOO_LARGE: Final = AlarmEntry(
    "term-too-large",
    Severity.WARNING,
    "table, `thermal` and `cross` together exceed `max_correction`: `thermal` and `cross` no longer follow",
    "a warm machine whose table already needs nearly all of `max_correction`, or a wrong `alpha` or "
    "`fixed_at`",
    "check `alpha`, `reference` and `fixed_at` of the axis, and restart the gateway after a change. "
    "Raise `max_correction` only if the machine needs it",
)
SUPERVISOR_DOWN: Final = AlarmEntry(
    "supervisor-down",
    Severity.WARNING,
    "the supervisor does not answer: tables are not watched; page and MQTT report nothing",
    "not started, ended, or unable to start: a mistake in the configuration, a full disk",
    "check its log. Start it with `systemctl start pitch-gateway-supervisor`; beside `record` and "
    "`relay` with `pitch-gateway supervise CONFIG`; `run` restarts it automatically. The relay goes on "
    "meanwhile",
)
CONFIGURATION: Final = AlarmEntry(
    "configuration",
    Severity.WARNING,
    "the configuration file was not accepted: the previous configuration is in force",
    "a mistake in it, or a key that needs a restart",
    "restart the gateway if the message says so. Otherwise correct what `pitch-gateway check CONFIG` "
    "reports, then `pitch-gateway reload CONFIG`",
)
TABLES_FOLDER: Final = AlarmEntry(
    "tables_folder",
    Severity.WARNING,
    "some tables are not in force, or their folder does not answer",
    "a network file system that hangs, a full state folder, or a relay that refused a table",
    "do what the message says; the gateway retries every few seconds",
)
STATE_FOLDER: Final = AlarmEntry(
    "state_folder",
    Severity.WARNING,
    "the state folder cannot be written. The relay goes on, but would lack its data at the next start",
    "the folder was removed, its disk is full or read-only, or its permissions changed",
    "do what the message says before you stop the gateway or switch the machine off",
)
HTTP: Final = AlarmEntry(
    "http",
    Severity.WARNING,
    "the page is not available",
    "the port is taken, the address is not of this machine, or a certificate, key or token is unusable",
    "correct `[http]` or the file that the message names, then `pitch-gateway reload CONFIG`",
)
MQTT: Final = AlarmEntry(
    "mqtt",
    Severity.WARNING,
    "the broker cannot be reached, or refuses something",
    "the broker is off, or refuses user, certificate or topic",
    "check the broker; the gateway keeps trying. If `[mqtt]` is wrong, correct it, then `pitch-gateway "
    "reload CONFIG`",
)
ALARM_OUTPUT: Final = AlarmEntry(
    "alarm_output",
    Severity.WARNING,
    "the contact of `[alarm_output]` cannot be switched: it may not show that something is wrong",
    "the device is off or unplugged, or address, unit id or coil is wrong",
    "check the device. If `[alarm_output]` is wrong, correct it, then `pitch-gateway reload CONFIG`",
)

ALARMS: Final[Mapping[str, AlarmEntry]] = {
    entry.kind: entry for entry in tuple(globals().values()) if isinstance(entry, AlarmEntry)
}
"""Every kind of alarm, worst first within a severity: gateway, line, drive, axis, supervisor."""
OF_COMPENSATION: Final = (BLOCKED, UNREFERENCED, OFF, SHADOW, NO_TABLE, OUTSIDE)
"""Alarms named after a state of the compensation; they only explain that state."""
OF_SUPERVISOR: Final = (CONFIGURATION, TABLES_FOLDER, STATE_FOLDER, HTTP, MQTT, ALARM_OUTPUT)
"""Alarms named after the key of ``supervisor`` in the status that has their ``problem``."""

_OF_TABLE: Final = (TABLE_REJECTED, TABLE_REMOVED, TABLE_WAITING)
_OF_RELAY: Final = tuple(
    entry
    for entry in ALARMS.values()
    if entry not in (RELAY_DOWN, RELAY_SILENT, *_OF_TABLE, SUPERVISOR_DOWN, *OF_SUPERVISOR)
)
"""Alarms from the relay's report. While the relay is silent, it is unknown whether they last."""
HIDES: Final[Mapping[AlarmEntry, tuple[AlarmEntry, ...]]] = {
    RELAY_DOWN: _OF_RELAY,
    RELAY_SILENT: _OF_RELAY,
    LINE_DOWN: (DRIVE_GARBLED, OTHER_ID, DRIVE_SILENT, DRIVE_DAMAGED, UNIT_SILENT, BLOCKED, UNREFERENCED),
    ADAPTER_ECHOES: (DRIVE_DAMAGED,),
    DRIVE_MALFORMED: (DRIVE_SILENT,),
    DRIVE_GARBLED: (DRIVE_SILENT, DRIVE_DAMAGED, BLOCKED, UNREFERENCED),
    OTHER_ID: (DRIVE_SILENT, DRIVE_DAMAGED, UNIT_SILENT, BLOCKED, UNREFERENCED),
    DRIVE_SILENT: (DRIVE_DAMAGED, BLOCKED, UNREFERENCED),
    PORT_CLOSED: (CONTROLLER_GARBLED, CONTROLLER_DAMAGED, CONTROLLER_ABSENT, CONTROLLER_SILENT),
    CONTROLLER_GARBLED: (CONTROLLER_DAMAGED, CONTROLLER_ABSENT, CONTROLLER_SILENT),
    WRONG_UNIT_ID: (UNKNOWN_UNIT, UNHEARD_CONTROLLER, UNIT_SILENT),
    UNHEARD_CONTROLLER: (UNKNOWN_UNIT, UNIT_SILENT),
    TABLE_REJECTED: (NO_TABLE,),
    TABLE_REMOVED: OF_COMPENSATION,
}
"""What follows from an alarm at the same path, or inside it; hidden as long as that alarm lasts."""
