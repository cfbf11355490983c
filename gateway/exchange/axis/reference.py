"""Whether an axis knows where it is: only then are its positions corrected (M9).

How that can be known is configured (``plan.Reference``), and each way has its own table. Beside its state
the machine (:class:`AxisReference`) has two facts that matter where a bit of the drive decides: whether that
bit was ever seen, and whether it has to be read before positions pass (*unconfirmed*: the drive may have been
switched off, or told another zero, since it was read last). :data:`ASKS_AGAIN` says after which events.
"""

from collections.abc import Callable
from enum import Enum
from typing import Final

from gateway.exchange.axis.impossible import IGNORED, sentence_of
from gateway.exchange.plan import DONE_BIT, HOMED_BIT, AxisPlan, Reference
from gateway.times import NS_PER_MS, NS_PER_S


class ReferenceState(Enum):
    """Whether the axis knows where it is."""

    __hash__ = object.__hash__

    NOT_REFERENCED = "not-referenced"
    """Nobody has said yet where the axis stands, or it may have lost that."""
    HOMING = "homing"
    """A homing command was seen, and not yet its end."""
    REFERENCED = "referenced"
    """The axis knows where it is: its positions are corrected."""


# A member is looked up slowly, and these are asked for with each frame.
_NOT_REFERENCED: Final = ReferenceState.NOT_REFERENCED
_HOMING: Final = ReferenceState.HOMING
_REFERENCED: Final = ReferenceState.REFERENCED


class ReferenceEvent(Enum):
    """What decides whether an axis knows where it is."""

    __hash__ = object.__hash__

    BIT_SET = "bit-set"
    """The bit that decides is set, and it was set after the homing began."""
    BIT_CLEAR = "bit-clear"
    """The bit that decides is not set."""
    HOMING = "homing"
    """A homing command went out."""
    OTHER_MOTION = "other-motion"
    """Something else was commanded: the bit that is seen next does not end a homing."""
    SET_AT_REST = "set-at-rest"
    """The drive was told that it stands somewhere else, and it stood."""
    SET_MOVING = "set-moving"
    """The same, and it moved, or nobody knows whether it was told."""
    LOSS = "loss"
    """The drive may have lost its position: switched off, an alarm, a jump."""
    SILENCE = "silence"
    """A request was not answered."""
    DECLARED = "declared"
    """A person says that the axis stands where its drive says."""


_Rows = dict[ReferenceEvent, ReferenceState | None]

