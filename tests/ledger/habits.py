"""What the controllers do with an axis: short scripts of requests and pauses."""

import random
from collections.abc import Callable
from typing import Final

from tests.ledger.clock import MS, Clock
from tests.ledger.drives import Drive, settle_ms
from tests.ledger.frames import exchange_pdu, read_pdu, single_pdu, write_pdu
from tests.ledger.layouts import (
    CONTROL_ENABLE,
    CONTROL_START,
    IMAGE_RELATIVE,
    JOG,
    MODE_ABSOLUTE,
    MODE_RELATIVE,
    RUN,
    RUN_RELATIVE,
    STOP,
    Style,
)
from tests.ledger.screws import TRAVEL_MM

Step = tuple[int, bytes] | float | Callable[[], None]
"""Unit id and PDU, a pause in milliseconds, or something that somebody does at the machine."""
FOREIGN: Final = (17, 99, 254)
"""Unit ids that no drive was given."""
UNSEEN_MS: Final = 510.0


class Habits:
    """One controller's program for one axis."""

    def __init__(
        self, clock: Clock, drive: Drive, rng: random.Random, *, jog: Callable[[], None], strays: bool = False
    ) -> None:
        """``jog``: somebody jogs the axis on its panel. ``strays``: other unit ids are used too."""
        self._clock, self._drive, self._rng = clock, drive, rng
        self._jog, self._strays = jog, strays
        self._layout = drive.layout
        self._target = drive.target
        self._has_begun = False

    def look(self) -> list[Step]:
        """Read something: positions whole, cut, among others; or ask what nobody understands."""
        layout, rng = self._layout, self._rng
        if rng.random() < 0.06:
            return [self._step(b"\x41" + rng.randbytes(rng.randint(1, 6)))]
        places = [layout.actual, layout.actual, layout.command, layout.status, layout.trigger]
        if self._clock.now_ns < self._drive.hushed_ns:
            return [self._step(read_pdu(layout.command, 2))]
        if layout.commanded is not None:
            places.append(layout.commanded)
        place = rng.choice(places)
        if rng.random() < 0.5:
            return [self._step(read_pdu(place, 2, rng.choice([3, 3, 4])))]
        start = max(0, place + rng.randint(-3, 1))
        return [self._step(read_pdu(start, rng.randint(1, 6)))]

    def stop(self) -> list[Step]:
        layout = self._layout
        if layout.style is Style.PLAIN:
            return self.look()
        return [self._step(single_pdu(layout.trigger, 0 if layout.style is Style.IMAGE else STOP))]

    def act(self) -> list[Step]:
        """Do something: mostly move."""
        rng, style = self._rng, self._layout.style
        if not self._has_begun:
            return self._move()
        if self._strays and rng.random() < 0.15:
            return self._stray()
        if rng.random() < 0.02:
            return self._jog_on_the_panel()
        if style is Style.IMAGE:
            return self._cycle_image()
        if style is Style.PLAIN:
            return self._act_plainly()
        chance = rng.random()
        if chance < 0.25:
            return self.look()
        if chance < 0.30:
            return self.stop() + (self._wait() if rng.random() < 0.5 else [])
        if chance < 0.32:
            return [self._step(single_pdu(self._layout.trigger, JOG)), *self._wait()]
        if chance < 0.36:
            return self._odd_write()
        if chance < 0.42 and self._layout.is_staged:
            return [self._step(single_pdu(self._layout.trigger, RUN))]  # without a new target
        return self._move()

    def _act_plainly(self) -> list[Step]:
        chance = self._rng.random()
        if chance < 0.2:
            return self.look()
        if chance < 0.25:
            return self._odd_write()
        return self._move() if chance < 0.5 else self._go_on_one_way()

    def _go_on_one_way(self) -> list[Step]:
        """Go a few steps in one direction, and look after each of them where the axis is."""
        rng, layout = self._rng, self._layout
        low, high = sorted((layout.counts(0.5), layout.counts(TRAVEL_MM - 0.5)))
        step = rng.choice([1, 20, 150, 1_000]) * (1 if self._target < (low + high) / 2 else -1)
        steps: list[Step] = []
        for _ in range(rng.randint(4, 30)):
            self._target = min(high, max(low, self._target + step))
            steps.append(self._step(write_pdu(layout.command, layout.split(self._target))))
            steps.append(rng.uniform(1, 80))
            if rng.random() < 0.9:
                steps += [self._step(read_pdu(layout.actual, 2)), self._step(read_pdu(layout.status, 1))]
        return steps

    # --- moves ----------------------------------------------------------------------------------------

    def _move(self) -> list[Step]:
        layout, rng = self._layout, self._rng
        is_relative = layout.basis is not None and rng.random() < 0.35 and self._target != 0
        number = self._distance() if is_relative else self._position()
        if layout.style is Style.IMAGE:
            self._has_begun = True
            return self._image_move(number, is_relative)
        steps: list[Step] = []
        if layout.style is Style.BLOCK:
            self._has_begun = True
            words = [int(is_relative), *layout.split(number)]
            if rng.random() < 0.05:
                steps.append(self._step(write_pdu(layout.command, layout.split(number))))
            else:
                steps.append(self._step(write_pdu(layout.mode, words)))
        else:
            steps += self._targets(number)
            if rng.random() < 0.1:  # another one at once
                steps += self._targets(self._distance() if is_relative else self._position())
        mode = MODE_RELATIVE if is_relative else MODE_ABSOLUTE
        if layout.style is Style.STICKY and rng.random() < 0.9:
            steps.insert(rng.randint(0, len(steps)), self._step(single_pdu(layout.mode, mode)))
        if layout.is_staged and rng.random() < 0.9:
            value = RUN_RELATIVE if is_relative and layout.style is Style.TRIGGERED else RUN
            steps += [*self._maybe(self.look), self._step(single_pdu(layout.trigger, value))]
        return steps + self._maybe(self.look) + (self._wait() if rng.random() < 0.5 else [rng.uniform(1, 60)])

    def _targets(self, number: int) -> list[Step]:
        """Write a target: whole, in halves, one half alone, by mask, with its neighbours."""
        layout, rng = self._layout, self._rng
        words, address, chance = layout.split(number), layout.command, rng.random()
        is_first, self._has_begun = not self._has_begun, True
        if chance < 0.6 or is_first or layout.style is Style.BLOCK:
            return [self._step(write_pdu(address, words))]
        if chance < 0.66:
            block = [rng.randrange(0x10000), *words, rng.randrange(0x10000)]
            return [self._step(write_pdu(address - 1, block))]
        if chance < 0.72:
            return [self._step(exchange_pdu(layout.actual, 2, address, words))]
        halves: list[Step] = [self._step(single_pdu(address + i, words[i])) for i in (0, 1)]
        if chance < 0.76:
            low = 0 if layout.low_first else 1
            mask = b"\x16" + (address + low).to_bytes(2, "big") + b"\xff\x00"
            return [self._step(mask + bytes((0, words[low] & 0xFF)))]
        if rng.random() < 0.5:
            halves.reverse()
        if chance < 0.82:
            return halves[:1]
        if chance < 0.86:  # a block that ends inside the position, and the rest of it
            first = write_pdu(address - 1, [rng.randrange(0x10000), words[0]])
            return [self._step(first), self._step(single_pdu(address + 1, words[1]))]
        return [halves[0], rng.choice([0.5, 2.0, 20.0]), halves[1]]

    def _position(self) -> int:
        """Return a target: anywhere, near by, the same again, at a border of its words, out of travel."""
        layout, rng = self._layout, self._rng
        chance = rng.random()
        if chance < 0.15:
            return self._target
        if chance < 0.35:
            self._target += rng.choice([1, -1, 2, -3, 5, -8, 20, -30, 100, -200])
        elif chance < 0.45:
            self._target = self._drive.motor.at(self._clock.now_ns) + rng.randint(-60, 60)
        elif chance < 0.5:
            self._target = 65_536 * rng.randint(0, 1) + rng.randint(-50, 50)
        elif chance < 0.53:
            return layout.counts(rng.choice([-20.0, TRAVEL_MM + 30]))
        else:
            self._target = layout.counts(rng.uniform(0.5, TRAVEL_MM - 0.5))
        low, high = sorted((layout.counts(0.5), layout.counts(TRAVEL_MM - 0.5)))
        self._target = min(high, max(low, self._target))
        return self._target

    def _distance(self) -> int:
        now = self._drive.motor.at(self._clock.now_ns)
        middle = self._layout.counts(TRAVEL_MM / 2)
        most = self._rng.choice([1, 5, 50, 500, 5_000])
        way = self._rng.randint(0, most)
        return way if now < middle else -way

    def _image_move(self, number: int, is_relative: bool) -> list[Step]:
        rng, mode = self._rng, IMAGE_RELATIVE if is_relative else 0
        idle, start = CONTROL_ENABLE, CONTROL_ENABLE | CONTROL_START
        steps = [self._image(idle, mode, number) for _ in range(rng.randint(0, 2))]
        steps += [self._image(start, mode, number) for _ in range(rng.randint(1, 4))]
        steps += [self._image(idle, mode, number) for _ in range(rng.randint(1, 3))]
        return [*steps, *(self._wait() if rng.random() < 0.5 else [rng.uniform(1, 50)])]

    def _cycle_image(self) -> list[Step]:
        chance = self._rng.random()
        if chance < 0.1:
            return self.look()
        if chance < 0.15:
            return self.stop()
        if chance < 0.18:
            return [self._image(0, 0, 0)]
        if chance < 0.3:
            return [self._image(CONTROL_ENABLE, 0, self._target)]
        return self._move()

    def _image(self, control: int, mode: int, number: int) -> Step:
        words = [control, mode, *self._layout.split(number)]
        if self._rng.random() < 0.7:
            return self._step(exchange_pdu(0, 4, 0, words))
        return self._step(write_pdu(0, words))

    # --- other things -----------------------------------------------------------------------------------

    def _odd_write(self) -> list[Step]:
        rng, layout = self._rng, self._layout
        return [
            rng.choice(
                [
                    self._step(single_pdu(0x0800 + rng.randrange(4), rng.randrange(0x10000))),
                    self._step(write_pdu(0x0900, [rng.randrange(0x10000) for _ in range(3)])),
                    self._step(write_pdu(layout.actual, [1, 2])),
                    self._step(b"\x65" + rng.randbytes(3)),
                ]
            )
        ]

    def _stray(self) -> list[Step]:
        """Ask, or write, under a unit id that the drive was not given."""
        rng, layout, unit = self._rng, self._layout, self._rng.choice(FOREIGN)
        words = layout.split(self._position())
        return [
            (
                unit,
                rng.choice(
                    [
                        write_pdu(layout.command, words),
                        write_pdu(layout.command - 1, [rng.randrange(0x10000), *words]),
                        single_pdu(layout.command, words[0]),
                        exchange_pdu(layout.actual, 2, layout.command, words),
                        single_pdu(layout.trigger, RUN),
                        single_pdu(layout.trigger, JOG),
                        read_pdu(layout.actual, 2),
                        read_pdu(layout.command, 2),
                        read_pdu(layout.status, 1),
                        single_pdu(0x0800 + rng.randrange(4), rng.randrange(0x10000)),
                    ]
                ),
            )
        ]

    def _jog_on_the_panel(self) -> list[Step]:
        """Let the axis come to rest, have it jogged beside the line, and stay away for a while."""
        rest_ms = settle_ms(self._drive, self._clock.now_ns) + self._rng.uniform(50, 700)

        def jog() -> None:
            quiet_ms = UNSEEN_MS + self._rng.uniform(0, 300)
            self._drive.hushed_ns = self._clock.now_ns + int((quiet_ms + 200) * MS)
            self._jog()

        look = self._step(read_pdu(self._layout.actual, 2))
        return [rest_ms, look, 5.0, jog, UNSEEN_MS + self._rng.uniform(0, 400), *self._move()]

    def _maybe(self, what: Callable[[], list[Step]]) -> list[Step]:
        return what() if self._rng.random() < 0.3 else []

    def _wait(self) -> list[Step]:
        """Wait for the end of the move, and mostly look at where it led."""
        layout, rng = self._layout, self._rng
        pause = settle_ms(self._drive, self._clock.now_ns) + rng.uniform(50, 700)
        steps: list[Step] = [min(pause, 900.0)]
        if layout.has_bits and rng.random() < 0.5:
            steps.append(self._step(read_pdu(layout.status, 1)))
        if rng.random() < 0.8:
            steps.append(self._step(read_pdu(layout.actual, 2)))
        if rng.random() < 0.3:
            steps.append(self._step(read_pdu(layout.command, 2)))
        return steps

    def _step(self, pdu: bytes) -> tuple[int, bytes]:
        return self._layout.unit, pdu
