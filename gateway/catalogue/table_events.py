"""Tables and commands: what was changed while the gateway runs, by whom, and what was refused."""

from typing import Final

from gateway.catalogue.entry import EventEntry, Severity

TABLE_ACTIVATED: Final = EventEntry(
    "table-activated",
    Severity.INFO,
    "the relay has taken a table for an axis; `comes` says when it applies",
    "a changed table file, or a reload",
)
TABLE_REMOVED: Final = EventEntry(
    "table-removed",
    Severity.WARNING,
    "the relay has removed the table of these axes: they pass 1:1 from their next target on",
    "the file was renamed or removed, or the configuration no longer names it",
    "put the file back if that was not intended",
)
TABLE_REFUSED: Final = EventEntry(
    "table-refused",
    Severity.WARNING,
    "the relay refused a table that it was given. Reported once a minute",
    "a client of another release, or a damaged table",
    "run `pitch-gateway reload CONFIG` with the same release as the relay",
)
TABLE_HANDED_OVER: Final = EventEntry(
    "table-handed-over",
    Severity.INFO,
    "the supervisor has given the relay a table; `comes` says when it applies",
    "a changed table file, a reload, or a start of the relay",
)
TABLE_TAKEN_AWAY: Final = EventEntry(
    "table-taken-away",
    Severity.WARNING,
    "the supervisor has had the table of an axis removed",
    "the file was renamed or removed, or the configuration no longer names it",
    "put the file back if that was not intended",
)
TABLE_REJECTED: Final = EventEntry(
    "table-rejected",
    Severity.ERROR,
    "a table file is faulty: the last good table stays in force. `problems` gives file, line and reason",
    "see the trouble `table-rejected`",
    "correct the file: it is read again when saved. `pitch-gateway table lint FILE` checks it alone",
)
TABLE_WAITING: Final = EventEntry(
    "table-waiting",
    Severity.WARNING,
    "a reload did not take a table file, because a program writes it or may write it; the table in force "
    "stays until then. `problems` gives file and reason",
    "a reload while a table is being saved, or a program that holds the file open",
    "do what `problems` says. The supervisor takes the table when its file is complete",
)
TABLE_MENDED: Final = EventEntry(
    "table-mended", Severity.INFO, "a faulty table file is good again", "the end of a `table-rejected`"
)
CONFIGURATION_CHANGED: Final = EventEntry(
    "configuration-changed",
    Severity.INFO,
    "a changed configuration is in force; `keys` says what changed",
    "a reload",
)
RELOAD_REFUSED: Final = EventEntry(
    "reload-refused",
    Severity.ERROR,
    "the configuration was not taken over, or not completely; the rest stays as it was. `problems` says why",
    "a mistake in the configuration, a key that needs a restart, or a relay that does not answer",
    "do what `problems` says, then `pitch-gateway reload CONFIG`",
)
NOTHING_TO_RELOAD: Final = EventEntry(
    "nothing-to-reload", Severity.INFO, "a reload found no change", "a reload"
)
WATCHING_BY_LOOKS: Final = EventEntry(
    "watching-by-looks",
    Severity.WARNING,
    "the system does not report changes in the tables folder: the gateway checks it every second",
    "a network file system, or too many inotify watches",
    "on a local disk raise `fs.inotify.max_user_watches` with `sysctl`; on a network nothing is needed",
)
STATE_FOLDER_UNUSABLE: Final = EventEntry(
    "state-folder-unusable",
    Severity.ERROR,
    "the state folder cannot be written. The relay goes on, but would lack its data at the next start",
    "see the trouble `state_folder`",
    "do what the trouble `state_folder` says",
)
STATE_FOLDER_USABLE: Final = EventEntry(
    "state-folder-usable", Severity.INFO, "the state folder can be used again", "the fault was corrected"
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
    "corrections that these axes only showed are applied from their next different target on",
    '`compensation` was set from `"shadow"` to `"on"`, and the configuration reloaded',
)
REFERENCED: Final = EventEntry(
    "referenced",
    Severity.INFO,
    "these axes were declared referenced at their present position",
    "`pitch-gateway reference`",
)
GAIN_CHANGED: Final = EventEntry(
    "gain-changed",
    Severity.INFO,
    "the share of the table that is applied has changed",
    "a command, or a reload",
)
INTERVENTIONS_DAMAGED: Final = EventEntry(
    "interventions-damaged",
    Severity.WARNING,
    "the journal of interventions was changed or cut since it was written; it goes on. `count` says how many "
    "faults it has",
    "another program wrote into its folder, or the disk is bad",
    "keep a copy of the folder. `pitch-gateway journal verify CONFIG` names each line",
)
LIMITS_CHANGED: Final = EventEntry(
    "limits-changed",
    Severity.INFO,
    "an axis has new limits",
    "a reload of a configuration with other limits",
)
