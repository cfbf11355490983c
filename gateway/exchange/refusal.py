"""Refusals by the gateway itself."""

from gateway.catalogue import exchange_events
from gateway.catalogue.entry import EventEntry, RefusalEntry


class RefusedRequestError(Exception):
    """A request that the gateway answers itself, with ``code``; nothing was sent."""

    def __init__(
        self,
        code: int,
        axis: str,
        reason: str,
        kind: EventEntry = exchange_events.REFUSED_VALUE,
        *,
        is_too_early: bool = False,
    ) -> None:
        super().__init__(reason)
        self.code = code
        self.axis = axis
        self.reason = reason
        self.kind = kind
        self.is_too_early = is_too_early
        """It writes a part of a position whose other parts must come again: the parts count together."""


def refused(
    entry: RefusalEntry,
    axis: str,
    kind: EventEntry = exchange_events.REFUSED_VALUE,
    *,
    is_too_early: bool = False,
    **fields: object,
) -> RefusedRequestError:
    """Return a refusal of the catalogue to raise; ``fields`` are the values in its sentence."""
    return RefusedRequestError(entry.code, axis, entry.sentence(**fields), kind, is_too_early=is_too_early)
