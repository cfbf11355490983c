"""Lines and controllers: ports, connections, and which clients were admitted."""

from typing import Final

from gateway.catalogue.entry import EventEntry, Severity

DRIVES_NOT_REACHED: Final = EventEntry(
    "drives-not-reached",
    Severity.WARNING,
    "the serial port or address of the drives cannot be opened. Reported once for each reason; the "
    "gateway keeps trying",
    "adapter unplugged, drive or device server off, wrong path or address, network down",
    "check adapter, power, cable and network. If path or address are wrong, correct `drives` and restart "
    "the gateway",
)
PORT_NOT_OPEN: Final = EventEntry(
    "port-not-open",
    Severity.WARNING,
    "the serial port of a controller cannot be opened. Reported once for each reason; the gateway keeps "
    "trying",
    "the adapter is unplugged, or another program uses it",
    "plug it in, or end the other program",
)
SERIAL_LATENCY: Final = EventEntry(
    "serial-latency",
    Severity.WARNING,
    "the driver of a serial port delays bytes needlessly; the port works",
    "the latency timer of an FTDI adapter or the trigger level of a UART, which only root may change",
    "install the udev rule in the detail: see [latency "
    "settings](operations.md#what-a-serial-port-adds-latency-settings)",
)
WRONG_UNIT: Final = EventEntry(
    "wrong-unit",
    Severity.WARNING,
    "a Modbus/TCP drive replied with another unit id than requested. The reply of the only drive of a line "
    "counts by its transaction id; others are discarded. Reported once for each pair of unit ids",
    "a drive or converter that always answers with 0, 1 or 255, or two drives with one address",
    "do what the trouble `answers-as-another` says",
)
ADAPTER_ECHOES: Final = EventEntry(
    "adapter-echoes",
    Severity.WARNING,
    "an unconfigured echo: three register reads in a row came back from the drives byte for byte, or a "
    "reply from a controller. Reported once",
    "see the trouble `adapter-echoes`",
    'set `echo = true` beside `rtu`, as in `drives = { rtu = "/dev/serial/by-id/…", echo = true }`, or '
    "do what the trouble `adapter-echoes` says",
)
OTHER_TRANSACTION_ID: Final = EventEntry(
    "other-transaction-id",
    Severity.WARNING,
    "a Modbus/TCP drive replies with another transaction id than requested: its replies are discarded. "
    "Reported once for each unit id",
    "see the trouble `other-transaction-id`",
    "do what the trouble `other-transaction-id` says",
)
LINE_RESTS: Final = EventEntry(
    "line-rests",
    Severity.WARNING,
    "the gateway waits for silence on an RTU line before it sends anything",
    "the previous gateway was killed, or stopped while a drive still owed a reply",
)
CONNECTION_REFUSED: Final = EventEntry(
    "connection-refused",
    Severity.WARNING,
    "a connection to a controller's address was closed immediately",
    "a host that `allow` does not name, too many connections (`max_connections`, `connects_per_s`) or "
    "TLS handshakes",
    "find out what runs on the host. If it may connect, add it to `allow` or raise the key in the "
    "detail, and restart the gateway",
)
CONNECTION_CLOSED: Final = EventEntry(
    "connection-closed",
    Severity.WARNING,
    "the gateway closed a connection: it sent no request, did not finish one, or made room for another",
    "a controller that keeps unused connections, or an attack that occupies them",
    "let the controller close unused connections. Or raise `max_connections` or `idle_timeout_s`, and "
    "restart the gateway",
)
CONNECTION_MALFORMED: Final = EventEntry(
    "connection-malformed",
    Severity.WARNING,
    "a client sent a header with an impossible length. It got exception 3 where possible, and its "
    "connection was closed",
    "a scanner, a web browser, a controller that speaks RTU over TCP, or one that writes more than 123 "
    "registers at once",
    "find out what runs at that address, and let `allow` name the controllers only",
)
WAITING_TURNED_AWAY: Final = EventEntry(
    "waiting-turned-away",
    Severity.WARNING,
    "connections that came while no relay ran were closed; requests sent on them were not executed",
    "a restart: an earlier command must not move the machine after it",
    "let the controller connect again; a planned restart needs nothing else",
)
FRAMES_NOT_KEPT: Final = EventEntry(
    "frames-not-kept",
    Severity.WARNING,
    "frames of a line are not kept for `capture` and the page; everything else works",
    "the system has no memory or file descriptor left",
    "lower `size_mb` in `[capture]` or raise the limits of the service, then restart the gateway",
)
