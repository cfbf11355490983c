"""What each kind of lost link does, in one table: :data:`LINK_LOSS`.

A drive that was out of reach may have been power-cycled, or moved by hand. How much of the earlier knowledge
still counts depends on how it went out of reach, and for how long.
"""

from enum import Enum
from typing import Final, NamedTuple

from gateway.times import NS_PER_MS, NS_PER_S

BLINK_NS: Final = 100 * NS_PER_MS
"""A connection closed in order that is back within this time has blinked: no drive restarts so fast."""
HEARD_NS: Final = NS_PER_S
"""If its drive answered so shortly before a blink, the axis is unchanged. The homed bit has the same limit:
an older one is read again."""
CLOSES_SOON_NS: Final = 20 * NS_PER_MS
"""A server that closes its connection within this time after an answer closes it after each answer."""


class LinkLoss(Enum):
    """How a drive went out of reach."""

    __hash__ = object.__hash__

    BLINK = "blink"
    """Closed in order by the peer or by us, with nothing outstanding, and open again within 100 ms. Only for
    an axis whose drive answered within the last second; for others it is a close."""
    IDLE_CLOSE = "idle-close"
    """Closed by its peer with nothing outstanding, for longer."""
    OWN_CLOSE = "own-close"
    """Closed by us with nothing outstanding, for longer (``connect = "on-demand"``, ``max_connection_s``)."""
    RENEWAL = "renewal"
    """Closed by us because nothing answered on it any more, to make a new one."""
    LOSS = "loss"
    """Any other: closed while something was outstanding, reset, unplugged, malformed."""
    SILENCE = "silence"
    """The link stayed, but the drive was silent for more than ``lost_ms``: it may have been switched off."""
    RESTART = "restart"
    """The gateway itself was down."""


class Words(Enum):
    """What happens to the words of the last target."""

    KEPT = "kept"
    UNTIL_READ = "kept until a reading proves or disproves them"
    AS_RECORDED = "as in the record, until a reading proves or disproves them"


class BaseAfterLoss(Enum):
    """What happens to the base of relative moves, the modes and the registers."""

    KEPT = "kept"
    FORGOTTEN = "forgotten"


class ReferenceAfterLoss(Enum):
    """What happens to the reference."""

    KEPT = "kept"
    UNCONFIRMED = "a homed bit is read; else kept up to `lost_ms` of silence"
    LOST = "a homed bit is read; else lost"
    AS_RECORDED = "as in the record"


class Reached(Enum):
    """What happens to the reach of a unit id (W11)."""

    KEPT = "goes on, with when it is tried again"
    ASKED_AGAIN = "asked again"


class Silent(Enum):
    """What happens to the silence of a drive, which counts up to ``lost_ms``."""

    NONE = "none began"
    GOES_ON = "goes on until the drive's own frame"
    UNTIL_UP = "counts until the link is up"
    UNTIL_FRAME = "counts until the drive's own frame"
    ENDED = "not counted"


class Recorded(Enum):
    """What happens to the record of the axis."""

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
"""What each kind does. ``LinkState`` carries out the first five, ``Axis.end_silence`` the sixth,
``axis.record`` the last."""
