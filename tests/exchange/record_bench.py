"""A line whose axes keep records in memory; it can be killed and started again at any moment."""

from collections.abc import Callable, Iterable

from gateway.compensation.table import CorrectionTable
from gateway.exchange.axis.record import Record, digest_of_axis
from gateway.exchange.axis.record_layout import RECORD_SIZE, RecordSlots, Remembered
from gateway.exchange.line import LineExchange
from gateway.exchange.plan import AxisPlan
from tests.exchange.line_bench import MS, Bench, Link, Memory

BOOT_ID = bytes(range(16))
FindTable = Callable[[bytes], CorrectionTable | None]


class Records:
    """What remains of a gateway that was killed: the bytes of its axes' records."""

    def __init__(self) -> None:
        self.buffers: dict[str, bytearray] = {}

    def attach(self, line: LineExchange, find_table: FindTable | None = None) -> None:
        """Restore every axis of a line from these records, as the relay does it."""
        for axis in line.axes:
            buffer = self.buffers.setdefault(axis.plan.name, bytearray(RECORD_SIZE))
            digest = digest_of_axis(axis.plan)
            slots = RecordSlots(memoryview(buffer), digest, BOOT_ID)
            saved = slots.read()
            if saved is not None and saved.scale_digest != digest:
                saved = None
            axis.recall.attach(Record(slots, saved, find_table))

    def read(self, name: str = "x") -> Remembered | None:
        """Return what the record of an axis says."""
        return RecordSlots(memoryview(self.buffers[name]), bytes(16), BOOT_ID).read()

    def copy(self) -> "Records":
        """Return the records as they are now."""
        copied = Records()
        copied.buffers = {name: bytearray(data) for name, data in self.buffers.items()}
        return copied


class RecordBench(Bench):
    """A bench with records. ``restarted`` returns the gateway after a SIGKILL at this moment."""

    def __init__(
        self,
        *plans: AxisPlan,
        records: Records | None = None,
        memory: Memory | None = None,
        find_table: FindTable | None = None,
        groups: Iterable[Iterable[str]] = (),
        start_ns: int = 1_000 * MS,
        link: Link | None = None,
    ) -> None:
        self.plans, self.groups = plans, groups
        self.records = records or Records()

        def attach(line: LineExchange) -> None:
            self.now_ns = start_ns
            self.records.attach(line, find_table)

        super().__init__(*plans, memory=memory, groups=groups, before_up=attach, link=link)

    def restarted(self, *plans: AxisPlan, find_table: FindTable | None = None) -> "RecordBench":
        """Return another gateway with a copy of the records, and a copy of the drive."""
        memory = Memory()
        memory.words = dict(self.memory.words)
        return RecordBench(
            *(plans or self.plans),
            records=self.records.copy(),
            memory=memory,
            find_table=find_table,
            groups=self.groups,
            start_ns=self.now_ns,
        )

    @property
    def writes(self) -> list[bytes]:
        """All writes that the drive received."""
        return [pdu for pdu in self.seen if pdu[0] not in (1, 2, 3, 4)]

    @property
    def told(self) -> list[str]:
        """Details of the events about records."""
        return [e.detail for e in self.events if e.kind.name in ("restored", "record-not-used")]
