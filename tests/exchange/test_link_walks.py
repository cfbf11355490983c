"""Random walks over connections that come and go: which requests are sent, how often, and which are answered
(W5)."""

import random
from dataclasses import dataclass

import pytest

from gateway.exchange.renewal import Held
from tests.exchange.connection_bench import ConnectionBench, controller
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, Port, axis_plan, read, write
from tests.exchange.staged_bench import RUN_PDU, STAGED, STOP_PDU
from tests.soak import repeated

WALKS, STEPS = repeated(6000), 120
TIMEOUT_MS = 300.0
LOST_MS = 250.0
NAMED = read(ACTUAL)
WRITES = frozenset({6, 16})


@dataclass
class Asked:
    """A request, and the port that waits for its answer."""

    pdu: bytes
    port: Port


class Walk:
    """One bench, and the rules that must hold after each step."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        staged = self.random.random() < 0.5
        plan = axis_plan(motion=STAGED, lost_ms=LOST_MS) if staged else axis_plan(lost_ms=LOST_MS)
        self.is_staged = staged
        self.rtu = self.random.random() < 0.3
        self.bench = ConnectionBench(
            plan,
            rtu=self.rtu,
            settled=False,
            response_timeout_ms=60.0,
            drain_ms=20.0,
            retry_ms=self.random.choice([0.0, 80.0]),
            connect_delay_ms=self.random.choice([0.0, 0.0, 40.0]),
            connects_on_demand=self.random.random() < 0.2,
        )
        self.asked: list[Asked] = []
        self.sent: list[bytes] = []
        self.counts = 1_000
        self.on_wire = b""
        self.note()

    def note(self) -> None:
        """Take the sent requests from the link, and check them."""
        bench = self.bench
        held = bench.line._renewal.held
        new, bench.link.sent = bench.link.sent, []
        for _, pdu in new:
            assert bench.line.is_up
            if held is not Held.NOTHING and pdu[0] in WRITES:
                assert pdu == STOP_PDU, f"{pdu.hex()} left while {held.value}"
            if held is Held.ALL:
                assert pdu in (NAMED, STOP_PDU), pdu.hex()
            self.sent.append(pdu)
        if new:
            self.on_wire = new[-1][1]

    def step(self) -> None:
        bench, line, draw = self.bench, self.bench.line, self.random.random()
        if draw < 0.35:
            self.ask()
        elif draw < 0.6 and line._transactions.current is not None:
            transaction, sent = line._transactions.current, self.on_wire
            bench.now_ns += MS
            refuses = self.random.random() < 0.1
            reply = bytes((sent[0] | 0x80, 4)) if refuses else bench.memory.answer(sent)
            line.reply(transaction.wire_unit_id, reply, bench.now_ns)
        elif draw < 0.7 and line.is_up:
            bench.peer_closes()
        elif draw < 0.75 and line.is_up:
            bench.breaks()
        elif draw < 0.9 and not line.is_up:
            self.pass_time(self.random.choice([1, 5, 50, 120]))
            line.link_up(bench.now_ns)
        else:
            self.pass_time(self.random.choice([1, 10, 30, 60, 150, 400]))
        self.note()

    def ask(self) -> None:
        draw = self.random.random()
        if draw < 0.35:
            self.counts += 100  # further apart than any two corrections
            pdu = write(COMMAND, self.counts)
        elif draw < 0.6:
            pdu = read(ACTUAL) if draw < 0.5 else bytes.fromhex("03 0700 0001")
        elif self.is_staged:
            pdu = RUN_PDU if draw < 0.8 else STOP_PDU
        else:
            pdu = bytes.fromhex("06 0900 0001")
        port = controller("cnc", timeout_ms=TIMEOUT_MS)
        self.asked.append(Asked(pdu, port))
        self.bench.send(pdu, port)

    def pass_time(self, ms: float) -> None:
        """Let time pass, deadline by deadline, and check the requests sent at each."""
        bench, end_ns = self.bench, self.bench.now_ns + int(ms * MS)
        while (due_ns := bench.line.deadline_ns) is not None and due_ns <= end_ns:
            bench.now_ns = max(due_ns, bench.now_ns)
            bench.line.tick(bench.now_ns)
            self.note()
        bench.now_ns = end_ns

    def end(self) -> None:
        """Check that no request waits for ever and none was answered twice: W5 has no answer for a request
        that was given up."""
        for _ in range(20):
            if not self.bench.line.is_up:
                self.pass_time(5)
                self.bench.line.link_up(self.bench.now_ns)
                self.note()
            self.pass_time(400)
        for each in self.asked:
            codes = [pdu.hex() for _, _, pdu in each.port.replies]
            assert len(codes) <= 1, (each.pdu.hex(), codes)
        assert self.bench.line._waiting.total == 0


@pytest.mark.parametrize("seed", range(WALKS))
def test_w5_over_connections_that_come_and_go(seed: int) -> None:
    walk = Walk(seed)
    for _ in range(STEPS):
        walk.step()
    walk.end()
    # Each position is asked for once, with words of its own: the drive was told none of them twice, but for
    # a target that was written anew for its trigger, which only staged drives are.
    told = [pdu for pdu in walk.sent if pdu[0] == 16]
    if not walk.is_staged:
        assert len(told) == len(set(told))
    plain = [each for each in walk.asked if each.pdu == bytes.fromhex("06 0900 0001")]
    assert sum(pdu == bytes.fromhex("06 0900 0001") for pdu in walk.sent) <= len(plain)
