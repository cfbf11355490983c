"""Processes: how relay and supervisor start, run and end."""

from typing import Final

from gateway.catalogue.entry import EventEntry, Severity

STARTING: Final = EventEntry(
    "starting",
    Severity.INFO,
    "the relay begins, with the name of the gateway and what it runs on",
    "a start",
)
LINE: Final = EventEntry(
    "line", Severity.INFO, "a line of the configuration: drives and controllers", "a start"
)
AXIS: Final = EventEntry("axis", Severity.INFO, "an axis of the configuration, and its table", "a start")
SHADOW: Final = EventEntry(
    "shadow",
    Severity.WARNING,
    "the axis is in shadow mode: corrections are computed and shown, positions pass 1:1",
    '`compensation = "shadow"`',
    'set `compensation = "on"` when what it shows is right, then `pitch-gateway reload CONFIG`',
)
READY: Final = EventEntry(
    "ready",
    Severity.INFO,
    "all listeners and ports are open, or waited for; `addresses` says where",
    "a start",
)
STATUS: Final = EventEntry(
    "status", Severity.INFO, "the figures of a line or of an axis", "`--status-every` was asked for"
)
STOPPING: Final = EventEntry(
    "stopping",
    Severity.INFO,
    "a signal came: no new request is taken, and the exchange on the wire is finished",
    "Ctrl-C, SIGTERM, or the service was stopped",
)
STOPPED: Final = EventEntry("stopped", Severity.INFO, "everything is closed", "the end of a `stopping`")
STOPPED_AT_ONCE: Final = EventEntry(
    "stopped-at-once",
    Severity.WARNING,
    "the process ended without waiting; where `lines` names one, an exchange on it was not finished",
    "a second signal",
    "look where the axes of these lines stand before the next start; the line is given silence then",
)
HANGUP_IGNORED: Final = EventEntry(
    "hangup-ignored",
    Severity.INFO,
    "the relay got SIGHUP, which changes nothing there",
    "a terminal was closed, or the signal was meant for the supervisor",
)
UNEXPECTED: Final = EventEntry(
    "unexpected",
    Severity.ERROR,
    "something failed that the gateway does not provide for; `traceback` says where",
    "a mistake in the gateway, or a limit of the system such as the number of open files",
    "keep the log and report it; raise the limit where the detail names one",
)
STANDARD_ERROR: Final = EventEntry(
    "standard-error",
    Severity.ERROR,
    "`detail` is a line that a process wrote on standard error as text, where its log is JSON",
    "a start that fails, or a message of a library",
    "do what the detail says",
)
CONFIGURATION_WARNING: Final = EventEntry(
    "configuration-warning",
    Severity.WARNING,
    "something in the configuration or in a table is probably wrong, and the gateway starts all the same; "
    "told where the log is JSON",
    "what `pitch-gateway check CONFIG` warns of",
    "do what the detail says",
)
NOTES_DROPPED: Final = EventEntry(
    "notes-dropped",
    Severity.WARNING,
    "`count` notes are missing from the log, in this place",
    "whoever reads the log was slower than what happened: a stopped terminal, a full disk",
    "look why the log is not read; the traffic never waits for it",
)
SCHEDULING: Final = EventEntry(
    "scheduling",
    Severity.INFO,
    "the scheduling that is in force, as the kernel says",
    "a start with a key in `[relay]`",
)
SCHEDULING_REFUSED: Final = EventEntry(
    "scheduling-refused",
    Severity.WARNING,
    "the system refuses what `key` of `[relay]` asks for; the gateway runs without it",
    "no right to a real-time priority or to locked memory, or a CPU that is not there",
    "do what `remedy` says; see [real-time scheduling](operations.md#real-time-scheduling)",
)
SCHEDULING_WITHDRAWN: Final = EventEntry(
    "scheduling-withdrawn",
    Severity.WARNING,
    "the relay goes on with an ordinary priority until it is started again",
    "it computed for 200 ms without once waiting, which would have taken the CPU from everybody",
    "keep the log and report it; start the gateway again when the machine may stop",
)
STATE_FOLDER_OPEN: Final = EventEntry(
    "state-folder-open",
    Severity.WARNING,
    "others than the gateway's user may change the state folder, and with it what the gateway does",
    "the mode or the owner of the folder, or of one above it",
    "do what `remedy` says",
)
SOCKET_REFUSED: Final = EventEntry(
    "socket-refused",
    Severity.WARNING,
    "a client of `relay.sock` was refused; told once a minute for each kind, with a count",
    "another user, another release of the command line, more than eight clients, or one that sends nothing "
    "whole",
    "use the command line of the same release, as the user that the gateway runs as, or as root",
)
RECORDING_ENDED: Final = EventEntry(
    "recording-ended",
    Severity.ERROR,
    "the recording ended before the gateway did; what was written can be replayed",
    "the disk is full or too slow, or `--max-mb` was reached",
    "make room, record onto another disk, or give `record` a greater `--max-mb`",
)
CAPTURED: Final = EventEntry(
    "captured",
    Severity.INFO,
    "the frames before and after the event `on` were written into `file`",
    "`[capture] on` names the event",
    "look at it with `pitch-gateway replay FILE --show`",
)
CAPTURE_FAILED: Final = EventEntry(
    "capture-failed",
    Severity.WARNING,
    "the frames before and after the event `on` could not be written",
    "no room in the folder of the state, the relay is away, or it was started with `size_mb = 0`",
    "do what the detail says; `pitch-gateway capture CONFIG FILE` takes what is still there, into a folder "
    "where there is room",
)
SUPERVISING: Final = EventEntry(
    "supervising", Severity.INFO, "the supervisor begins, with the configuration that it follows", "a start"
)
RELAY_REACHED: Final = EventEntry(
    "relay-reached", Severity.INFO, "the supervisor has found the relay", "the start of either"
)
RELAY_NOT_REACHED: Final = EventEntry(
    "relay-not-reached",
    Severity.WARNING,
    "the supervisor has no connection to the relay; it tries again by itself",
    "the relay does not run, or is another release; the detail says why",
    "look at the relay's log, and start it",
)
SUPERVISOR_STARTED: Final = EventEntry(
    "supervisor-started",
    Severity.INFO,
    "`run` has started the supervisor again",
    "the end of a `supervisor-ended`",
)
SUPERVISOR_ENDED: Final = EventEntry(
    "supervisor-ended",
    Severity.WARNING,
    "the supervisor ended by itself; the relay goes on correcting, and `run` starts the supervisor again",
    "it was killed, ran out of memory, or met a mistake in the gateway; `status` says how it ended",
    "look at the lines before it in the log; report a traceback",
)
RELAY_ENDED: Final = EventEntry(
    "relay-ended",
    Severity.ERROR,
    "the relay ended by itself: positions pass no more, and `run` ends with it",
    "it was killed, ran out of memory, or met a mistake in the gateway; `status` says how it ended",
    "look at the lines before it in the log; let the service start it again, and report a traceback",
)
NO_PROGRESS: Final = EventEntry(
    "no-progress",
    Severity.ERROR,
    "the relay does not get on, and tells the service manager so no more: systemd ends it and starts it "
    "again; the "
    "detail says what is stuck",
    "a mistake in the gateway, or a process that was stopped by hand",
    "keep the log and report it",
)
DESCRIPTORS_DROPPED: Final = EventEntry(
    "descriptors-dropped",
    Severity.INFO,
    "sockets or ports that systemd kept over the restart were closed: nothing in the configuration is for "
    "them",
    "a controller's address, or a serial port, was changed",
)
