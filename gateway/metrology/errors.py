"""Errors of the metrology layer."""


class MetrologyError(Exception):
    """Base of all deliberate errors of this layer."""


class ReadingsError(MetrologyError):
    """Readings that make no table; the message names the target and the direction."""
