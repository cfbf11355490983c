"""States in the status, each with what it means and what to do."""

from collections.abc import Mapping
from typing import Final

from gateway.catalogue.entry import StateEntry

_SENSOR: Final = "check the sensor, the broker or its address"
_OTHER_AXIS: Final = "give the other axis a target, or home it first if it lost its reference"

VERDICT: Final = (
    StateEntry(
        "healthy",
        "no trouble: relay and supervisor run, controllers poll, drives answer",
    ),
    StateEntry(
        "waiting",
        "no trouble yet, but no controller has sent a request since the relay started, or the relay has "
        "not reported yet",
        "start the controller",
    ),
    StateEntry(
        "warning",
        "something is wrong; the controller's positions still pass",
        "do what its trouble says",
    ),
    StateEntry(
        "error",
        "positions do not pass, or not as they should: the machine needs attention",
        "do what its trouble says",
    ),
)
"""``verdict.state``, and ``axes.NAME.verdict.state``."""

COMPENSATION: Final = (
    StateEntry("active", "the axis is corrected"),
    StateEntry(
        "blending",
        "the axis is corrected; one table or branch blends into another as the setpoint moves",
    ),
    StateEntry(
        "outside",
        "the last target is outside the table: `outside` applies",
        "measure the whole travel",
    ),
    StateEntry(
        "off",
        "the compensation is switched off, or its gain is 0: positions pass 1:1",
        'nothing, if the axis has no table and the configuration says `compensation = "off"`. Otherwise do '
        "what its trouble says",
    ),
    StateEntry(
        "shadow",
        "corrections are computed and shown; positions pass 1:1",
        "do what the trouble `shadow` says",
    ),
    StateEntry(
        "blocked",
        "a target was lost: triggers are refused until a complete one is accepted; stops pass",
        "have the controller write the target again",
    ),
    StateEntry(
        "no-table",
        "no table is configured, or its file is missing: positions pass 1:1",
        "do what the trouble `no-table` or `table-removed` says",
    ),
    StateEntry("unreferenced", "the position of the axis is unknown: positions pass 1:1", "home the axis"),
)
"""``axes.NAME.compensation``."""

DIRECTION: Final = (
    StateEntry("forward", "towards greater machine positions: the forward column applies"),
    StateEntry("backward", "towards smaller machine positions: the backward column applies"),
    StateEntry("unknown", "no motion yet: the mean of both columns applies"),
    StateEntry(
        "unsure",
        "unknown for the last target: the previous column applies",
        "map `actual` and `bits.done`, set `max_speed`",
    ),
)
"""``axes.NAME.direction``."""

TABLE_FILE: Final = (
    StateEntry("active", "the axis uses this file"),
    StateEntry("none", "the axis has no table"),
    StateEntry(
        "waiting",
        "the file is changing, has just disappeared, or could not be applied: the table stays for now",
        "if it lasts, do what the trouble `table-waiting` or `tables_folder` says",
    ),
    StateEntry(
        "rejected",
        "the file, or one of its group, is faulty: the axis keeps the last good table",
        "correct the file that `error` names",
    ),
    StateEntry(
        "removed",
        "the file is missing, or was renamed to `.bak`: the axis is not corrected",
        "put the file back, or remove it from the configuration, then `pitch-gateway reload CONFIG`",
    ),
)
"""``axes.NAME.table.status``."""

THERMAL: Final = (
    StateEntry(
        "waiting",
        "no temperature yet: no thermal correction",
        "after `timeout_s` (then `is_silent`): check the sensor and `thermal.source`",
    ),
    StateEntry("following", "the thermal correction follows the temperature"),
    StateEntry(
        "held",
        "the sensor has been silent for `timeout_s`: its last value is held",
        _SENSOR,
    ),
    StateEntry(
        "fading",
        "the sensor has been silent for another `hold_s`: the correction returns to 0 with the next targets",
        _SENSOR,
    ),
    StateEntry(
        "faded",
        "the sensor is still silent: no thermal correction",
        _SENSOR,
    ),
)
"""``axes.NAME.terms.thermal.state``."""

CROSS: Final = (
    StateEntry("waiting", "the positions of the other axes have not been known yet: no correction"),
    StateEntry("following", "the correction follows the other axes"),
    StateEntry(
        "held",
        "the position of another axis is unknown: the last correction is held for `fresh_s`",
        _OTHER_AXIS,
    ),
    StateEntry(
        "fading",
        "it is still unknown: the correction returns to 0 with the next targets",
        _OTHER_AXIS,
    ),
    StateEntry(
        "faded",
        "it is still unknown: no correction",
        _OTHER_AXIS,
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
