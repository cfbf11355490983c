"""What the exchange reports besides counters. ``catalogue.exchange_events`` says what each kind means."""

from dataclasses import dataclass
from enum import Enum


class EventKind(Enum):
    """Kind of an event; the value is the name that logs and status show."""

    LINE_UP = "line-up"
    LINE_DOWN = "line-down"
    CONNECTION_RENEWED = "connection-renewed"
    DRIVE_SILENT = "drive-silent"
    DRIVE_BACKED_OFF = "drive-backed-off"
    DRIVE_ANSWERS = "drive-answers"
    CUT_THROUGH_OFF = "cut-through-off"
    AXIS_REFERENCED = "axis-referenced"
    REFERENCE_LOST = "reference-lost"
    DIRECTION_UNSURE = "direction-unsure"
    BRANCH_HUNTS = "branch-hunts"
    COMPENSATION_ENDED = "compensation-ended"
    REFUSED_VALUE = "refused-value"
    AXIS_BLOCKED = "axis-blocked"
    AXIS_RELEASED = "axis-released"
    GROUP_HELD = "group-held"
    GROUP_SKEWED = "group-skewed"
    RESTAGED = "restaged"
    UNKNOWN_MODE = "unknown-mode"
    STORED_MOVE = "stored-move"
    BASE_UNKNOWN = "base-unknown"
    STREAM_BEGAN = "stream-began"
    RESTORED = "restored"
    RECORD_NOT_USED = "record-not-used"
    WITHDRAWN = "withdrawn"
    STOOD_STILL = "stood-still"
    LATE_TARGET = "late-target"
    BUDGET_OVERRUN = "budget-overrun"
    BUDGET_KEPT = "budget-kept"
    LATE_REPLY = "late-reply"
    UNKNOWN_UNIT = "unknown-unit"
    REQUEST_REFUSED = "request-refused"
    SECOND_WRITER = "second-writer"
    INTERNAL_FAULT = "internal-fault"
    TERM_FOLLOWS = "term-follows"
    TERM_HELD = "term-held"
    TERM_FADES = "term-fades"
    TERM_TOO_LARGE = "term-too-large"


@dataclass(frozen=True, slots=True)
class Event:
    """One thing that happened; ``detail`` is a sentence for the operator."""

    kind: EventKind
    axis: str | None = None
    detail: str = ""
    more: tuple[tuple[str, object], ...] = ()
    """Further fields, by name."""
