"""Whatever happens while a request is forwarded, the drives get whole frames, or a spoilt one and a silence.

Random events between the characters of setpoints and replies. A witness beside the line knows nothing of
cut-through: it splits the bytes to the drives into frames by time alone.
"""

from collections import Counter
from random import Random

import pytest

from gateway.exchange.cut_through.delay import acknowledgement_shape
from gateway.exchange.cut_through.frame import ForwardEvent
from gateway.exchange.transaction import Phase
from gateway.modbus.crc import INVERTED, is_intact, residue_after
from tests.exchange.cut_line_bench import CHAR_NS, PLAN, Site, frame_of
from tests.exchange.line_bench import COMMAND, MS, write
from tests.exchange.staged_bench import STOP_PDU, staged_plan
from tests.exchange.test_cut_line import OTHER, site

SILENCE_NS = 10 * MS + MS // 2
STEPS = 60
"""Happenings on one line; a few of its requests."""
SITES = 40
STOP = frame_of(STOP_PDU, 2)


class Witness:
    """Splits the bytes to the drives into frames: pieces without a silence between them are one frame."""

    def __init__(self, line: Site) -> None:
        self.line = line
        self.intact: list[bytes] = []
        self.aborted = 0

    def look(self) -> None:
        """Split the bytes sent since the last call; a frame that has not ended stays."""
        left, frame, ends_ns, free_ns = self.line.link.left, b"", 0, 0
        for number, (when, data) in enumerate(left):
            assert when >= free_ns, "a silence was not kept"
            assert not frame or when <= ends_ns, "the transmitter was empty inside of a frame"
            frame += data
            ends_ns = max(when, ends_ns) + len(data) * CHAR_NS
            if is_intact(frame) and self._is_whole(frame):
                self.intact.append(frame)
            elif residue_after(frame) == INVERTED and len(frame) in (8, 13):
                self.aborted += 1
                free_ns = ends_ns + SILENCE_NS
            elif number < len(left) - 1:
                continue
            else:
                current = self.line.line._transactions.current
                is_leaving = current is not None and current.phase is Phase.LEAVING
                assert is_leaving or not self.line.line.is_up, f"cut short: {frame.hex(' ')}"
                return
            frame = b""

    @staticmethod
    def _is_whole(frame: bytes) -> bool:
        return len(frame) == (9 + frame[6] if frame[1] == 16 else 8)


def step(line: Site, rng: Random, coming: bytes) -> bytes:
    """Let something happen; return the rest of the controller's request that has not come yet."""
    what = rng.choices(
        ("character", "pause", "stop", "read", "noise", "link", "gone", "damage"), (100, 2, 2, 2, 2, 2, 1, 2)
    )[0]
    if what == "character" and coming:
        line.come(coming[:1])
        return coming[1:]
    if what == "damage" and coming:
        line.come(bytes((coming[0] ^ 1 << rng.randrange(8),)))
        return coming[1:]
    if what == "pause":
        line.pass_to(line.bench.now_ns + rng.choice((2, 4, 12, 40)) * CHAR_NS)
    elif what == "stop":
        line.hear(line.panel, STOP)
        line.pass_to(line.bench.now_ns + 4 * CHAR_NS)
    elif what == "read":
        line.hear(line.panel, frame_of(OTHER))
        line.pass_to(line.bench.now_ns + 4 * CHAR_NS)
    elif what == "noise":
        line.answer(b"\x55")
    elif what == "link":
        line.line.link_down(line.bench.now_ns)
        line.link.decoder.reset()
        line.link.left.clear()
        line.pass_to(line.bench.now_ns + 50 * CHAR_NS)
        line.line.link_up(line.bench.now_ns)
    elif what == "gone":
        line.line.controller_gone(line.cnc, line.bench.now_ns)
        line.cnc.decoder.reset()
        line.forwarders[line.cnc] = line.forwarding.follow(line.cnc, line.way.wire)
        way = line.forwarding.way_of(line.cnc)
        assert way is not None
        way.heads.delays.measured.update(line.way.heads.delays.measured)
        way.heads._expected.update(line.way.heads._expected)
        return b""
    current = line.line._transactions.current
    if current is not None and current.phase is not Phase.LEAVING and rng.random() < 0.5:
        line.reply(frame_of(line.bench.memory.answer(line.link.sent[-1][1]), current.wire_unit_id))
    return coming


@pytest.mark.parametrize("seed", range(4))
def test_the_drives_get_whole_frames_or_spoilt_ones(seed: int) -> None:
    ends: Counter[ForwardEvent] = Counter()
    for number in range(SITES):
        ends.update(walked(Random(SITES * seed + number)))
    assert ends[ForwardEvent.COMMITTED] > SITES / 4
    for event in (
        ForwardEvent.STALLED,
        ForwardEvent.OVERTAKEN,
        ForwardEvent.MET,
        ForwardEvent.GONE,
        ForwardEvent.LOST,
    ):
        assert ends[event] > 0, event
    assert ends[ForwardEvent.BAD] + ends[ForwardEvent.UNFIT] + ends[ForwardEvent.REFUSED] > 0


def walked(rng: Random) -> dict[ForwardEvent, int]:
    """Return how forwarded requests ended in a random walk."""
    line = site(PLAN, staged_plan(name="y", unit_id=2))
    line.measure(acknowledgement_shape(), of_replies=True)
    witness = Witness(line)
    counts, coming = 10_000, b""
    for _ in range(STEPS):
        current = line.line._transactions.current
        if current is not None and current.phase is not Phase.LEAVING and rng.random() < 0.7:
            line.reply(frame_of(line.bench.memory.answer(line.link.sent[-1][1]), current.wire_unit_id))
        if not coming and line.line._transactions.current is None:
            counts += 40
            line.pass_to(line.bench.now_ns + 6 * CHAR_NS)
            coming = frame_of(write(COMMAND, counts))
        coming = step(line, rng, coming)
        witness.look()
    return line.requests()
