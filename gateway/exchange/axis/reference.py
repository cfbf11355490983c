"""Whether an axis is referenced: only then are its positions corrected (M9).

The configuration says how this is known (``plan.Reference``); each kind of reference has its own table. Where
a status bit of the drive decides, the machine (:class:`AxisReference`) keeps two more facts. The first:
whether that bit was ever seen. The second: whether it must be read before positions pass (*unconfirmed*),
because the drive may have been switched off, or have got another zero, since the bit was seen.
:data:`ASKS_AGAIN` lists the events that make the reference unconfirmed, also where the table says IGNORED.
"""

from collections.abc import Callable
from enum import Enum
from typing import Final

from gateway.exchange.axis.impossible import IGNORED, sentence_of
from gateway.exchange.plan import DONE_BIT, HOMED_BIT, HOMING_DONE_BIT, AxisPlan, Reference
from gateway.times import NS_PER_MS, NS_PER_S


class ReferenceState(Enum):
    """Whether the axis is referenced."""

    __hash__ = object.__hash__

    NOT_REFERENCED = "not-referenced"
    """The axis was not referenced yet, or may have lost its reference."""
    HOMING = "homing"
    """A homing command was seen, but not its end."""
    REFERENCED = "referenced"
    """The axis is referenced: its positions are corrected."""


# Member lookup is slow, and these are used for each frame.
_NOT_REFERENCED: Final = ReferenceState.NOT_REFERENCED
_HOMING: Final = ReferenceState.HOMING
_REFERENCED: Final = ReferenceState.REFERENCED


class ReferenceEvent(Enum):
    """What decides whether an axis is referenced."""

    __hash__ = object.__hash__

    BIT_SET = "bit-set"
    """The deciding bit is set, and cannot belong to the homing before."""
    BIT_CLEAR = "bit-clear"
    """The deciding bit is clear."""
    HOMING = "homing"
    """A homing command was sent."""
    OTHER_MOTION = "other-motion"
    """Something else was commanded. It aborts a homing that was going on."""
    SET_AT_REST = "set-at-rest"
    """The drive got a new position value at standstill."""
    SET_MOVING = "set-moving"
    """The same while it moved, or it is unknown whether the drive got it."""
    LOSS = "loss"
    """The drive may have lost its position: power off, an alarm, a jump."""
    SILENCE = "silence"
    """A request was not answered."""
    DECLARED = "declared"
    """A person confirms that the axis is where its drive says."""


_Rows = dict[ReferenceEvent, ReferenceState | None]

