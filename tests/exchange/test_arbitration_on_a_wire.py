"""A monitor on a line whose wire needs a silence, while the machine is busy."""

import pytest

from tests.exchange.line_bench import MS
from tests.exchange.test_arbitration import MOTION, WATCH, Plant

GAP_NS = 1_750_000
ANSWER_NS = 2 * MS
CYCLE_NS = 10 * MS
START_NS = 1_100 * MS


class PacedPlant(Plant):
    """Motion each 10 ms, a monitor that asks again when it was answered, each answered in 2 ms.

    The wire is free 1.75 ms after each reply. The alarm comes ``late_ns`` after its time.
    """

    def run(self, late_ns: int, cycles: int) -> tuple[int, int]:
        """Return how many reads of the monitor were answered, and the longest delay of motion in ns."""
        next_motion_ns, ends_ns = START_NS, START_NS + cycles * CYCLE_NS
        answer_ns: int | None = None
        served, longest_ns, asked = 0, 0, 0
        self.send(WATCH, self.hmi)
        self.answer()
        self.hmi.replies.clear()
        is_asking, number = False, 0
        while self.now_ns < ends_ns:
            if not is_asking:
                number += 1
                self.send(WATCH, self.hmi, transaction_id=number)
                is_asking = True
            if answer_ns is None and self.link.sent:
                answer_ns = self.now_ns + ANSWER_NS
                if self.link.sent[-1][1] == MOTION:
                    longest_ns = max(longest_ns, self.now_ns - asked)
            due_ns = self.line.deadline_ns
            tick_ns = None if due_ns is None else max(due_ns + late_ns, self.now_ns)
            events = [next_motion_ns, *[ns for ns in (answer_ns, tick_ns) if ns is not None]]
            self.now_ns = min(events)
            if answer_ns == self.now_ns:
                answer_ns = None
                self.link.stamps.next_ns = self.now_ns + GAP_NS
                self.answer()
            elif next_motion_ns == self.now_ns:
                asked = next_motion_ns
                next_motion_ns += CYCLE_NS
                self.send(MOTION)
            else:
                self.line.tick(self.now_ns)
            if self.hmi.replies:
                served += 1
                self.hmi.replies.clear()
                is_asking = False
            is_asking = is_asking and "withdrawn" not in self.kinds()
            self.events.clear()
        return served, longest_ns


@pytest.mark.parametrize("late_us", [0, 500, 1100])
def test_a_monitor_is_served_between_motion_each_10_ms(late_us: int) -> None:
    """A read of a monitor takes 2 ms, and a silence of 1.75 ms before it: in each cycle one fits."""
    served, longest_ns = PacedPlant().run(late_us * 1000, 300)
    assert longest_ns <= 4 * MS
    assert served >= 290
