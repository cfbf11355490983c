"""A serial wire on the running loop: paced lanes, and a whole wire between two ports."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from gateway.simulator.clock import Alarm, loop_now_ns
from gateway.simulator.ears import Hearing
from gateway.simulator.pacing import AT_ONCE, Adapter, PacedWire, WireFaults
from gateway.simulator.pty import FdChannel
from gateway.transport.endpoints import SerialEndpoint


@dataclass(frozen=True, slots=True)
class Cable:
    """What a serial line is like, besides its baud rate."""

    adapter: Adapter = AT_ONCE
    """Of the port that the gateway opens."""
    faults: WireFaults | None = None
    """On the wire, in both directions."""
    hearing: Hearing | None = None
    """What its drives take for frames; None: whole good frames, wherever they stand, at once."""


PLAIN: Final = Cable()


class Lane:
    """One direction of a wire: what is sent comes out of ``deliver`` when its time has come.

    Without ``line`` that is at once; with it, after the time that its baud rate and character format take.
    """

    def __init__(
        self,
        deliver: Callable[[bytes], None],
        line: SerialEndpoint | None,
        faults: WireFaults | None = None,
        adapter: Adapter = AT_ONCE,
    ) -> None:
        self.wire = PacedWire(line.baudrate, line.bits_per_character, faults, adapter) if line else None
        self._deliver = deliver
        self._alarm = Alarm(self._arrive)

    def send(self, data: bytes) -> None:
        """Put bytes on the wire."""
        if self.wire is None:
            self._deliver(data)
            return
        self.wire.send(data, loop_now_ns())
        self._alarm.set(self.wire.deadline_ns)

    def close(self) -> None:
        """What still travels is lost."""
        self._alarm.set(None)

    def _arrive(self) -> None:
        assert self.wire is not None
        data = self.wire.receive(loop_now_ns())
        self._alarm.set(self.wire.deadline_ns)
        if data:
            self._deliver(data)


class SerialWire:
    """Joins two ports, each given by the master descriptor of its pty; see :class:`Lane`.

    The adapter of ``cable`` is that of the left port.
    """

    def __init__(
        self, left_fd: int, right_fd: int, line: SerialEndpoint | None, cable: Cable = PLAIN
    ) -> None:
        left, right = FdChannel(left_fd), FdChannel(right_fd)
        self.to_right = Lane(right.send, line, cable.faults)
        self.to_left = Lane(left.send, line, cable.faults, cable.adapter)
        self._parts = (left, right, self.to_right, self.to_left)
        left.listen(self.to_right.send)
        right.listen(self.to_left.send)

    def close(self) -> None:
        """Cut the wire; the descriptors stay open."""
        for part in self._parts:
            part.close()
