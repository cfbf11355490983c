"""A pair of channels inside the process, with faults on the way, for tests.

It keeps the order of a byte stream and has no wire: no baud rate, no pacing, no limited buffers.
"""

import asyncio
import random
from collections import deque
from dataclasses import dataclass

from gateway.clock import boot_ns
from gateway.transport.channel import Channel, Receiver


@dataclass(frozen=True, slots=True)
class Faults:
    """What happens to bytes on their way; probabilities 0 to 1, drawn from ``seed``."""

    seed: int = 0
    split: float = 0.0
    """A write arrives in two pieces, split at a random point; 1 sends every byte separately."""
    glue: float = 0.0
    """A piece waits for the next one and arrives together with it."""
    delay_writes: int = 0
    """Every piece arrives only after this many further writes."""
    drop: float = 0.0
    """A byte is lost."""
    garble: float = 0.0
    """A byte arrives changed."""


NO_FAULTS = Faults()


class MemoryChannel(Channel):
    """One end. ``far`` receives what is written here, in a later cycle of the loop."""

    def __init__(self, peer: str, far: Receiver, faults: Faults) -> None:
        self.peer = peer
        self._far = far
        self._faults = faults
        self._random = random.Random(faults.seed)
        self._loop = asyncio.get_running_loop()
        self._late: deque[bytes] = deque()
        self._glued = b""
        self._other: MemoryChannel | None = None
        self.is_open = True

    def join(self, other: "MemoryChannel") -> None:
        """Make ``other`` the end that closes with this one."""
        self._other = other

    def write(self, data: bytes) -> None:
        """See ``Channel``."""
        if not self.is_open:
            return
        self._late.append(data)
        if len(self._late) > self._faults.delay_writes:
            self._pass_on(self._late.popleft())

    def flush(self) -> None:
        """Deliver everything that is held back."""
        while self._late:
            self._pass_on(self._late.popleft())
        if self._glued:
            self._arrive(self._glued)
            self._glued = b""

    def has_gone(self, *, asks: bool) -> bool:
        """See ``Channel``."""
        return not self.is_open

    def close(self) -> None:
        """See ``Channel``. Both ends get the event."""
        if self.is_open:
            self.flush()
            self.is_open = False
            self._loop.call_soon(self._close_other)

    def _close_other(self) -> None:
        other = self._other
        assert other is not None
        other.is_open = False
        now_ns = boot_ns()
        self._far.closed("connection closed", now_ns)
        other._far.closed("connection closed", now_ns)  # noqa: SLF001 - the other half of this object

    def _pass_on(self, data: bytes) -> None:
        for piece in self._pieces(self._corrupted(data)):
            if self._random.random() < self._faults.glue:
                self._glued += piece
            else:
                self._arrive(self._glued + piece)
                self._glued = b""

    def _pieces(self, data: bytes) -> list[bytes]:
        faults = self._faults
        if faults.split >= 1.0:
            return [data[i : i + 1] for i in range(len(data))]
        if len(data) > 1 and self._random.random() < faults.split:
            at = self._random.randrange(1, len(data))
            return [data[:at], data[at:]]
        return [data] if data else []

    def _corrupted(self, data: bytes) -> bytes:
        faults = self._faults
        if not (faults.drop or faults.garble):
            return data
        corrupted = bytearray()
        for byte in data:
            if self._random.random() < faults.drop:
                continue
            is_garbled = self._random.random() < faults.garble
            corrupted.append(byte ^ self._random.randrange(1, 256) if is_garbled else byte)
        return bytes(corrupted)

    def _arrive(self, data: bytes) -> None:
        self._loop.call_soon(self._deliver, data)

    def _deliver(self, data: bytes) -> None:
        self._far.received(data, boot_ns())


def connect(
    near: Receiver, far: Receiver, near_to_far: Faults = NO_FAULTS, far_to_near: Faults = NO_FAULTS
) -> tuple[MemoryChannel, MemoryChannel]:
    """Join two receivers; return the channel that ``near`` writes to and the one that ``far`` writes to."""
    near_channel = MemoryChannel("memory:far", far, near_to_far)
    far_channel = MemoryChannel("memory:near", near, far_to_near)
    near_channel.join(far_channel)
    far_channel.join(near_channel)
    now_ns = boot_ns()
    near.opened(near_channel, now_ns)
    far.opened(far_channel, now_ns)
    return near_channel, far_channel