REFERENCE_AFTER: Final[dict[Reference, dict[ReferenceState, _Rows]]] = {
    # The reference is known from the start until the zero is moved. It needs neither homing nor a bit.
    Reference.ABSOLUTE: {
        ReferenceState.NOT_REFERENCED: {
            ReferenceEvent.HOMING: IGNORED,
            ReferenceEvent.OTHER_MOTION: IGNORED,
            ReferenceEvent.SET_AT_REST: IGNORED,  # it is not referenced already
            ReferenceEvent.SET_MOVING: IGNORED,
            ReferenceEvent.LOSS: IGNORED,
            ReferenceEvent.DECLARED: ReferenceState.REFERENCED,
        },
        ReferenceState.REFERENCED: {
            ReferenceEvent.HOMING: IGNORED,  # the absolute encoder decides
            ReferenceEvent.OTHER_MOTION: IGNORED,
            ReferenceEvent.SET_AT_REST: ReferenceState.NOT_REFERENCED,
            ReferenceEvent.SET_MOVING: ReferenceState.NOT_REFERENCED,
            ReferenceEvent.LOSS: IGNORED,  # it keeps its position without power
            ReferenceEvent.DECLARED: IGNORED,
        },
    },
    # Homing does not count; the position that is set after it, at standstill, does.
    Reference.SET_POSITION: {
        ReferenceState.NOT_REFERENCED: {
            ReferenceEvent.HOMING: IGNORED,
            ReferenceEvent.OTHER_MOTION: IGNORED,
            ReferenceEvent.SET_AT_REST: ReferenceState.REFERENCED,
            ReferenceEvent.SET_MOVING: IGNORED,  # it is unknown where the axis was at that moment
            ReferenceEvent.LOSS: IGNORED,
            ReferenceEvent.DECLARED: ReferenceState.REFERENCED,
        },
        ReferenceState.REFERENCED: {
            ReferenceEvent.HOMING: ReferenceState.NOT_REFERENCED,
            ReferenceEvent.OTHER_MOTION: IGNORED,
            ReferenceEvent.SET_AT_REST: IGNORED,
            ReferenceEvent.SET_MOVING: ReferenceState.NOT_REFERENCED,
            ReferenceEvent.LOSS: ReferenceState.NOT_REFERENCED,
            ReferenceEvent.DECLARED: IGNORED,
        },
    },
    # A homing command begins the homing, and a bit completes it at its end. That bit is read only in between.
    Reference.HOMING: {
        ReferenceState.NOT_REFERENCED: {
            ReferenceEvent.HOMING: ReferenceState.HOMING,
            ReferenceEvent.OTHER_MOTION: IGNORED,
            ReferenceEvent.SET_AT_REST: IGNORED,
            ReferenceEvent.SET_MOVING: IGNORED,
            ReferenceEvent.LOSS: IGNORED,
            ReferenceEvent.DECLARED: ReferenceState.REFERENCED,
        },
        ReferenceState.HOMING: {
            ReferenceEvent.BIT_SET: ReferenceState.REFERENCED,
            ReferenceEvent.HOMING: IGNORED,  # again
            ReferenceEvent.OTHER_MOTION: ReferenceState.NOT_REFERENCED,  # the homing was aborted
            ReferenceEvent.SET_AT_REST: ReferenceState.NOT_REFERENCED,
            ReferenceEvent.SET_MOVING: ReferenceState.NOT_REFERENCED,
            ReferenceEvent.LOSS: ReferenceState.NOT_REFERENCED,
            ReferenceEvent.DECLARED: ReferenceState.REFERENCED,
        },
        ReferenceState.REFERENCED: {
            ReferenceEvent.HOMING: ReferenceState.HOMING,
            ReferenceEvent.OTHER_MOTION: IGNORED,
            ReferenceEvent.SET_AT_REST: ReferenceState.NOT_REFERENCED,
            ReferenceEvent.SET_MOVING: ReferenceState.NOT_REFERENCED,
            ReferenceEvent.LOSS: ReferenceState.NOT_REFERENCED,
            ReferenceEvent.DECLARED: IGNORED,
        },
    },
    # The drive reports it: the axis is referenced while its homed bit is set. Shortly after a homing command
    # a set bit may still be that of the homing before, and does not count (``SETTLE_NS``). A person cannot
    # declare this reference.
    Reference.DRIVE_BIT: {
        ReferenceState.NOT_REFERENCED: {
            ReferenceEvent.BIT_SET: ReferenceState.REFERENCED,
            ReferenceEvent.BIT_CLEAR: IGNORED,
            ReferenceEvent.HOMING: ReferenceState.HOMING,
            ReferenceEvent.OTHER_MOTION: IGNORED,
            ReferenceEvent.SET_AT_REST: IGNORED,
            ReferenceEvent.SET_MOVING: IGNORED,
            ReferenceEvent.LOSS: IGNORED,
            ReferenceEvent.SILENCE: IGNORED,
        },
        ReferenceState.HOMING: {
            ReferenceEvent.BIT_SET: ReferenceState.REFERENCED,
            ReferenceEvent.BIT_CLEAR: ReferenceState.NOT_REFERENCED,
            ReferenceEvent.HOMING: IGNORED,
            ReferenceEvent.OTHER_MOTION: ReferenceState.NOT_REFERENCED,  # the homing was aborted
            ReferenceEvent.SET_AT_REST: ReferenceState.NOT_REFERENCED,
            ReferenceEvent.SET_MOVING: ReferenceState.NOT_REFERENCED,
            ReferenceEvent.LOSS: ReferenceState.NOT_REFERENCED,
            ReferenceEvent.SILENCE: IGNORED,
        },
        ReferenceState.REFERENCED: {
            ReferenceEvent.BIT_SET: IGNORED,
            ReferenceEvent.BIT_CLEAR: ReferenceState.NOT_REFERENCED,
            ReferenceEvent.HOMING: ReferenceState.HOMING,
            ReferenceEvent.OTHER_MOTION: IGNORED,
            ReferenceEvent.SET_AT_REST: ReferenceState.NOT_REFERENCED,
            ReferenceEvent.SET_MOVING: ReferenceState.NOT_REFERENCED,
            ReferenceEvent.LOSS: IGNORED,  # the bit shows whether it was one
            ReferenceEvent.SILENCE: IGNORED,
        },
    },
}
"""The state after each event, for each kind of reference; a missing pair is impossible.

``BIT_CLEAR`` and ``SILENCE`` occur only for ``Reference.DRIVE_BIT``. ``BIT_SET`` occurs for it, and for
``Reference.HOMING``, where a bit ends the homing. Only these two kinds have the state ``HOMING``.
"""
ASKS_AGAIN: Final = frozenset(
    {
        ReferenceEvent.HOMING,
        ReferenceEvent.SET_AT_REST,
        ReferenceEvent.SET_MOVING,
        ReferenceEvent.LOSS,
        ReferenceEvent.SILENCE,
    }
)
"""Events after which a deciding bit must be read before positions pass, in every state."""
BITS: Final = frozenset({ReferenceEvent.BIT_SET, ReferenceEvent.BIT_CLEAR})

