"""A serial wire as whoever listens on it hears it: each character at its instant.

What a wire demands of whoever sends on it (numbers as in docs/wire-rules.md), for one that lets frames leave
while they arrive:

- Inside a frame the wire is never silent (W12): a drive takes a pause for an end.
- Between two frames it is silent for 3.5 characters, behind a spoilt request for three times as long. A
  spoilt reply is followed by the next request of whoever waited for it: the controller ends it itself.
- A spoilt frame is as long as its head says, and no frame: not whole, not at any byte before its end, not
  from its last piece on, nor together with the next one. One that broke off with its wire is none either.
"""

from collections.abc import Callable
from typing import Final

from gateway.exchange.cut_through.forward import SerialTiming
from tests.ledger.events import Book, Journal
from tests.ledger.frames import crc

ABORTED_SILENCES: Final = 3
"""On the wire of the drives."""
INVERTED: Final = 0xB001
"""What a running check sum comes to behind one whose bytes were both inverted."""
SHORTEST: Final = 4


class Bus:
    """One direction of a wire.

    Args:
        wire: its characters and silences.
        name: of whoever listens.
        length_of: how long a frame is that begins so, for whoever listens.
        book: where to tell what it did wrong.
        journal: and beside whose story.
        silences: so many follow a spoilt frame.
    """

    def __init__(
        self,
        wire: SerialTiming,
        name: str,
        length_of: Callable[[bytes], int],
        book: Book,
        journal: Callable[[], Journal],
        *,
        silences: int = 1,
    ) -> None:
        self._wire, self._name, self._length_of, self._book = wire, name, length_of, book
        self._journal = journal
        self._silent_ns = silences * wire.silence_ns
        self.ends_ns = 0
        """When the last character ends, or ended."""
        self._heard = b""
        """Of a frame that left in pieces, so far."""
        self._pieces: list[int] = []
        """Where each of its pieces began."""
        self._aborted = b""
        """The frame before, if it was none."""
        self.in_pieces = self.not_whole = 0
        """Frames that left in pieces: those that were whole, and those that were none."""

    def may_begin(self, now_ns: int) -> bool:
        """Whether the silence is over that comes before each frame."""
        return now_ns >= self.ends_ns + self._wire.silence_ns

    def other_end(self, now_ns: int) -> None:
        """A character of the other end has come."""
        self.ends_ns = max(self.ends_ns, now_ns)

    def whole(self, frame: bytes, now_ns: int) -> int:
        """A whole frame leaves, as soon as the silence before it is over; return when it ends."""
        start_ns = max(now_ns, self.ends_ns + self._wire.silence_ns)
        self._begin(start_ns)
        self._listen(frame)
        self._end(start_ns, len(frame))
        return self.ends_ns

    def piece(self, data: bytes, now_ns: int) -> None:
        """A piece of a frame leaves, the first or another one."""
        if not self._heard or now_ns >= self.ends_ns + self._wire.silence_ns:
            self._begin(now_ns)
        elif now_ns > self.ends_ns:
            silent_us = (now_ns - self.ends_ns) / 1000
            self._violation("W12-silence-inside", f"{self._heard.hex(' ')} | {data.hex(' ')}: {silent_us} µs")
        self._pieces.append(len(self._heard))
        self._heard += data
        self._end(max(now_ns, self.ends_ns), len(data))

    def leave(self, rest: bytes, frame: bytes, now_ns: int) -> int:
        """The rest of a frame leaves, which is this one; return when it ends."""
        self.piece(rest, now_ns)
        if self._heard != frame:
            self._violation("W12-other-bytes", f"{self._heard.hex(' ')} left for {frame.hex(' ')}")
        self._listen(frame)
        self._heard, self._pieces = b"", []
        self.in_pieces += 1
        return self.ends_ns

    def break_off(self) -> None:
        if self._heard:
            self._book.seen[f"frames to {self._name} that broke off"] += 1
            self.not_whole += 1
            self._check_no_frame(self._heard)
        self._heard, self._pieces, self._aborted = b"", [], b""

    def finish(self) -> None:
        self._begin(self.ends_ns + self._silent_ns)

    def _end(self, start_ns: int, characters: int) -> None:
        self.ends_ns = start_ns + characters * self._wire.char_ns

    def _begin(self, start_ns: int) -> None:
        """The frame before is over, if it left in pieces and never was one."""
        aborted, self._heard = self._heard, b""
        if aborted:
            self._book.seen[f"spoilt frames to {self._name}"] += 1
            self.not_whole += 1
            self._check_aborted(aborted)
            self._aborted = aborted
            silent_ns = start_ns - self.ends_ns
            if silent_ns < self._silent_ns:
                self._violation("W12-no-silence-behind", f"{aborted.hex(' ')}: {silent_ns / 1000} µs")
        self._pieces = []

    def _listen(self, frame: bytes) -> None:
        """A whole frame comes: whoever has joined the one before to it has none."""
        aborted, self._aborted = self._aborted, b""
        if aborted and _residue(aborted + frame) == 0:
            self._violation("W12-joined", f"{aborted.hex(' ')} {frame.hex(' ')}")

    def _check_aborted(self, aborted: bytes) -> None:
        self._check_no_frame(aborted)
        if _residue(aborted) != INVERTED:
            self._violation("W12-not-inverted", aborted.hex(" "))
        if len(aborted) != self._length_of(aborted):
            self._violation("W12-cut-short", aborted.hex(" "))

    def _check_no_frame(self, heard: bytes) -> None:
        for end in range(SHORTEST, len(heard) + 1):
            if _residue(heard[:end]) == 0:
                self._violation("W3-frame-inside", heard[:end].hex(" "))
        last = self._pieces[-1] if self._pieces else 0
        if len(heard) - last >= SHORTEST and _residue(heard[last:]) == 0:
            self._violation("W3-frame-inside", heard[last:].hex(" "))

    def _violation(self, kind: str, detail: str) -> None:
        self._book.violation(kind, f"to {self._name}: {detail}", self._journal())


def _residue(data: bytes) -> int:
    return int.from_bytes(crc(data), "little")


def request_length(begun: bytes) -> int:
    """How long a request is that begins so: one of those that may be cut through."""
    return 9 + begun[6] if begun[1] == 0x10 else 8


def reply_length(begun: bytes) -> int:
    """How long a reply is that begins so."""
    return 8 if begun[1] == 0x10 else 5 + begun[2]
