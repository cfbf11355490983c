"""Processes: how relay and supervisor start, run and end."""

from typing import Final

from gateway.catalogue.entry import EventEntry, Severity

STARTING: Final = EventEntry(
    "starting",
    Severity.INFO,
    "the relay begins; with the gateway's name and its platform",
    "a start",
)
LINE: Final = EventEntry(
    "line", Severity.INFO, "a line of the configuration: drives and controllers", "a start"
)
AXIS: Final = EventEntry("axis", Severity.INFO, "an axis of the configuration, and its table", "a start")
SHADOW: Final = EventEntry(
    "shadow",
    Severity.WARNING,
    "shadow mode: corrections are computed and shown, positions pass 1:1",
    '`compensation = "shadow"`',
    'when the shown corrections are right, set `compensation = "on"`, then `pitch-gateway reload CONFIG`',
)
READY: Final = EventEntry(
    "ready",
    Severity.INFO,
    "all listeners and ports in `addresses` are open or waited for",
    "a start",
)
STATUS: Final = EventEntry(
    "status", Severity.INFO, "the figures of a line or of an axis", "the option `--status-every`"
)
STOPPING: Final = EventEntry(
    "stopping",
    Severity.INFO,
    "a signal came: the gateway takes no new request and finishes the current exchange",
    "Ctrl-C, SIGTERM, or the service was stopped",
)
STOPPED: Final = EventEntry("stopped", Severity.INFO, "everything is closed", "the end of a `stopping`")
STOPPED_AT_ONCE: Final = EventEntry(
    "stopped-at-once",
    Severity.WARNING,
    "the process ended without waiting; on each line in `lines` an exchange was cut off",
    "a second signal",
    "check the axes of these lines before the next start. The gateway then waits for silence on the line",
)
HANGUP_IGNORED: Final = EventEntry(
    "hangup-ignored",
    Severity.INFO,
    "the relay got SIGHUP and ignored it",
    "a terminal was closed, or the signal was meant for the supervisor",
)
UNEXPECTED: Final = EventEntry(
    "unexpected",
    Severity.ERROR,
    "an error that the gateway does not handle; `traceback` shows where",
    "a bug in the gateway, or a system limit such as the number of open files",
    "keep the log and report it. If the detail names a limit, raise it",
)
STANDARD_ERROR: Final = EventEntry(
    "standard-error",
    Severity.ERROR,
    "`detail` is a line that a process wrote to standard error as text, while its log is JSON",
    "a failed start, or a message of a library",
    "do what the detail says",
)
CONFIGURATION_WARNING: Final = EventEntry(
    "configuration-warning",
    Severity.WARNING,
    "something in the configuration or a table is probably wrong; the gateway starts anyway. Reported if "
    "the log is JSON",
    "the warning that `pitch-gateway check CONFIG` prints",
    "do what the detail says",
)
NOTES_DROPPED: Final = EventEntry(
    "notes-dropped",
    Severity.WARNING,
    "`count` entries are missing from the log at this point",
    "the log was read too slowly: a stopped terminal, a full disk",
    "check why the log is not read. Traffic never waits for it",
)
SCHEDULING: Final = EventEntry(
    "scheduling",
    Severity.INFO,
    "the scheduling in force, as the kernel reports it",
    "a start with a key in `[relay]`",
)
SCHEDULING_REFUSED: Final = EventEntry(
    "scheduling-refused",
    Severity.WARNING,
    "the system refuses what `key` of `[relay]` asks for; the gateway runs without it",
    "no right to real-time priority or locked memory, or a CPU that does not exist",
    "do what `remedy` says; see [real-time scheduling](operations.md#real-time-scheduling)",
)
SCHEDULING_WITHDRAWN: Final = EventEntry(
    "scheduling-withdrawn",
    Severity.WARNING,
    "the relay continues with ordinary priority until it is restarted",
    "it computed for 200 ms without waiting, which would block other programs",
    "keep the log and report it. Restart the gateway when the machine may stop",
)
STATE_FOLDER_OPEN: Final = EventEntry(
    "state-folder-open",
    Severity.WARNING,
    "other users may change the state folder, and with it what the gateway does",
    "mode or owner of the folder, or of one above it",
    "do what `remedy` says",
)
SOCKET_REFUSED: Final = EventEntry(
    "socket-refused",
    Severity.WARNING,
    "a client of `relay.sock` was refused",
    "another user, another release of the command line, more than eight clients, or an incomplete request",
    "use the command line of the same release, as the gateway's user or as root",
)
SOCKET_MISSING: Final = EventEntry(
    "socket-missing",
    Severity.WARNING,
    "`relay.sock` was removed while the relay runs: until it is made again, no command reaches the relay. "
    "The relay tries that every few seconds",
    "another program cleans up the state folder, or the folder was replaced",
    "keep that program away from the state folder. If the socket could not be made, do what `detail` says",
)
RECORDING_ENDED: Final = EventEntry(
    "recording-ended",
    Severity.ERROR,
    "the recording ended before the gateway did; what it holds can be replayed",
    "the disk is full or too slow, or `--max-mb` was reached",
    "make room, use another disk, or give `record` a greater `--max-mb`",
)
CAPTURED: Final = EventEntry(
    "captured",
    Severity.INFO,
    "the frames around the event `on` were written to `file`",
    "`[capture] on` names the event",
    "show it with `pitch-gateway replay FILE --show`",
)
CAPTURE_FAILED: Final = EventEntry(
    "capture-failed",
    Severity.WARNING,
    "the frames around the event `on` could not be written",
    "the state folder is full, the relay does not run, or it was started with `size_mb = 0`",
    "do what the detail says. `pitch-gateway capture CONFIG FILE` saves the frames to a folder with room",
)
SUPERVISING: Final = EventEntry(
    "supervising", Severity.INFO, "the supervisor begins, with the configuration that it follows", "a start"
)
RELAY_REACHED: Final = EventEntry(
    "relay-reached", Severity.INFO, "the supervisor is connected to the relay", "a start of either"
)
RELAY_NOT_REACHED: Final = EventEntry(
    "relay-not-reached",
    Severity.WARNING,
    "the supervisor has no connection to the relay and keeps trying",
    "the relay does not run, or has another release; the detail says why",
    "check the relay's log, and start it",
)
SUPERVISOR_STARTED: Final = EventEntry(
    "supervisor-started",
    Severity.INFO,
    "`run` has restarted the supervisor",
    "the end of a `supervisor-ended`",
)
SUPERVISOR_ENDED: Final = EventEntry(
    "supervisor-ended",
    Severity.WARNING,
    "the supervisor ended unexpectedly. The relay goes on; `run` restarts the supervisor",
    "it was killed, ran out of memory, or met a bug; `status` says how it ended",
    "read the log lines before it, and report a traceback",
)
RELAY_ENDED: Final = EventEntry(
    "relay-ended",
    Severity.ERROR,
    "the relay ended unexpectedly: no position passes, and `run` ends too",
    "it was killed, ran out of memory, or met a bug; `status` says how it ended",
    "read the log lines before it. Let the service restart it, and report a traceback",
)
NO_PROGRESS: Final = EventEntry(
    "no-progress",
    Severity.ERROR,
    "the relay is stuck and stops reporting to the service manager: systemd ends and restarts it. The "
    "detail says what is stuck",
    "a bug in the gateway, or a process stopped by hand",
    "keep the log and report it",
)
DESCRIPTORS_DROPPED: Final = EventEntry(
    "descriptors-dropped",
    Severity.INFO,
    "sockets or ports that systemd kept over the restart were closed: the configuration no longer uses them",
    "a changed controller address or serial port",
)
