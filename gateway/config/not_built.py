"""What the configuration can say and this release cannot do yet. A later release deletes its lines here.

Everything named here is refused: a key that would be ignored could move a machine to the wrong place.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from gateway.config.findings import Findings
from gateway.config.toml_lines import KeyPath


@dataclass(frozen=True, slots=True)
class NotBuilt:
    """One thing that is refused: where it stands (``*`` for any name), what it is, what to do instead."""

    place: str
    what: str
    instead: str


NOT_BUILT: Final = (
    NotBuilt(
        "axis.*.table_options.fagor_sense",
        "reading Fagor tables is",
        "convert the table to Centroid version 3 and leave this out",
    ),
)


def refuse_what_is_not_built(findings: Findings) -> None:
    """Refuse every key of the document that this release cannot honour."""
    for entry in NOT_BUILT:
        for path in _find(findings.document.tables, tuple(entry.place.split("."))):
            findings.refuse(path, f"{entry.what} not built yet", entry.instead)


def _find(here: Any, place: tuple[str, ...], path: KeyPath = ()) -> Iterator[KeyPath]:
    if not place:
        yield path
    elif not isinstance(here, Mapping):
        return
    elif place[0] == "*":
        for key, found in here.items():
            yield from _find(found, place[1:], (*path, key))
    elif place[0] in here:
        yield from _find(here[place[0]], place[1:], (*path, place[0]))
