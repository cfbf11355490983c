"""Tables and commands: what was changed while the gateway runs, by whom, and what was refused."""

from typing import Final

from gateway.catalogue.entry import EventEntry, Severity

TABLE_ACTIVATED: Final = EventEntry(
    "table-activated",
    Severity.INFO,
    "the relay has taken a table for an axis; `comes` says when it is in force",
    "a changed table file, or a reload",
)
TABLE_REMOVED: Final = EventEntry(
    "table-removed",
    Severity.INFO,
    "the relay has taken the table of these axes away: they pass 1:1 from their next target on",
    "the file was renamed or taken away, or the configuration names none any more",
    "put the file back if that was not meant",
)
TABLE_REFUSED: Final = EventEntry(
    "table-refused",
    Severity.WARNING,
    "the relay refused a table that was handed to it; told once a minute",
    "a client of another release, or a damaged table",
    "run `pitch-gateway reload CONFIG` with the same release as the relay",
)
TABLE_HANDED_OVER: Final = EventEntry(
    "table-handed-over",
    Severity.INFO,
    "the supervisor has given the relay a table; `comes` says when it is in force",
    "a changed table file, a reload, or a relay that was started",
)
TABLE_TAKEN_AWAY: Final = EventEntry(
    "table-taken-away",
    Severity.INFO,
    "the supervisor has had the table of an axis taken away",
    "the file was renamed or taken away, or the configuration names none any more",
    "put the file back if that was not meant",
)
TABLE_REJECTED: Final = EventEntry(
    "table-rejected",
    Severity.ERROR,
    "a table file is bad: the last good table stays in force; `problems` has file, line and reason",
    "a mistake in the file, or one that does not fit the axis",
    "mend the file: it is read again as soon as it is saved; `pitch-gateway table lint FILE` shows it alone",
)
TABLE_MENDED: Final = EventEntry(
    "table-mended", Severity.INFO, "a table file that was bad is good", "the end of a `table-rejected`"
)
CONFIGURATION_CHANGED: Final = EventEntry(
    "configuration-changed",
    Severity.INFO,
    "a changed configuration was taken over; `keys` says what has changed",
    "a reload",
)
RELOAD_REFUSED: Final = EventEntry(
    "reload-refused",
    Severity.ERROR,
    "nothing, or not everything, could be taken over: what was in force stays; `problems` says why",
    "a mistake in the configuration, a key that needs a restart, or a relay that does not answer",
    "do what `problems` says, then `pitch-gateway reload CONFIG`",
)
NOTHING_TO_RELOAD: Final = EventEntry(
    "nothing-to-reload", Severity.INFO, "a reload was asked for, and nothing has changed", "a reload"
)
WATCHING_BY_LOOKS: Final = EventEntry(
    "watching-by-looks",
    Severity.WARNING,
    "the system does not tell of changes in the tables folder: it is looked at every second",
    "a network file system, or too many inotify watches",
    "on a local disk raise `fs.inotify.max_user_watches` with `sysctl`; on a network nothing has to be done",
)
STATE_FOLDER_UNUSABLE: Final = EventEntry(
    "state-folder-unusable",
    Severity.ERROR,
    "nothing can be kept in the state folder: the relay goes on, but a start would not find what it needs",
    "the folder was taken away, its disk is full or read-only, or somebody changed its permissions",
    "do what it says before the gateway is stopped or the machine switched off",
)
STATE_FOLDER_USABLE: Final = EventEntry(
    "state-folder-usable", Severity.INFO, "the state folder can be used again", "what was wrong is mended"
)
ENABLED: Final = EventEntry(
    "enabled", Severity.INFO, "the compensation of these axes was switched on", "a command"
)
DISABLED: Final = EventEntry(
    "disabled", Severity.INFO, "the compensation of these axes was switched off", "a command"
)
DRY_RUN_ENDED: Final = EventEntry(
    "dry-run-ended",
    Severity.INFO,
    "what these axes only showed is applied now, from their next different target on",
    '`compensation` was set from `"shadow"` to `"on"`, and the configuration reloaded',
)
REFERENCED: Final = EventEntry(
    "referenced",
    Severity.INFO,
    "somebody has declared these axes referenced where they stand",
    "`pitch-gateway reference`",
)
GAIN_CHANGED: Final = EventEntry(
    "gain-changed", Severity.INFO, "another share of the table is applied", "a command, or a reload"
)
LIMITS_CHANGED: Final = EventEntry(
    "limits-changed",
    Severity.INFO,
    "an axis has other limits",
    "a reload of a configuration with other limits",
)