REFERENCE_AT_START: Final = {
    Reference.ABSOLUTE: _REFERENCED,
    Reference.DRIVE_BIT: _NOT_REFERENCED,
    Reference.HOMING: _NOT_REFERENCED,
    Reference.SET_POSITION: _NOT_REFERENCED,
}
FRESH_NS: Final = NS_PER_S
"""A homed bit older than this is read again before a target."""
SETTLE_NS: Final = 100 * NS_PER_MS
"""A bit that is still set so soon after a homing command may belong to the homing before."""


class AxisReference:
    """Whether one axis is referenced. Time is monotonic, in ns."""

    __slots__ = (
        "_on_fault",
        "_settle_ns",
        "bit",
        "bit_seen_ns",
        "follows_homed_bit",
        "homing_since_ns",
        "is_referenced",
        "is_remapped",
        "is_unconfirmed",
        "kind",
        "state",
        "waits_for_peers",
        "was_reported",
    )

    def __init__(self, plan: AxisPlan, on_fault: Callable[[str], None]) -> None:
        self._on_fault = on_fault
        self.kind = plan.referenced
        self.follows_homed_bit = plan.referenced is Reference.DRIVE_BIT
        """Whether the drive's homed bit decides."""
        self.bit = HOMED_BIT
        """Name of the bit that shows the end of homing."""
        if plan.referenced is Reference.HOMING and HOMED_BIT not in plan.bits:
            self.bit = HOMING_DONE_BIT if HOMING_DONE_BIT in plan.bits else DONE_BIT
        self._settle_ns = SETTLE_NS
        """A bit that is still set so soon after a homing command may be that of the motion before."""
        if self.bit == DONE_BIT:
            self._settle_ns = max(SETTLE_NS, int(plan.done_drop_ms * NS_PER_MS))
        self.state = REFERENCE_AT_START[plan.referenced]
        self.is_unconfirmed = self.follows_homed_bit
        """The deciding bit must be read before positions pass."""
        self.was_reported = not self.follows_homed_bit
        """Whether the homed bit was ever seen, if it decides."""
        self.bit_seen_ns = 0
        """When the deciding bit was last seen."""
        self.homing_since_ns = 0
        """When the last homing command was sent, or when the bit was seen clear since."""
        self.is_remapped = False
        """A remapping register of its unit was written (M10): nothing is corrected until a restart."""
        self.waits_for_peers = False
        """Another axis of its group is not referenced (M11)."""
        self.is_referenced = self.state is _REFERENCED
        """Whether the axis, and every axis of its group, is referenced, as far as is known."""

    def happens(self, event: ReferenceEvent) -> None:
        """Enter the state that the table gives, with its data."""
        try:
            after = REFERENCE_AFTER[self.kind][self.state][event]
        except KeyError:
            sentence = sentence_of("reference", self.state, event)
            self._on_fault(sentence)  # ``_on_fault`` calls :meth:`invalidate`, where a bit decides
            return
        if after is not IGNORED:
            self._enter(after)
        if self.follows_homed_bit:
            if event in BITS:
                self.is_unconfirmed, self.was_reported = False, True
            elif event in ASKS_AGAIN:
                self.is_unconfirmed = True

    def invalidate(self) -> None:
        """The reference is unknown until it is read again or declared."""
        self._enter(_NOT_REFERENCED)
        self.is_unconfirmed = self.follows_homed_bit

    def _enter(self, state: ReferenceState) -> None:
        self.state = state
        self.is_referenced = state is _REFERENCED and not self.waits_for_peers

    def begin_homing(self, now_ns: int, *, is_certain: bool) -> None:
        """A homing command was sent; ``is_certain``: the drive acknowledged it."""
        self.homing_since_ns = now_ns
        self.happens(ReferenceEvent.HOMING)
        if not is_certain:  # it may not be homing: the next set bit ends nothing
            self.happens(ReferenceEvent.OTHER_MOTION)

    def see_homed_bit(self, now_ns: int, *, is_set: bool) -> None:
        """Record the drive's homed bit, if it decides."""
        if is_set and self.is_homing and now_ns - self.homing_since_ns < SETTLE_NS:
            return  # it may belong to the homing before
        self.bit_seen_ns = now_ns
        self.happens(ReferenceEvent.BIT_SET if is_set else ReferenceEvent.BIT_CLEAR)

    def see_end_of_homing(self, now_ns: int, *, is_set: bool) -> None:
        """Record the bit that ends a homing command, if it is not a bit that decides permanently."""
        if not self.awaits_end:
            return
        if not is_set:
            self.homing_since_ns = now_ns - self._settle_ns
        elif now_ns - self.homing_since_ns >= self._settle_ns:
            self.happens(ReferenceEvent.BIT_SET)

    def wait_for_peers(self, *, waits: bool) -> None:
        """Another axis of its group is not referenced (``waits``), or all are (M11)."""
        self.waits_for_peers = waits
        self._enter(self.state)

    def end(self) -> None:
        """The registers of its drive have another meaning from now on."""
        self.is_remapped = True

    @property
    def is_found(self) -> bool:
        """Whether the axis itself is referenced, as far as is known."""
        return self.state is _REFERENCED

    @property
    def is_homing(self) -> bool:
        """Whether the end of a homing command is awaited."""
        return self.state is _HOMING

    @property
    def awaits_end(self) -> bool:
        """Whether a bit must still show the end of a homing command; that bit does not decide permanently."""
        return self.state is _HOMING and self.kind is Reference.HOMING

    @property
    def ends_with_mode(self) -> bool:
        """Whether in another mode that bit means something else."""
        return self.awaits_end and self.bit == HOMING_DONE_BIT

    @property
    def is_lost(self) -> bool:
        """Whether it is certain that the axis is not referenced."""
        return self.was_reported and self.state is not _REFERENCED

    @property
    def depends_on_bit(self) -> bool:
        """Whether a status bit of the drive shows that the reference was found."""
        return self.kind in (Reference.DRIVE_BIT, Reference.HOMING)

    def needs_reading(self, now_ns: int, *, before_target: bool) -> bool:
        """Whether the bit must be read before positions pass.

        ``before_target``: the next position is a target, which an old bit holds up.
        """
        if not self.follows_homed_bit:
            return before_target and self.awaits_end
        is_old = self.state is not _REFERENCED or now_ns - self.bit_seen_ns > FRESH_NS
        return self.is_unconfirmed or (before_target and is_old)
