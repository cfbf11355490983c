"""Every event, by name and by group. Adding one: a constant in the file of its group, and nothing else."""

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
"""In the order in which documents list them; the first line of each says what it holds."""

EVENTS: Final[Mapping[str, EventEntry]] = {
    entry.name: entry for group in GROUPS for entry in entries_of(group)
}
