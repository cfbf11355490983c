"""The controllers: real masters that ignore exceptions, lose patience and repeat themselves."""

import random
from collections import deque
from collections.abc import Callable

from gateway.exchange.line import LineExchange
from gateway.exchange.plan import ControllerPlan
from gateway.exchange.ports import ControllerPort
from gateway.modbus.rtu import RtuRequestDecoder, encode_rtu
from tests.ledger.clock import MS, Clock
from tests.ledger.exchanges import Controller
from tests.ledger.frames import open_rtu, rtu
from tests.ledger.habits import Step
from tests.ledger.ledger import Ledger

Script = Callable[[], list[Step]]


class Master(ControllerPort):
    """A controller's port at the gateway, and the program behind it."""

    def __init__(
        self, clock: Clock, line: LineExchange, ledger: Ledger, plan: ControllerPlan, script: Script,
        *, rng: random.Random, is_rest: bool = False,
    ) -> None:  # fmt: skip
        super().__init__(plan)
        self._clock, self._line, self._ledger, self._script, self._rng = clock, line, ledger, script, rng
        self._steps: deque[Step] = deque()
        self._is_rest = is_rest
        """It looks on every now and then, and mostly does nothing."""
        self.is_ending = False
        self.book = self._new_book()

    def _new_book(self) -> Controller:
        plan = self.plan
        book = Controller(
            plan.name, is_serial=plan.serial, timeout_ns=int(plan.timeout_ms * MS), role=plan.role
        )
        self._ledger.controllers.append(book)
        return book

    def _look_ahead(self) -> None:
        if not self._steps and not self.is_ending:
            self._steps.extend(self._script())

    def _is_request_next(self) -> bool:
        self._look_ahead()
        return bool(self._steps) and isinstance(self._steps[0], tuple)

    def _next_step(self) -> tuple[int, bytes] | None:
        """Return the next request, or None after a pause was made."""
        self._look_ahead()
        step = self._steps.popleft() if self._steps else None
        if step is None or isinstance(step, tuple):
            return step
        if isinstance(step, float):
            self._clock.after(step, self.go_on)
        else:
            step()
            self._clock.after(0.0, self.go_on)
        return None

    def _pause_ms(self) -> float:
        return self._rng.uniform(20, 120) if self._is_rest else self._rng.uniform(0.5, 8.0)

    def go_on(self) -> None:
        raise NotImplementedError

    def _after_trouble(self, step: tuple[int, bytes]) -> None:
        """Do what masters do after an exception or a time-out: go on, give up the rest, or say it again."""
        chance = self._rng.random()
        if chance < 0.25:
            self._steps.appendleft(step)
        elif chance < 0.45:
            self._steps.clear()


class SerialMaster(Master):
    """RTU: one request at a time, unless it is impatient."""

    def __init__(self, *args: object, **others: object) -> None:
        super().__init__(*args, **others)  # type: ignore[arg-type]
        self._decoder = RtuRequestDecoder()
        self._number = 0
        self._step: tuple[int, bytes] | None = None

    def go_on(self) -> None:
        step = self._next_step()
        if step is None:
            return
        self._number += 1
        self._step = step
        data = encode_rtu(*step)
        if self._rng.random() < 0.005:  # the gateway must not make anything of it (W3)
            data = data[:-1] + bytes((data[-1] ^ 0x10,))
            self._ledger.book.seen["garbled requests"] += 1
        patience_ms = self.plan.timeout_ms
        if self._rng.random() < 0.03:
            patience_ms = self._rng.uniform(0.2, 5.0)
        number = self._number
        takes_ms = self._send(data)
        self._clock.after(takes_ms + patience_ms, lambda: self._lost_patience(number))

    def _send(self, data: bytes) -> float:
        """Send a frame; return how long that takes, in milliseconds."""
        self._take(self._decoder.feed(data, self._clock.now_ns))
        self._await_silence()
        return 0.0

    def _await_silence(self) -> None:
        if self._decoder.deadline_ns is not None:
            self._clock.at(self._decoder.deadline_ns, self._silent)

    def _silent(self) -> None:
        self._take(self._decoder.on_silence(self._clock.now_ns))
        if self._decoder.deadline_ns is not None and self._decoder.deadline_ns > self._clock.now_ns:
            self._clock.at(self._decoder.deadline_ns, self._silent)

    def _take(self, frames: list[tuple[int, bytes]]) -> None:
        for unit_id, pdu in frames:
            self._ledger.arrived(self.book, 0, unit_id, pdu, self._clock.now_ns)
            self._line.request(self, 0, unit_id, pdu, self._clock.now_ns)

    def _lost_patience(self, number: int) -> None:
        if number != self._number or self._step is None:
            return
        step, self._step = self._step, None
        self._after_trouble(step)
        self.go_on()

    def send_reply(self, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        opened = open_rtu(encode_rtu(unit_id, pdu))
        assert opened == (unit_id, pdu)
        assert rtu(unit_id, pdu) == encode_rtu(unit_id, pdu)
        self._heard(unit_id, pdu, 0.0)

    def _heard(self, unit_id: int, pdu: bytes, takes_ms: float) -> None:
        """A reply comes, and is whole after so long."""
        self._ledger.replied(self.book, 0, unit_id, pdu)
        step, self._step = self._step, None
        if step is None:
            return
        self._number += 1
        if pdu[0] >= 0x80:
            self._after_trouble(step)
        self._clock.after(takes_ms + self._pause_ms(), self.go_on)
