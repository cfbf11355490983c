"""What the gateway refuses by itself."""

from gateway.catalogue import exchange_events
from gateway.catalogue.entry import EventEntry, RefusalEntry


class RefusedRequestError(Exception):
    """A request that the gateway answers itself: with ``code``, and nothing was sent."""

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
        """It writes a part of a position whose other parts have to come again: the parts count together."""


def refused(
    entry: RefusalEntry,
    axis: str,
    kind: EventEntry = exchange_events.REFUSED_VALUE,
    *,
    is_too_early: bool = False,
    **fields: object,
) -> RefusedRequestError:
    """Return what to raise for a refusal of the catalogue; ``fields`` are what its sentence names."""
    return RefusedRequestError(entry.code, axis, entry.sentence(**fields), kind, is_too_early=is_too_early)
