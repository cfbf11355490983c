"""What the exchange reports besides counters."""

from dataclasses import dataclass

from gateway.catalogue.entry import EventEntry


@dataclass(frozen=True, slots=True)
class Event:
    """One event; ``detail`` is a sentence for the operator."""

    kind: EventEntry
    """One of ``catalogue.exchange_events``."""
    axis: str | None = None
    detail: str = ""
    more: tuple[tuple[str, object], ...] = ()
    """Further fields, by name."""
