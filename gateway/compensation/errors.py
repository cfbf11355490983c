"""Errors of the compensation layer, by cause."""


class CompensationError(Exception):
    """Base of all intentional errors of this layer; any other error is a bug of this program."""


class TableError(CompensationError):
    """A correction table that must not be used: it is refused whole."""


class SettingsError(CompensationError):
    """Settings of an axis that contradict each other or its table."""


class OutOfTableError(CompensationError):
    """A position outside the table of an axis whose policy is ``refuse``."""


class OutsideTravelError(CompensationError):
    """A corrected position beyond the axis's travel and its margin."""


class TemperatureError(CompensationError):
    """A value that cannot be the temperature of a screw."""
