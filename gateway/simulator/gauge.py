"""Instruments that measure a simulated axis: a laser on the nut, its serial port, and a display."""

import random
from collections.abc import Callable
from typing import Final

from gateway.exchange.plan import AxisPlan
from gateway.metrology.gauge_kinds import DEFAULTS, GaugeKind
from gateway.simulator.clock import SimulationClock
from gateway.simulator.mechanics import Mechanics, unit_mm
from gateway.simulator.pty import FdChannel
from gateway.simulator.screw import UM_PER_MM

NOISE_UM: Final = 0.1
"""Of one reading: a laser in a quiet room."""
DECIMALS: Final = 5
DISPLAY_EVERY_S: Final = 0.1
_REQUEST: Final = DEFAULTS[GaugeKind.SYLVAC].request.encode()
_LONGEST: Final = 64
"""Maximum of stored bytes that are not a request."""


class Laser:
    """Reads the true displacement of a nut from the laser's zero, with seeded noise.

    Lengths in millimetres; ``noise_um`` is the standard deviation of one reading.
    """

    def __init__(self, mechanics: Mechanics, *, noise_um: float = 0.0, seed: int = 0) -> None:
        self._mechanics = mechanics
        self._noise_mm = noise_um / UM_PER_MM
        self._rng = random.Random(seed)
        self._zero_mm = mechanics.nut_mm

    def zero(self, now_s: float) -> None:
        """Set the nut's position at ``now_s`` as 0."""
        self._mechanics.advance(now_s)
        self._zero_mm = self._mechanics.nut_mm

    def true_mm(self, now_s: float) -> float:
        """Displacement of the nut without noise, which no instrument can measure."""
        self._mechanics.advance(now_s)
        return self._mechanics.nut_mm - self._zero_mm

    def read_mm(self, now_s: float) -> float:
        """Take one reading."""
        return self.true_mm(now_s) + (self._rng.gauss(0.0, self._noise_mm) if self._noise_mm else 0.0)


class VirtualGauge:
    """Shows the true position of an axis's nut, in machine positions and units of the axis.

    Its port has the protocol of a Sylvac gauge, the usual kind of ``measure``. Needs a running loop.
    """

    def __init__(
        self, plan: AxisPlan, mechanics: Mechanics, port: int, clock: SimulationClock, *, seed: int = 0
    ) -> None:
        self.axis = plan.name
        self.units = plan.settings.units.value
        self._mechanics = mechanics
        self._clock = clock
        self._unit_mm = unit_mm(plan.settings.units)
        mechanics.advance(clock())
        self._zero_mm = mechanics.motor_mm
        """Where the instrument was set to the encoder's position."""
        self._laser = Laser(mechanics, noise_um=NOISE_UM, seed=seed)
        self._channel = FdChannel(port)
        self._heard = b""
        self._channel.listen(self._received)

    def reading(self) -> float:
        """Take one reading."""
        return (self._zero_mm + self._laser.read_mm(self._clock())) / self._unit_mm

    def close(self) -> None:
        """Leave the loop."""
        self._channel.close()

    @property
    def rest_position(self) -> float | None:
        """Identity of the present rest position; None while the axis moves."""
        self._mechanics.advance(self._clock())
        return None if self._mechanics.is_moving else self._mechanics.nut_mm

    def _received(self, data: bytes) -> None:
        *requests, self._heard = (self._heard + data).split(_REQUEST)
        self._heard = self._heard[-_LONGEST:]
        for _ in requests:
            self._channel.send(f"{self.reading():+.{DECIMALS}f}\r".encode())


class Display:
    """Shows a gauge's reading each time its axis has come to rest at another position."""

    def __init__(self, gauge: VirtualGauge, show: Callable[[VirtualGauge, float], None]) -> None:
        self._gauge = gauge
        self._show = show
        self._shown = gauge.rest_position

    def update(self) -> None:
        """Check once."""
        rest_position = self._gauge.rest_position
        if rest_position is not None and rest_position != self._shown:
            self._shown = rest_position
            self._show(self._gauge, self._gauge.reading())
