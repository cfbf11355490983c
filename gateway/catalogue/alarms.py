"""What can be wrong right now: kinds of trouble, as ``supervisor.trouble`` finds them in the status."""

from collections.abc import Mapping
from typing import Final

from gateway.catalogue.entry import AlarmEntry, Severity

SILENT_S: Final = 2.0
"""A drive whose requests have been left unanswered for so long is silent; one lost answer is not."""
FEWEST_ASKED: Final = 3
"""A unit id without an axis that left fewer requests unanswered was only looked for."""
CONTROLLER_SILENT_S: Final = 5.0
"""A line that no motion controller has asked for so long has none. Motion controllers poll several times a
second, and one that connects again is back sooner; ``writer_hold_s`` is as long for the same reason."""
RELAY_DOWN: Final = AlarmEntry(
    "relay-down",
    Severity.ERROR,
    "the relay is not running: no command reaches a drive",
    "it was not started, could not start, or ended",
    "look at its log, then start the gateway",
    title="Relay down",
    cuts_off=True,
)
RELAY_SILENT: Final = AlarmEntry(
    "relay-silent",
    Severity.ERROR,
    "the relay has said nothing for some seconds: the machine may not obey",
    "the machine is overloaded, or the relay was stopped",
    "stop the machine by its own switch if it moves; look at the load of the computer and at the relay's log",
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
    "what is sent to the drives or to a controller of a line comes back, and the configuration does not say "
    "so: of drives the return of a write is taken for its acknowledgement; of a controller what returns is "
    "taken out once it was seen",
    "an RS-485 adapter whose receiver stays on while it sends, or a device server with an echo",
    "set `echo = true` for the drives, or for the controller that is named, and start the gateway again; or "
    "switch the echo of a device server off",
)
DRIVE_MALFORMED: Final = AlarmEntry(
    "drive-malformed",
    Severity.ERROR,
    "the drives of a line answer with headers whose length cannot be: nobody knows where the next frame "
    "begins, so the connection is closed each time",
    "a device that does not speak Modbus/TCP, speaks RTU over TCP, or writes a wrong length into its header",
    "set `rtu_over_tcp` instead of `tcp` where the device sends RTU frames, and start the gateway again; "
    "else give the bytes of the event `line-down` to its maker",
    title="Drive not understood",
)
DRIVE_GARBLED: Final = AlarmEntry(
    "drive-garbled",
    Severity.ERROR,
    "the drive of an axis has not answered, but bytes come of which no frame can be made",
    "another baud rate or parity than the drive has, A and B exchanged, no termination, two drives with one "
    "unit id",
    "compare baud rate and parity with those of the drive, then exchange A and B, then look at termination "
    "and unit ids; with the gateway stopped `pitch-gateway probe CONFIG` shows the bytes that come",
    title="Drive not understood",
    cuts_off=True,
)
OTHER_ID: Final = AlarmEntry(
    "other-transaction-id",
    Severity.ERROR,
    "a Modbus/TCP drive answers with another transaction id than it was asked with: no reply of it counts",
    "a server or converter that answers with transaction id 0, or a fixed one, whatever it is asked",
    "bring its firmware up to date, or put a converter in its place that returns the transaction id; where "
    "it speaks RTU over TCP, set `rtu_over_tcp` instead of `tcp` and start the gateway again",
    title="Wrong transaction id",
    cuts_off=True,
)
DRIVE_SILENT: Final = AlarmEntry(
    "drive-silent",
    Severity.ERROR,
    "the drive of an axis does not answer",
    "power, cable, or a drive that hangs; where it has never answered also unit id, baud rate and parity",
    "check power, cable, unit id, baud rate and parity; `pitch-gateway capture CONFIG --follow` shows what "
    "is asked and what comes. To look for its unit id, stop the gateway, then "
    "`pitch-gateway probe CONFIG --scan`",
    title="Drive silent",
    cuts_off=True,
)
PORT_CLOSED: Final = AlarmEntry(
    "controller-port-closed",
    Severity.ERROR,
    "the serial port of a controller cannot be opened: nothing that it sends is heard",
    "the adapter was unplugged, another program has the port, or the name in the configuration is wrong",
    "plug the adapter in, or end the other program: the port is tried again by itself; where its name is "
    "wrong, mend `rtu` of the controller and start the gateway again",
    title="No controller",
    cuts_off=True,
)
CONTROLLER_GARBLED: Final = AlarmEntry(
    "controller-garbled",
    Severity.ERROR,
    "nothing that came from the port of a controller was a frame",
    "another baud rate or parity than the controller has, A and B exchanged, or a device that speaks "
    "something else",
    "compare baud rate and parity of the port with those of the controller, then exchange A and B",
    title="Controller not understood",
    cuts_off=True,
)
CONTROLLER_ABSENT: Final = AlarmEntry(
    "controller-absent",
    Severity.WARNING,
    "no controller is connected: the axes get no commands",
    "the controller is off, its cable is out, or it connects to another address or port",
    "switch the controller on and check its cable and the address it connects to; where it may stay away for "
    "long, set `silent_after_s` of the controller, then `pitch-gateway reload CONFIG`",
    title="No controller",
)
CONTROLLER_SILENT: Final = AlarmEntry(
    "controller-silent",
    Severity.WARNING,
    "a controller is connected and sends no requests: the axes get no commands",
    "its program does not run, it is off, or its cable to the serial port is out",
    "look at the controller and its program, then at the cable; where it may be silent for long, set "
    "`silent_after_s` of the controller, then `pitch-gateway reload CONFIG`",
    title="Controller silent",
)
CONTROLLER_DAMAGED: Final = AlarmEntry(
    "controller-damaged",
    Severity.WARNING,
    "many frames from the port of a controller are damaged: it waits for answers that cannot come",
    "cable, screen, termination, two masters on one wire, or a baud rate that is a little off",
    "check the cable, its screen and its termination",
)
DRIVE_DAMAGED: Final = AlarmEntry(
    "drive-damaged",
    Severity.WARNING,
    "many answers of drives are damaged: their requests stay unanswered",
    "cable, screen, termination, two drives with one unit id, or a baud rate that is a little off",
    "check the cable, its screen and its termination, and that no unit id is there twice",
)
TWO_WRITERS: Final = AlarmEntry(
    "two-writers",
    Severity.ERROR,
    "two motion controllers want to move the same axis",
    "a second program, panel or PLC that moves the axis, or the same controller with two addresses",
    "let only one of them move the axis; or give the other the `role` operator or monitor, and start the "
    "gateway again",
    title="Two controllers",
)
UNIT_SILENT: Final = AlarmEntry(
    "unit-silent",
    Severity.WARNING,
    "controllers ask a unit id that has no axis, and nobody answers: trials cost the others time, with "
    "`retry_ms = 0` each request",
    "a device that is off, or a wrong unit id in the controller",
    "switch the device on, or have the controller not ask for it",
)
UNHEARD_CONTROLLER: Final = AlarmEntry(
    "unheard-controller",
    Severity.WARNING,
    "a motion controller talks only to unit ids that have no axis: nothing that it moves is corrected",
    "a wrong unit id in the controller or in the configuration, or a controller of another line",
    "set `unit_id` of the axis to what the controller talks to, or name the other device in `other_units`; "
    "then start the gateway again",
)
WRONG_UNIT_ID: Final = AlarmEntry(
    "wrong-unit-id",
    Severity.WARNING,
    "controllers talk to a unit id that has no axis, while an axis of the line hears nothing: what they move "
    "is not corrected",
    "another unit id in the controller or the drive than in the configuration",
    "set `unit_id` of the axis to what the controller talks to, or name the other device in `other_units`; "
    "then start the gateway again",
)
UNKNOWN_UNIT: Final = AlarmEntry(
    "unknown-unit",
    Severity.WARNING,
    "controllers talk to a unit id of a Modbus/TCP line that has no axis and is not named",
    "another device behind the same connection, or a wrong unit id",
    "name the device in `other_units`, or mend the `unit_id`; then start the gateway again",
)
ANSWERS_AS: Final = AlarmEntry(
    "answers-as-another",
    Severity.WARNING,
    "a Modbus/TCP drive answers with another unit id than it is asked for",
    "a drive that answers so whatever it is asked, or two drives with one address",
    "where the one drive of the line answers so, set `answers_as` and start the gateway again; else look at "
    "the unit ids of the drives",
)
BLOCKED: Final = AlarmEntry(
    "blocked",
    Severity.ERROR,
    "a target was lost on the way to the drive: starts are refused until a whole one arrives",
    "the drive refused or did not answer a write, or a request of the controller was refused",
    "let the controller send the target again, of a group those of all its axes; where the gateway itself "
    "refused it, the event `refused-value` in the log says why",
)
GROUP_SKEWED: Final = AlarmEntry(
    "group-skewed",
    Severity.ERROR,
    "the axes of a group have not all gone: one has, and the target of another one was refused",
    "the drive refused its trigger or did not answer, or its target was lost before",
    "stop the axes where the machine cannot bear it; else write the target of the refused axis again, one "
    "that it may have, and run it",
    title="Beam skewed",
)
GROUP_HELD: Final = AlarmEntry(
    "group-held",
    Severity.WARNING,
    "the axes of a group go as the first of them has gone; what was asked for since waits until all have",
    "the compensation was switched, or a homed bit fell, between the triggers of the axes of a group",
    "let the other axes go, or stop them; after ten seconds it comes into force in any case",
)
UNREFERENCED: Final = AlarmEntry(
    "unreferenced",
    Severity.WARNING,
    "not referenced: positions pass uncorrected",
    "the axis was not homed since it was switched on, or lost its reference",
    "home the axis; where it is homed and its drive has no way to show it, "
    "`pitch-gateway reference CONFIG AXIS`",
)
OFF: Final = AlarmEntry(
    "off",
    Severity.WARNING,
    "the compensation is off: positions pass uncorrected",
    'somebody switched it off, `compensation = "off"`, or a register that moves others about was written',
    "switch it on with `pitch-gateway enable CONFIG AXIS`; where the configuration says "
    '`compensation = "off"`, write `compensation = "on"` too, or the next start switches it off again; after '
    "`compensation-ended` start the gateway again",
)
SHADOW: Final = AlarmEntry(
    "shadow",
    Severity.WARNING,
    "shadow mode: corrections are shown and not applied",
    '`compensation = "shadow"`',
    'to apply them set `compensation = "on"`, then `pitch-gateway reload CONFIG` while the axis stands',
)
NO_TABLE: Final = AlarmEntry(
    "no-table",
    Severity.WARNING,
    "there is no table: positions pass uncorrected",
    "the axis names no table, as before it is measured, or its file was never good",
    "measure the axis and name its file with `table`, then `pitch-gateway reload CONFIG`; where it is to "
    'stay uncorrected, set `compensation = "off"` and start the gateway again',
)
OUTSIDE: Final = AlarmEntry(
    "outside",
    Severity.WARNING,
    "the last target lies outside the table",
    "the table is shorter than the travel of the axis",
    "measure the whole travel",
)
TABLE_REJECTED: Final = AlarmEntry(
    "table-rejected",
    Severity.ERROR,
    "a table file is bad: the last good table stays, where there was one",
    "a mistake in the file, or one that does not fit the axis",
    "mend the file: it is read again as soon as it is saved",
    title="Table refused",
)
TABLE_REMOVED: Final = AlarmEntry(
    "table-removed",
    Severity.WARNING,
    "a table file is not there: positions pass uncorrected",
    "the file was renamed or taken away",
    "put the file back, or take it out of the configuration, then `pitch-gateway reload CONFIG`",
)
OVER_BUDGET: Final = AlarmEntry(
    "over-budget",
    Severity.WARNING,
    "the gateway takes longer than `budget_us` for the exchanges of an axis",
    "the machine is busy with something else",
    "look at the load of the machine; set `fifo` and `cpus` in `[relay]`, then start the gateway again; "
    "where the axis can bear it, raise `budget_us`, then `pitch-gateway reload CONFIG`",
)
SENSOR_SILENT: Final = AlarmEntry(
    "sensor-silent",
    Severity.WARNING,
    "the temperature sensor of an axis says nothing",
    "the sensor, its cable or its broker is off; it publishes to another topic, or stands at another address",
    "look at the sensor, its broker or the address it is read from; where something came that is no "
    "temperature, or could not be read, the log says so: `temperature-wrong`, `temperature-not-read`",
)
OTHER_AXIS_UNKNOWN: Final = AlarmEntry(
    "other-axis-unknown",
    Severity.WARNING,
    "nobody knows where an axis is that `cross` of another one needs: what it adds goes back to 0",
    "it lost its reference; or it was stopped or jogged, got no target since, and its position is not read",
    "give the other axis a target; where it lost its reference, home it first",
)
TERM_TOO_LARGE: Final = AlarmEntry(
    "term-too-large",
    Severity.WARNING,
    "what `thermal` and `cross` would add comes, with the table, to more than `max_correction`: it does not "
    "follow",
    "a warm machine with a table that needs nearly all of `max_correction`, or a wrong `alpha` or `fixed_at`",
    "check `alpha`, `reference` and `fixed_at` of the axis, and start the gateway again after a change; "
    "raise `max_correction` only if the machine is that bad",
)
SUPERVISOR_DOWN: Final = AlarmEntry(
    "supervisor-down",
    Severity.WARNING,
    "the supervisor does not answer: tables are not watched, and page and MQTT say nothing",
    "it was not started, ended, or cannot start: a mistake in the configuration, a full disk",
    "look at its log; start it with `systemctl start pitch-gateway-supervisor`, or beside `record` and "
    "`relay` with `pitch-gateway supervise CONFIG`; `run` does it by itself; the relay goes on with what it "
    "has",
)
CONFIGURATION: Final = AlarmEntry(
    "configuration",
    Severity.WARNING,
    "the configuration in its file could not be taken: the one before it is in force",
    "a mistake in it, or a key that needs a restart",
    "where it asks for a restart, start the gateway again; else mend what `pitch-gateway check CONFIG` "
    "names, then `pitch-gateway reload CONFIG`",
)
TABLES_FOLDER: Final = AlarmEntry(
    "tables_folder",
    Severity.WARNING,
    "not all tables are where they belong, or their folder does not answer",
    "a network file system that hangs, a state folder that is full, a relay that did not take a table",
    "do what it says: it is tried again every few seconds, and what was in force stays",
)
STATE_FOLDER: Final = AlarmEntry(
    "state_folder",
    Severity.WARNING,
    "nothing can be kept in the state folder: the relay goes on, but a start would not find what it needs",
    "the folder was taken away, its disk is full or read-only, or somebody changed its permissions",
    "do what it says before the gateway is stopped or the machine switched off",
)
HTTP: Final = AlarmEntry(
    "http",
    Severity.WARNING,
    "the page cannot be served",
    "the port is taken, the address is none of this machine, or a certificate, key or token cannot be used",
    "mend `[http]` or what it names, then `pitch-gateway reload CONFIG`",
)
MQTT: Final = AlarmEntry(
    "mqtt",
    Severity.WARNING,
    "the broker cannot be reached, or refuses something",
    "the broker is off, or refuses user, certificate or topic",
    "check the broker, which is tried again by itself; where `[mqtt]` is wrong, mend it, then "
    "`pitch-gateway reload CONFIG`",
)

ALARMS: Final[Mapping[str, AlarmEntry]] = {
    entry.kind: entry for entry in tuple(globals().values()) if isinstance(entry, AlarmEntry)
}
"""Every kind of trouble, worst first within a severity: gateway, line, drive, axis, supervisor."""
OF_COMPENSATION: Final = (BLOCKED, UNREFERENCED, OFF, SHADOW, NO_TABLE, OUTSIDE)
"""Those that are called as a state of the compensation, and say nothing but what that means."""
OF_SUPERVISOR: Final = (CONFIGURATION, TABLES_FOLDER, STATE_FOLDER, HTTP, MQTT)
"""Those that are called as the key of ``supervisor`` in the status that has their ``problem``."""

_OF_TABLE: Final = (TABLE_REJECTED, TABLE_REMOVED)
_OF_RELAY: Final = tuple(
    entry
    for entry in ALARMS.values()
    if entry not in (RELAY_DOWN, RELAY_SILENT, *_OF_TABLE, SUPERVISOR_DOWN, *OF_SUPERVISOR)
)
"""Those that are told from what the relay says: of one that says nothing nobody knows whether they last."""
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
"""What follows from a trouble in the same place, or within it, and is not told as long as that lasts."""
