"""What the exchange reports besides counters. The catalogue of kinds is complete: documents list it."""

from dataclasses import dataclass
from enum import Enum


class EventKind(Enum):
    """Kind of an event; the value is the name that logs and status show."""

    LINE_UP = "line-up"
    LINE_DOWN = "line-down"
    DRIVE_SILENT = "drive-silent"
    """A drive did not answer in time, after one that did."""
    DRIVE_ANSWERS = "drive-answers"
    AXIS_REFERENCED = "axis-referenced"
    REFERENCE_LOST = "reference-lost"
    DIRECTION_UNSURE = "direction-unsure"
    """Where the axis is could not be told; it keeps its branch."""
    COMPENSATION_ENDED = "compensation-ended"
    """A register was written that moves other registers about; it ends until the gateway is started again."""
    REFUSED_VALUE = "refused-value"
    AXIS_BLOCKED = "axis-blocked"
    """A target was lost: its triggers are refused until the drive has accepted a complete one."""
    AXIS_RELEASED = "axis-released"
    RESTAGED = "restaged"
    """A staged target was written once more, because its correction was another one at its trigger."""
    UNKNOWN_MODE = "unknown-mode"
    """A frame meant something that the register map does not know: it passed untouched."""
    STORED_MOVE = "stored-move"
    """A position that the drive keeps was to be run: nobody knows which correction it carries."""
    BASE_UNKNOWN = "base-unknown"
    """A relative move came while nobody knew where it starts."""
    RESTORED = "restored"
    """An axis goes on where its record of the run before says that it was."""
    RECORD_NOT_USED = "record-not-used"
    """There was a record of the run before, and it does not count."""
    WITHDRAWN = "withdrawn"
    """A request was not sent, because its controller had given up on it."""
    LATE_TARGET = "late-target"
    """A target or trigger had waited longer than its axis's deadline."""
    BUDGET_OVERRUN = "budget-overrun"
    """An exchange cost more gateway time than its axis's budget, after many that did not."""
    BUDGET_KEPT = "budget-kept"
    """The budget is kept again."""
    LATE_REPLY = "late-reply"
    """A drive sent a frame that answers nothing: late, or twice."""
    REQUEST_REFUSED = "request-refused"
    """A controller asked for what its role or its rights do not allow, or too often."""
    SECOND_WRITER = "second-writer"
    """A controller wanted to move an axis that another one moves."""


@dataclass(frozen=True, slots=True)
class Event:
    """One thing that happened; ``detail`` is a sentence for the operator."""

    kind: EventKind
    axis: str | None = None
    detail: str = ""
    more: tuple[tuple[str, object], ...] = ()
    """Further fields, by name."""
