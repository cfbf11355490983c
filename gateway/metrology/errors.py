"""Errors of the metrology layer."""


class MetrologyError(Exception):
    """Base of everything that this layer raises on purpose."""


class ReadingsError(MetrologyError):
    """Readings from which no table can be built; the message names the target and the direction."""
