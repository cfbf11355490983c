"""Every event, by name and by group. To add one, add a constant to the file of its group."""

from collections.abc import Mapping
from types import ModuleType
from typing import Final

from gateway.catalogue import (
    exchange_events,
    line_events,
    process_events,
    publishing_events,
    sensor_events,
    table_events,
    tls_events,
)
from gateway.catalogue.entry import EventEntry, entries_of

GROUPS: Final[tuple[ModuleType, ...]] = (
    exchange_events,
    line_events,
    tls_events,
    table_events,
    process_events,
    publishing_events,
    sensor_events,
)
"""In the order of the documents; the first line of each is its title."""

EVENTS: Final[Mapping[str, EventEntry]] = {
    entry.name: entry for group in GROUPS for entry in entries_of(group)
}
