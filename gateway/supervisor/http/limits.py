"""What whoever connects may cost; beyond it he is told so, or dropped."""

from dataclasses import dataclass
from typing import Final

HEAD_BYTES: Final = 16_384
"""Of a request: its line and its header fields."""
TARGET_BYTES: Final = 4096
"""Of that the path with its query."""
BODY_BYTES: Final = 4096
"""Nothing that is asked here needs a body at all."""
WRITE_HIGH_BYTES: Final = 65_536
"""So much of an answer waits in this process for whoever does not take it; then its maker waits."""
SEND_BUFFER_BYTES: Final = 131_072
"""And so much in the system: without a limit it grows to megabytes."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Numbers and times, of one listener."""

    connections: int = 256
    """At once. The one that has asked nothing for longest makes room, else one that takes nothing of its
    answer; where all are being answered the next is refused."""
    event_readers: int = 32
    """Of ``/events``: they stay, and are never idle."""
    whole_request_s: float = 10.0
    """From the start of a connection, or the first byte of a later request, to the last one of it."""
    keep_alive_s: int = 15
    """A connection on which nothing more is asked."""
    stalled_s: float = 30.0
    """Somebody who takes nothing of his answer."""
    heartbeat_s: float = 15.0
    """Between two words to a reader of ``/events`` when nothing happens, so that a dead one is noticed."""
    status_every_s: float = 0.2
    """Between two models to one reader of ``/events``."""
    sweep_s: float = 1.0
    """How often the times above are looked at."""


TCP: Final = Limits()
LOCAL: Final = Limits(connections=32, event_readers=8)
"""The Unix socket: nobody there can be kept out by those who come over the network."""
