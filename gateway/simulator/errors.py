"""Errors of the simulator."""


class SimulatorError(Exception):
    """The configuration cannot be simulated, or an endpoint cannot be opened; the message says what to do."""


class DriveRefusedError(SimulatorError):
    """A drive (or the gateway) answered the simulated controller with an exception."""

    def __init__(self, function: int, exception_code: int) -> None:
        super().__init__(f"function {function} was refused with exception {exception_code}")
        self.function = function
        self.exception_code = exception_code


class MissedError(SimulatorError):
    """No reply came to the simulated controller in time, or its axis did not arrive in time."""
