"""Errors of the report layer."""


class ReportError(Exception):
    """A report that cannot be made or written; the message says what to do."""
