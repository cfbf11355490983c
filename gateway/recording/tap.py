"""Taps that keep the traffic: in a recording, or in the trace buffer of a line."""

from collections.abc import Callable, Sequence

from gateway.compensation.table import CorrectionTable
from gateway.compiled import mypyc_attr
from gateway.exchange.commands import Command
from gateway.exchange.ports import ControllerPort
from gateway.exchange.tap import Tap
from gateway.recording import traffic
from gateway.recording.capture import frame_entry
from gateway.recording.trace_buffer import (
    ABANDONED,
    ANSWERED,
    PACED,
    REPLY,
    REQUEST,
    SENT,
    TEXT,
    TICK,
    Raw,
    TraceBuffer,
    ids_of,
)
from gateway.recording.writer import Recorder
from gateway.state.tables import compiled


@mypyc_attr(allow_interpreted_subclasses=True)
class RecordingTap(Tap):
    """Makes one entry of each event. Ports are numbered in the order of their first requests."""

    def __init__(self, line: str) -> None:
        self.line = line
        self._last_number = 0
        self._answered: list[tuple[int, bytes]] = []
        """Replies to controllers that were sent before the drive's reply was complete."""
        self._paced_until_ns = 0

    def frame(self, kind: int, t_ns: int, ids: int, pdu: bytes) -> None:
        """Keep a frequent entry in the format of ``recording.trace_buffer``; outputs have no ``t_ns`` (0)."""

    def entry(self, entry: traffic.Entry) -> None:
        """Keep a rare entry."""

    def came(self, port: ControllerPort) -> None:
        """Record the controller of a port, before its first request."""

    def forget(self, number: int) -> None:
        """Forget a port, which sends no more requests."""

    def begin(self, now_ns: int) -> None:
        """Keep the present state, if the tap needs it; called before each request."""

    def request(
        self,
        port: ControllerPort,
        transaction_id: int,
        unit_id: int,
        pdu: bytes,
        now_ns: int,
        *,
        why_given_up: str = "",
    ) -> None:
        """See ``Tap``."""
        if not port.number:
            self._last_number += 1
            port.number = self._last_number
            self.came(port)
        self.begin(now_ns)
        if not why_given_up:
            self.frame(REQUEST, now_ns, ids_of(port.number, transaction_id, unit_id), pdu)
            return
        name, peer, role = port.plan.name, port.peer, port.plan.certified
        ids = port.number, name, transaction_id, unit_id
        self.entry(traffic.Request(self.line, now_ns, *ids, pdu.hex(), peer, role, why_given_up))

    def gone(self, port: ControllerPort, now_ns: int, *, is_broken: bool) -> None:
        """See ``Tap``. A port without a request has no entry."""
        if port.number:
            self.entry(traffic.Gone(self.line, now_ns, port.number, is_broken))
            self.forget(port.number)
            port.number = 0

    def reply(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """See ``Tap``."""
        self.frame(REPLY, now_ns, unit_id, pdu)
        while self._answered:
            self.frame(ANSWERED, 0, *self._answered.pop(0))

    def stray(self, now_ns: int, unit_id: int) -> None:
        """See ``Tap``."""
        self.entry(traffic.Stray(self.line, now_ns, unit_id >= 0, unit_id))

    def unframed(self, now_ns: int) -> None:
        """See ``Tap``."""
        self.entry(traffic.Unframed(self.line, now_ns))

    def link_up(self, now_ns: int) -> None:
        """See ``Tap``."""
        self.entry(traffic.Up(self.line, now_ns))

    def link_down(self, now_ns: int, reason: str, *, is_orderly: bool) -> None:
        """See ``Tap``."""
        self.entry(traffic.Down(self.line, now_ns, reason, is_orderly))

    def sent(self, unit_id: int, pdu: bytes) -> None:
        """See ``Tap``."""
        self.frame(SENT, 0, unit_id, pdu)

    def abandoned(self) -> None:
        """See ``Tap``."""
        self.frame(ABANDONED, 0, 0, b"")

    def answered(self, port: ControllerPort, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        """See ``Tap``."""
        self.frame(ANSWERED, 0, ids_of(port.number, transaction_id, unit_id), pdu)

    def answered_early(self, port: ControllerPort, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        """See ``Tap``. It is kept after the reply of the drive, as if that had been complete."""
        self._answered.append((ids_of(port.number, transaction_id, unit_id), pdu))

    def paced(self, until_ns: int) -> None:
        """See ``Tap``. Kept once for each time."""
        if until_ns != self._paced_until_ns:
            self._paced_until_ns = until_ns
            self.frame(PACED, 0, 0, until_ns.to_bytes(8, "little"))

    def timer(self, now_ns: int) -> None:
        """See ``Tap``."""
        self.frame(TICK, now_ns, 0, b"")

    def rest_first(self, now_ns: int) -> None:
        """See ``Tap``."""
        self.entry(traffic.RestFirst(self.line, now_ns))

    def stop(self, now_ns: int) -> None:
        """See ``Tap``."""
        self.entry(traffic.Stop(self.line, now_ns))

    def command(self, command: Command, tables: Sequence[CorrectionTable], now_ns: int) -> None:
        """See ``Tap``. All points of tables are kept: a replay needs them."""
        self.entry(traffic.Commanded(self.line, now_ns, command, tuple(map(compiled, tables))))


class FileTap(RecordingTap):
    """Writes everything from the start into a recording, as entries."""

    def __init__(self, line: str, recorder: Recorder) -> None:
        super().__init__(line)
        self._recorder = recorder
        self._ports: dict[int, tuple[str, str, str]] = {}

    def frame(self, kind: int, t_ns: int, ids: int, pdu: bytes) -> None:
        """See ``RecordingTap``."""
        self._recorder.put(frame_entry(self.line, self._ports, Raw(kind, t_ns, ids, pdu)))

    def entry(self, entry: traffic.Entry) -> None:
        """See ``RecordingTap``."""
        self._recorder.put(entry)

    def came(self, port: ControllerPort) -> None:
        """See ``RecordingTap``."""
        self._ports[port.number] = port.plan.name, port.peer, port.plan.certified

    def forget(self, number: int) -> None:
        """See ``RecordingTap``."""
        self._ports.pop(number, None)


class TraceTap(RecordingTap):
    """Writes into the trace buffer of a line: the newest bytes replace the oldest.

    Each segment of the trace buffer names the controllers of its requests, and once the state (``beginning``;
    None: a request is on the wire, waits or is due). So a replay may begin in any segment.
    """

    def __init__(
        self, line: str, trace_buffer: TraceBuffer, beginning: Callable[[int], traffic.Beginning | None]
    ) -> None:
        super().__init__(line)
        self._trace_buffer = trace_buffer
        self._beginning = beginning
        self._begun_in = 0
        self._ports: dict[int, traffic.Port] = {}
        self._named_in: dict[int, int] = {}
        self._t_ns = 0

    def frame(self, kind: int, t_ns: int, ids: int, pdu: bytes) -> None:
        """See ``RecordingTap``. An output has the time of its input."""
        trace_buffer = self._trace_buffer
        if t_ns:
            self._t_ns = t_ns
        if kind == REQUEST and self._named_in.get(ids >> 24) != trace_buffer.number:
            self.entry(self._ports[ids >> 24])
            self._named_in[ids >> 24] = trace_buffer.number
        trace_buffer.put(kind, self._t_ns, ids, pdu)

    def entry(self, entry: traffic.Entry) -> None:
        """See ``RecordingTap``."""
        self._t_ns = getattr(entry, "t", self._t_ns)  # outputs and Port entries have no time of their own
        self._trace_buffer.put(TEXT, self._t_ns, 0, traffic.encode(entry))

    def came(self, port: ControllerPort) -> None:
        """See ``RecordingTap``."""
        plan = port.plan
        self._ports[port.number] = traffic.Port(self.line, port.number, plan.name, port.peer, plan.certified)

    def forget(self, number: int) -> None:
        """See ``RecordingTap``."""
        self._ports.pop(number, None)
        self._named_in.pop(number, None)

    def begin(self, now_ns: int) -> None:
        """See ``RecordingTap``."""
        if self._begun_in != self._trace_buffer.number:
            beginning = self._beginning(now_ns)
            if beginning is not None:
                self.entry(beginning)
                self._begun_in = self._trace_buffer.number
