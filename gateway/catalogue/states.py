"""States that the status shows, each with what it means and what to do."""

from collections.abc import Mapping
from typing import Final

from gateway.catalogue.entry import StateEntry

COMPENSATION: Final = (
    StateEntry("active", "the axis is corrected"),
    StateEntry(
        "blending",
        "the axis is corrected, and one table or branch gives way to another as the setpoint travels",
    ),
    StateEntry(
        "outside",
        "the last target lies outside the table: what `outside` says holds there",
        "measure the whole travel",
    ),
    StateEntry(
        "off",
        "the compensation is switched off: positions pass 1:1",
        "switch it on with `pitch-gateway enable CONFIG AXIS`; after `compensation-ended` start the "
        "gateway again",
    ),
    StateEntry(
        "shadow",
        "corrections are computed and shown; positions pass 1:1",
        'set `compensation = "on"` when what it shows is right',
    ),
    StateEntry(
        "blocked",
        "a target was lost on the way: triggers are refused until a whole one was accepted; stops pass",
        "let the controller write the target again",
    ),
    StateEntry("no-table", "no table is configured, or its file is gone: positions pass 1:1"),
    StateEntry("unreferenced", "nobody knows where the axis is: positions pass 1:1", "home the axis"),
)
"""``axes.NAME.compensation``."""

DIRECTION: Final = (
    StateEntry("forward", "towards greater machine positions: that column of the table holds"),
    StateEntry("backward", "towards smaller machine positions: that column of the table holds"),
    StateEntry("unknown", "there was no motion yet: half way between the columns holds"),
    StateEntry(
        "unsure",
        "it could not be told for the last target: the column before it holds",
        "map `actual` and `bits.done`, set `max_speed`",
    ),
)
"""``axes.NAME.direction``."""

TABLE_FILE: Final = (
    StateEntry("active", "it is what the axis has"),
    StateEntry("none", "the axis has none"),
    StateEntry("waiting", "the file changes, or has just gone: nothing has been done yet"),
    StateEntry(
        "rejected",
        "the file is bad, or one of its group is: the axis keeps the last good table",
        "mend the file that `error` names",
    ),
    StateEntry(
        "removed",
        "the file is gone, or was renamed to `.bak`: the axis is not corrected",
        "put the file back, or take it out of the configuration",
    ),
)
"""``axes.NAME.table.status``."""

STATES: Final[Mapping[str, tuple[StateEntry, ...]]] = {
    "axes.NAME.compensation": COMPENSATION,
    "axes.NAME.direction": DIRECTION,
    "axes.NAME.table.status": TABLE_FILE,
}
"""By the key of the status model."""
