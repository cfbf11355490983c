"""Backlash with memory: the play operator."""

from enum import Enum

from gateway.simulator.errors import SimulatorError


class Flank(Enum):
    """Which side of the thread carries the nut: ``FORWARD`` after motion towards greater positions."""

    FORWARD = "forward"
    BACKWARD = "backward"


class Play:
    """A nut with lost motion: it follows the screw only after the play has been taken up.

    The nut stands at the flank's own position while the forward flank carries it, and ``width_mm`` above it
    while the backward flank does; in between it stays where it is.

    >>> play = Play(0.030, at_mm=10.0, flank=Flank.FORWARD)
    >>> play.follow(10.5), play.follow(10.48), play.follow(10.0)
    (10.5, 10.5, 10.03)
    """

    def __init__(self, width_mm: float, at_mm: float = 0.0, flank: Flank = Flank.FORWARD) -> None:
        if width_mm < 0:
            raise SimulatorError(f"backlash of {width_mm} mm: it cannot be less than 0")
        self.width_mm = width_mm
        self.nut_mm = at_mm if flank is Flank.FORWARD else at_mm + width_mm

    def follow(self, driven_mm: float) -> float:
        """Move the flank to ``driven_mm`` without turning round on the way; return the nut's position."""
        self.nut_mm = min(max(self.nut_mm, driven_mm), driven_mm + self.width_mm)
        return self.nut_mm
