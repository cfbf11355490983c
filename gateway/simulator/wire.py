"""A serial wire on the running loop: paced lanes, and a whole wire between two ports."""

from collections.abc import Callable

from gateway.simulator.clock import Alarm, loop_now_ns
from gateway.simulator.pacing import PacedWire, WireFaults
from gateway.simulator.pty import FdChannel
from gateway.transport.endpoints import SerialEndpoint


class Lane:
    """One direction of a wire: what is sent comes out of ``deliver`` when its time has come.

    Without ``line`` that is at once; with it, after the time that its baud rate and character format take.
    """

    def __init__(
        self,
        deliver: Callable[[bytes], None],
        line: SerialEndpoint | None,
        faults: WireFaults | None = None,
    ) -> None:
        self.wire = PacedWire(line.baudrate, line.bits_per_character, faults) if line else None
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
    """Joins two ports, each given by the master descriptor of its pty; see :class:`Lane`."""

    def __init__(
        self, left_fd: int, right_fd: int, line: SerialEndpoint | None, faults: WireFaults | None = None
    ) -> None:
        left, right = FdChannel(left_fd), FdChannel(right_fd)
        self.to_right = Lane(right.send, line, faults)
        self.to_left = Lane(left.send, line, faults)
        self._parts = (left, right, self.to_right, self.to_left)
        left.listen(self.to_right.send)
        right.listen(self.to_left.send)

    def close(self) -> None:
        """Cut the wire; the descriptors stay open."""
        for part in self._parts:
            part.close()
