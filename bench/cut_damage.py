"""Damaged frames of every kind against cut-through alone, and what three kinds of drives make of them.

    python -m bench.cut_damage --count 1000000 --baudrate 38400

Each frame comes character by character at its instants, or in lumps; most are damaged, some stop, some are
ended by a stop or by a lost port while they leave. Time goes on from frame to frame, with no more silence
behind a spoilt one than the line keeps, so that each drive hears it together with what follows. A drive may
take nothing but what left with its own check sum.
"""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator
from random import Random
from typing import Final

from bench.cut_line import BITS, WRITE_HEAD, damaged, has_whole
from gateway.exchange.cut_through.delay import ADDRESS_BYTES, delay_ns, guard_ns, margin_ns, write_shape
from gateway.exchange.cut_through.forward import ABORTED_SILENCES
from gateway.exchange.cut_through.frame import (
    ForwardedFrame,
    ForwardEvent,
    ForwardingPace,
    ForwardState,
    Judge,
    Opening,
)
from gateway.modbus.crc import append_crc
from gateway.modbus.rtu_arrival import BLOCK_HEAD, RequestArrival
from gateway.modbus.rtu_line import pause_ns, silence_ns
from gateway.simulator.ears import MERGED_NS, Hearing, Uart
from gateway.simulator.wire import PacedWire
from gateway.times import NS_PER_S

SHAPE: Final = write_shape(2, 0, 2)
ENDS: Final = (ForwardEvent.OVERTAKEN, ForwardEvent.GONE, ForwardEvent.MET)
ENDED: Final = 0.05
"""Share of frames that somebody ends while they leave."""
PAUSED: Final = 0.3
"""Share of frames behind which all drives have a silence, also those that take less than 10 ms for none."""
HEARINGS: Final = (Hearing.STANDARD, Hearing.ANY_LENGTH, Hearing.MERGING)


class _Adds(Judge):
    """Knows one head, and adds three counts to what it writes."""

    def __init__(self, delay: int) -> None:
        self._delay_ns = delay
        self.last = WRITE_HEAD + bytes(4)

    def opening(self, begun: bytes, now_ns: int) -> Opening | None:
        known = begun[:ADDRESS_BYTES] == WRITE_HEAD[:ADDRESS_BYTES]
        return Opening(SHAPE, self._delay_ns, self.last) if known else None

    def fits(self, opening: Opening, begun: bytes) -> bool:
        return begun[:BLOCK_HEAD] == WRITE_HEAD

    def rendered(self, begun: bytes, first: int, end: int, now_ns: int) -> bytes | None:
        counts = (int.from_bytes(begun[first:end], "big") + 3) % 2**32
        return counts.to_bytes(4, "big") if counts % 251 else None

    def commits(self, frame: bytes, sent: bytes, now_ns: int) -> bool:
        self.last = sent
        return True


class Damage:
    """One wire into the gateway, one out of it, and three drives that hear the same."""

    def __init__(self, baudrate: int, seed: int) -> None:
        self.rng = Random(seed)
        self.char_ns = round(BITS * NS_PER_S / baudrate)
        self.silence_ns = silence_ns(baudrate)
        self.pace = ForwardingPace(
            self.char_ns, self.char_ns + pause_ns(self.silence_ns), guard_ns(self.char_ns)
        )
        delay = delay_ns(SHAPE, self.char_ns, self.char_ns) - self.char_ns + margin_ns(self.char_ns)
        self.judge = _Adds(delay)
        self.out = PacedWire(baudrate)
        self.ears = [Uart(hearing, baudrate) for hearing in HEARINGS]
        self.now_ns = NS_PER_S
        self.frames = self.damaged = self.foreign = self.forged = 0
        self.turns: Counter[str] = Counter()
        self.taken: Counter[str] = Counter()
        self._sent: list[bytes] = []

    def frame(self) -> None:
        """Let one frame come, and what is to be heard of it be heard."""
        rng, self.frames = self.rng, self.frames + 1
        frame = append_crc(WRITE_HEAD + rng.randbytes(4))
        is_damaged = rng.random() < 0.9
        pieces = damaged(rng, frame, 2 * self.silence_ns // 3) if is_damaged else [(0, frame)]
        is_damaged = is_damaged and not has_whole(b"".join(piece for _, piece in pieces))
        self.damaged += is_damaged
        why = rng.choice(ENDS) if rng.random() < ENDED else None
        ends_after = rng.randrange(1, len(frame))
        forwarded = ForwardedFrame(RequestArrival(), self.judge, self.pace)
        came = 0
        for at_ns, data in self._arrivals(pieces):
            self._tick(forwarded, at_ns)
            self.now_ns = at_ns
            self._write(forwarded.feed(data, at_ns))
            came += len(data)
            if why is not None and came >= ends_after:
                self._write(forwarded.go_on(why, at_ns))
            if forwarded.is_over:
                break
        self._tick(forwarded, self.now_ns + 1000 * self.char_ns)
        self.turns[forwarded.state.value] += 1
        if forwarded.state is ForwardState.WHOLE:
            self._sent.append(forwarded.left)
            self.forged += is_damaged
        silences = ABORTED_SILENCES if forwarded.state is ForwardState.ABORTED else 1
        left_ns = forwarded.empty_ns if forwarded.left else self.now_ns
        self.now_ns = max(self.now_ns, left_ns) + silences * self.silence_ns + rng.randrange(self.char_ns)
        if rng.random() < PAUSED:
            self.now_ns += 2 * MERGED_NS
        self._listen(self.now_ns)

    def _arrivals(self, pieces: list[tuple[int, bytes]]) -> Iterator[tuple[int, bytes]]:
        """Yield bytes as they come: mostly one by one, now and then two or three together."""
        at_ns = self.now_ns
        for pause, piece in pieces:
            at_ns += pause
            gathered = b""
            for number in range(len(piece)):
                at_ns += self.char_ns
                gathered += piece[number : number + 1]
                if self.rng.random() < 0.98 or number == len(piece) - 1:
                    yield at_ns, gathered
                    gathered = b""

    def _tick(self, forwarded: ForwardedFrame, until_ns: int) -> None:
        while (deadline_ns := forwarded.deadline_ns) is not None and deadline_ns <= until_ns:
            self.now_ns = max(self.now_ns, deadline_ns)
            self._write(forwarded.tick(self.now_ns))

    def _write(self, data: bytes) -> None:
        if data:
            self.out.send(data, self.now_ns)

    def _listen(self, until_ns: int) -> None:
        for arrival in self.out.arrivals(until_ns):
            for hearing, uart in zip(HEARINGS, self.ears, strict=True):
                self._take(hearing, uart.receive(arrival))
        for hearing, uart in zip(HEARINGS, self.ears, strict=True):
            self._take(hearing, uart.take(until_ns))
        del self._sent[:-4]

    def _take(self, hearing: Hearing, frame: bytes) -> None:
        if frame:
            self.taken[hearing.value] += 1
            self.foreign += frame not in self._sent


def main() -> None:
    """Say what was seen as JSON."""
    parser = argparse.ArgumentParser(prog="python -m bench.cut_damage")
    parser.add_argument("--baudrate", type=int, default=38400)
    parser.add_argument("--count", type=int, default=100_000, help="damaged frames")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    damage = Damage(given.baudrate, given.seed)
    while damage.damaged < given.count:
        damage.frame()
    said = {
        name: getattr(damage, name) for name in ("frames", "damaged", "foreign", "forged", "turns", "taken")
    }
    sys.stdout.write(json.dumps(said) + "\n")


if __name__ == "__main__":
    main()
