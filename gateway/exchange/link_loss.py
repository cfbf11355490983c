"""What each kind of lost link does, in one table: :data:`LINK_LOSS`.

A drive that was out of sight may have been switched off and on, or moved by hand. How much of what is known
of it counts afterwards hangs on how it went out of sight, and on for how long.
"""

from enum import Enum
from typing import Final, NamedTuple

from gateway.times import NS_PER_MS, NS_PER_S

BLINK_NS: Final = 100 * NS_PER_MS
"""A connection that was closed in order and is back within this time has blinked: no drive starts so fast."""
HEARD_NS: Final = NS_PER_S
"""An axis whose drive answered so shortly before is as it was after a blink; as with the homed bit, which is
read again when it was seen longer ago."""
CLOSES_SOON_NS: Final = 20 * NS_PER_MS
"""A server that closes its connection within this time after an answer closes it after each answer."""


class LinkLoss(Enum):
    """How a drive went out of sight."""

    __hash__ = object.__hash__

    BLINK = "blink"
    """The connection was closed in order, by its peer or by us, with nothing outstanding, and is open again
    within 100 ms. Of an axis whose drive answered within the last second; to any other it is a close."""
    IDLE_CLOSE = "idle-close"
    """Closed by its peer with nothing outstanding, for longer."""
    OWN_CLOSE = "own-close"
    """Closed by us with nothing outstanding, for longer (``connect = "on-demand"``, ``max_connection_s``)."""
    RENEWAL = "renewal"
    """Broken off by us because nothing answered on it any more, to make another one."""
    LOSS = "loss"
    """Any other: closed while something was outstanding, reset, unplugged, malformed."""
    SILENCE = "silence"
    """The link stayed, but the drive was silent for more than ``lost_ms``: it may have been switched off."""
    RESTART = "restart"
    """The gateway itself was gone."""


class Words(Enum):
    """What becomes of the words of the last target."""

    KEPT = "kept"
    UNTIL_READ = "kept until a reading proves or disproves them"
    AS_RECORDED = "as in the record, until a reading proves or disproves them"


class BaseAfterLoss(Enum):
    """What becomes of the base of relative moves, the modes and the registers."""

    KEPT = "kept"
    FORGOTTEN = "forgotten"


class ReferenceAfterLoss(Enum):
    """What becomes of the reference."""

    KEPT = "kept"
    UNCONFIRMED = "a homed bit is read; else kept up to `lost_ms` of silence"
    LOST = "a homed bit is read; else lost"
    AS_RECORDED = "as in the record"


class Reached(Enum):
    """What becomes of how far a unit id is from answering (W11)."""

    KEPT = "goes on, with when it is tried again"
    ASKED_AGAIN = "asked again"


class Silent(Enum):
    """What becomes of the silence of a drive, which counts up to ``lost_ms``."""

    NONE = "none began"
    GOES_ON = "goes on until the drive's own frame"
    UNTIL_UP = "counts until the link is up"
    UNTIL_FRAME = "counts until the drive's own frame"
    ENDED = "not counted"


class Recorded(Enum):
    """What becomes of the record of the axis."""

    GOES_ON = "goes on"
    PAUSED = "paused until the link is up"
    READ = "read"


class LossRow(NamedTuple):
    """What a kind of lost link does."""

    words: Words
    base: BaseAfterLoss
    reference: ReferenceAfterLoss
    reach: Reached
    silence: Silent
    record: Recorded


_CLOSED: Final = LossRow(
    Words.UNTIL_READ,
    BaseAfterLoss.FORGOTTEN,
    ReferenceAfterLoss.UNCONFIRMED,
    Reached.ASKED_AGAIN,
    Silent.UNTIL_UP,
    Recorded.PAUSED,
)

LINK_LOSS: Final = {
    LinkLoss.BLINK: LossRow(
        Words.KEPT, BaseAfterLoss.KEPT, ReferenceAfterLoss.KEPT, Reached.KEPT, Silent.NONE, Recorded.GOES_ON
    ),
    LinkLoss.IDLE_CLOSE: _CLOSED,
    LinkLoss.OWN_CLOSE: _CLOSED,
    LinkLoss.RENEWAL: LossRow(
        Words.KEPT,
        BaseAfterLoss.KEPT,
        ReferenceAfterLoss.KEPT,
        Reached.KEPT,
        Silent.GOES_ON,
        Recorded.GOES_ON,
    ),
    LinkLoss.LOSS: _CLOSED,
    LinkLoss.SILENCE: LossRow(
        Words.UNTIL_READ,
        BaseAfterLoss.FORGOTTEN,
        ReferenceAfterLoss.LOST,
        Reached.KEPT,
        Silent.UNTIL_FRAME,
        Recorded.GOES_ON,
    ),
    LinkLoss.RESTART: LossRow(
        Words.AS_RECORDED,
        BaseAfterLoss.FORGOTTEN,
        ReferenceAfterLoss.AS_RECORDED,
        Reached.ASKED_AGAIN,
        Silent.ENDED,
        Recorded.READ,
    ),
}
"""What each kind does. ``LinkState`` acts on the first five; the sixth is ``Axis.end_silence``, the last
``axis.record``."""
