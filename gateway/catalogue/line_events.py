"""Lines and controllers: ports, connections, and who was let in."""

from typing import Final

from gateway.catalogue.entry import EventEntry, Severity

DRIVES_NOT_REACHED: Final = EventEntry(
    "drives-not-reached",
    Severity.WARNING,
    "the serial port or the address of the drives cannot be opened; told once for each reason, and "
    "tried again until it works",
    "an adapter that is not plugged in, a drive or device server that is off, a wrong path or address, a "
    "network that is down",
    "check adapter, power, cable and network: nothing has to be started again; where path or address are "
    "wrong, mend `drives` and start the gateway again",
)
PORT_NOT_OPEN: Final = EventEntry(
    "port-not-open",
    Severity.WARNING,
    "the serial port of a controller cannot be opened; told once for each reason, and tried again",
    "an adapter that is not plugged in, or one that another program has taken",
    "plug it in, or end the other program; nothing has to be started again",
)
SERIAL_LATENCY: Final = EventEntry(
    "serial-latency",
    Severity.WARNING,
    "the driver of a serial port keeps bytes back for longer than it has to; the port works",
    "the latency timer of an FTDI adapter or the trigger level of a UART, which only root may change",
    "put the udev rule of the detail in place: see "
    "[latency settings](operations.md#what-a-serial-port-adds-latency-settings)",
)
WRONG_UNIT: Final = EventEntry(
    "wrong-unit",
    Severity.WARNING,
    "a Modbus/TCP drive answered with another unit id than was asked: with one drive on the line the reply "
    "counts by its transaction id, with several it is no answer; told once for each two unit ids",
    "a drive or converter that answers with 0, 1 or 255 whatever it is asked, or two drives with one address",
    "where the one drive of the line answers so, set `answers_as` and start the gateway again; else look at "
    "the unit ids of the drives",
)
ADAPTER_ECHOES: Final = EventEntry(
    "adapter-echoes",
    Severity.WARNING,
    "what is sent to the drives or to a controller comes back, and the configuration does not say so. Of "
    "drives: three reads of registers in a row were returned byte for byte, which no reply can be; what "
    "returns of a write of one register or coil is taken for its acknowledgement, whatever the drive says. "
    "Of a controller: a reply came back at once, byte for byte, and is taken out from then on; told once",
    "an RS-485 adapter whose receiver stays on while it sends, or a device server with an echo",
    'set `echo = true` beside `rtu`, as in `drives = { rtu = "/dev/serial/by-id/…", echo = true }`, or in '
    "the table of the controller, and start the gateway again; or switch the echo of a device server off",
)
OTHER_TRANSACTION_ID: Final = EventEntry(
    "other-transaction-id",
    Severity.WARNING,
    "a Modbus/TCP drive answers, but with another transaction id than it was asked with: nobody can tell "
    "what such a reply answers, so it answers nothing; told once for each unit id",
    "a server or converter that answers with transaction id 0, or a fixed one, whatever it is asked",
    "bring its firmware up to date, or put a converter in its place that returns the transaction id; where "
    "it speaks RTU over TCP, set `rtu_over_tcp` instead of `tcp` and start the gateway again",
)
LINE_RESTS: Final = EventEntry(
    "line-rests",
    Severity.WARNING,
    "an RTU line is given silence before anything is sent on it",
    "the gateway before this one was killed, or stopped while a drive still owed a reply",
)
CONNECTION_REFUSED: Final = EventEntry(
    "connection-refused",
    Severity.WARNING,
    "a connection to a controller's address was closed at once; told once a minute for each host",
    "a host that `allow` does not name, more connections than `max_connections` and `connects_per_s` take, "
    "or too many TLS handshakes",
    "add the host to `allow` if it may connect, or raise the key that the detail names, and start the "
    "gateway again; else find out what runs on it",
)
CONNECTION_CLOSED: Final = EventEntry(
    "connection-closed",
    Severity.WARNING,
    "a connection that had been accepted was closed: it asked for nothing, did not finish a request, or "
    "made room; "
    "told once a minute for each host",
    "a controller that keeps connections it does not use, or somebody who only wants to take the places",
    "let the controller close what it does not use; where `max_connections` or `idle_timeout_s` is too low "
    "for it, raise it and start the gateway again",
)
CONNECTION_MALFORMED: Final = EventEntry(
    "connection-malformed",
    Severity.WARNING,
    "somebody sent a header whose length cannot be: it was answered with exception 3 where it can be "
    "answered, and its connection was closed; told once a minute for each host",
    "a scanner, a web browser, a controller that speaks RTU over TCP, or one that writes more than 123 "
    "registers at once",
    "find out what runs at that address, and see that `allow` names the controllers only; let a controller "
    "write at most 123 registers at once",
)
WAITING_TURNED_AWAY: Final = EventEntry(
    "waiting-turned-away",
    Severity.WARNING,
    "connections that came while no relay ran were closed, and what was sent on them was not done",
    "a restart: a command from before it must not move the machine after it",
    "let the controller connect again; nothing else, where the restart was meant",
)
FRAMES_NOT_KEPT: Final = EventEntry(
    "frames-not-kept",
    Severity.WARNING,
    "the frames of a line are not kept for `capture` and the page; everything else is as ever",
    "the system has no memory or no descriptor left",
    "lower `size_mb` in `[capture]`, or raise the limits of the service; then start the gateway again",
)
