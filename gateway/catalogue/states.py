"""States that the status shows, each with what it means and what to do."""

from collections.abc import Mapping
from typing import Final

from gateway.catalogue.entry import StateEntry

VERDICT: Final = (
    StateEntry(
        "healthy",
        "nothing is wrong: relay and supervisor run, controllers ask where they ought to, drives answer",
    ),
    StateEntry(
        "waiting",
        "nothing is wrong yet, and nothing is known to be well: no controller has asked since the relay was "
        "started, or the relay was not heard yet",
        "start the controller",
    ),
    StateEntry(
        "warning",
        "something is not as it should be; what a controller sends still passes",
        "do what its trouble says",
    ),
    StateEntry(
        "error",
        "positions do not pass, or not as they should: the machine needs you",
        "do what its trouble says",
    ),
)
"""``verdict.state``, and ``axes.NAME.verdict.state``."""

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
        "switch it on with `pitch-gateway enable CONFIG AXIS`; where the configuration says "
        '`compensation = "off"`, write `compensation = "on"` too, or the next start switches it off again; '
        "after `compensation-ended` start the gateway again",
    ),
    StateEntry(
        "shadow",
        "corrections are computed and shown; positions pass 1:1",
        'set `compensation = "on"` when what it shows is right, then `pitch-gateway reload CONFIG`',
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
        "put the file back, or take it out of the configuration, then `pitch-gateway reload CONFIG`",
    ),
)
"""``axes.NAME.table.status``."""

THERMAL: Final = (
    StateEntry(
        "waiting",
        "no temperature has been heard yet: nothing is added for it",
        "after `timeout_s` (then `is_silent`): look at the sensor and at `thermal.source`",
    ),
    StateEntry("following", "temperatures come: what is added follows them"),
    StateEntry(
        "held",
        "the sensor has been silent for `timeout_s`: its last value holds",
        "look at the sensor, the broker or the address it is read from",
    ),
    StateEntry(
        "fading",
        "the sensor has been silent for `hold_s` more: what is added goes back to 0 with the next targets",
        "look at the sensor, the broker or the address it is read from",
    ),
    StateEntry(
        "faded",
        "the sensor is still silent: nothing is added for the temperature",
        "look at the sensor, the broker or the address it is read from",
    ),
)
"""``axes.NAME.terms.thermal.state``."""

CROSS: Final = (
    StateEntry("waiting", "nobody has known yet where the other axes are: nothing is added for them"),
    StateEntry("following", "it is known where the other axes are: what is added follows them"),
    StateEntry(
        "held",
        "nobody knows where one of the other axes is: what they add is held for `fresh_s`",
        "give the other axis a target; where it lost its reference, home it first",
    ),
    StateEntry(
        "fading",
        "still nobody knows where one of the other axes is: what they add goes back to 0 with next targets",
        "give the other axis a target; where it lost its reference, home it first",
    ),
    StateEntry(
        "faded",
        "still nobody knows where one of the other axes is: nothing is added for them",
        "give the other axis a target; where it lost its reference, home it first",
    ),
)
"""``axes.NAME.terms.cross.state``."""

STATES: Final[Mapping[str, tuple[StateEntry, ...]]] = {
    "verdict.state": VERDICT,
    "axes.NAME.compensation": COMPENSATION,
    "axes.NAME.direction": DIRECTION,
    "axes.NAME.table.status": TABLE_FILE,
    "axes.NAME.terms.thermal.state": THERMAL,
    "axes.NAME.terms.cross.state": CROSS,
}
"""By the key of the status model."""