REFERENCE_AFTER: Final[dict[Reference, dict[ReferenceState, _Rows]]] = {
    # Known from the start, whatever happens, until the zero is moved. No homing is waited for, no bit asked.
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
            ReferenceEvent.HOMING: IGNORED,  # the encoder knows better
            ReferenceEvent.OTHER_MOTION: IGNORED,
            ReferenceEvent.SET_AT_REST: ReferenceState.NOT_REFERENCED,
            ReferenceEvent.SET_MOVING: ReferenceState.NOT_REFERENCED,
            ReferenceEvent.LOSS: IGNORED,  # it keeps its position without power
            ReferenceEvent.DECLARED: IGNORED,
        },
    },
    # Nothing hangs on homing: what counts is the position that is set after it, while the axis stands.
    Reference.SET_POSITION: {
        ReferenceState.NOT_REFERENCED: {
            ReferenceEvent.HOMING: IGNORED,
            ReferenceEvent.OTHER_MOTION: IGNORED,
            ReferenceEvent.SET_AT_REST: ReferenceState.REFERENCED,
            ReferenceEvent.SET_MOVING: IGNORED,  # nobody knows where it was when that was set
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
    # A homing command begins it, and the bit that is set at its end; that bit is looked at only meanwhile.
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
            ReferenceEvent.HOMING: IGNORED,  # once more
            ReferenceEvent.OTHER_MOTION: ReferenceState.NOT_REFERENCED,  # the homing was broken off
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
    # The drive itself says it. Once the bit was seen to be down a homing has begun: the next one set ends it.
    # A person cannot declare it.
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
            ReferenceEvent.OTHER_MOTION: ReferenceState.NOT_REFERENCED,  # the homing was broken off
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
            ReferenceEvent.LOSS: IGNORED,  # the bit says whether it was one
            ReferenceEvent.SILENCE: IGNORED,
        },
    },
}
"""What each event makes of each state, by the way in which it is known; what is not here cannot be.

``BIT_SET``, ``BIT_CLEAR`` and ``SILENCE`` come only with ``DRIVE_BIT``; ``BIT_SET`` also with ``HOMING``,
where a bit ends a homing. ``HOMING`` is a state only where that end is waited for.
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
"""Events after which a bit that decides has to be read before positions pass, whatever the state."""
BITS: Final = frozenset({ReferenceEvent.BIT_SET, ReferenceEvent.BIT_CLEAR})

REFERENCE_AT_START: Final = {
    Reference.ABSOLUTE: _REFERENCED,
    Reference.DRIVE_BIT: _NOT_REFERENCED,
    Reference.HOMING: _NOT_REFERENCED,
    Reference.SET_POSITION: _NOT_REFERENCED,
}
FRESH_NS: Final = NS_PER_S
"""A homed bit that was seen longer ago is read again before a target."""
SETTLE_NS: Final = 100 * NS_PER_MS
"""A bit that is still set so soon after a homing command may be that of the homing before."""


class AxisReference:
    """Whether one axis knows where it is. Time is monotonic, in ns."""

    __slots__ = (
        "_on_fault",
        "bit",
        "bit_seen_ns",
        "follows_homed_bit",
        "homing_since_ns",
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
        self.bit = (
            DONE_BIT if plan.referenced is Reference.HOMING and HOMED_BIT not in plan.bits else HOMED_BIT
        )
        """Name of the bit that tells when homing has ended."""
        self.state = REFERENCE_AT_START[plan.referenced]
        self.is_unconfirmed = self.follows_homed_bit
        """The bit that decides has to be read before positions pass."""
        self.was_reported = not self.follows_homed_bit
        """Whether the homed bit was ever seen, where it decides."""
        self.bit_seen_ns = 0
        """When the bit that decides was seen last."""
        self.homing_since_ns = 0
        """When the last homing command went out, or when the bit was seen to be down since."""
        self.is_remapped = False
        """A remapping register of its unit was written (M10): nothing is corrected until a restart."""
        self.waits_for_peers = False
        """Another axis of its group is not referenced (M11)."""

    def happens(self, event: ReferenceEvent) -> None:
        """Go on to the state that the table says, with what belongs to it."""
        try:
            after = REFERENCE_AFTER[self.kind][self.state][event]
        except KeyError:
            sentence = sentence_of("reference", self.state, event)
            self._on_fault(sentence)  # ``_on_fault`` calls :meth:`invalidate`, where a bit decides
            return
        if after is not IGNORED:
            self.state = after
        if self.follows_homed_bit:
            if event in BITS:
                self.is_unconfirmed, self.was_reported = False, True
            elif event in ASKS_AGAIN:
                self.is_unconfirmed = True

    def invalidate(self) -> None:
        """Nobody knows where it is until that was read anew, or said."""
        self.state = _NOT_REFERENCED
        self.is_unconfirmed = self.follows_homed_bit

    def begin_homing(self, now_ns: int, *, is_certain: bool) -> None:
        """A homing command went out; ``is_certain``: the drive acknowledged it."""
        self.homing_since_ns = now_ns
        self.happens(ReferenceEvent.HOMING)
        if not is_certain:  # nobody knows whether it homes: a bit that is seen next ends nothing
            self.happens(ReferenceEvent.OTHER_MOTION)

    def see_homed_bit(self, now_ns: int, *, is_set: bool) -> None:
        """Take note of the drive's homed bit, where it decides."""
        if is_set and self.is_homing and now_ns - self.homing_since_ns < SETTLE_NS:
            return  # it may be that of the homing before
        self.bit_seen_ns = now_ns
        self.happens(ReferenceEvent.BIT_SET if is_set else ReferenceEvent.BIT_CLEAR)

    def see_end_of_homing(self, now_ns: int, *, is_set: bool) -> None:
        """Take note of the bit that ends a homing command, where it is not the bit that decides for good."""
        if self.kind is not Reference.HOMING or not self.is_homing:
            return
        if not is_set:
            self.homing_since_ns = now_ns - SETTLE_NS
        elif now_ns - self.homing_since_ns >= SETTLE_NS:
            self.happens(ReferenceEvent.BIT_SET)

    def wait_for_peers(self, *, waits: bool) -> None:
        """Another axis of its group does not know where it is, or all of them do (M11)."""
        self.waits_for_peers = waits

    def end(self) -> None:
        """The registers of its drive mean something else from now on."""
        self.is_remapped = True

    @property
    def is_found(self) -> bool:
        """Whether the axis itself knows where it is, as far as one can tell."""
        return self.state is _REFERENCED

    @property
    def is_referenced(self) -> bool:
        """Whether the axis, and every axis of its group, knows where it is, as far as one can tell."""
        return self.state is _REFERENCED and not self.waits_for_peers

    @property
    def is_homing(self) -> bool:
        """Whether the end of a homing command is waited for."""
        return self.state is _HOMING

    @property
    def is_lost(self) -> bool:
        """Whether it is certain that the axis does not know where it is."""
        return self.was_reported and self.state is not _REFERENCED

    @property
    def hangs_on_a_bit(self) -> bool:
        """Whether a status bit of the drive tells when the reference is found."""
        return self.kind in (Reference.DRIVE_BIT, Reference.HOMING)

    def needs_reading(self, now_ns: int, *, before_target: bool) -> bool:
        """Whether the bit has to be read before positions pass.

        ``before_target``: a target is to pass that is held up for an old bit.
        """
        if not self.follows_homed_bit:
            return before_target and self.is_homing and self.kind is Reference.HOMING
        is_old = self.state is not _REFERENCED or now_ns - self.bit_seen_ns > FRESH_NS
        return self.is_unconfirmed or (before_target and is_old)
