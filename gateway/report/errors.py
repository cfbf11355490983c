"""Errors of the report layer."""


class ReportError(ValueError):
    """A report cannot be made or written; the message says what to do."""
