"""What the gateway does for those who are connected to its socket."""

import os
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from gateway.exchange.commands import SetTable
from gateway.ipc.messages import Done, Reply, Request
from gateway.ipc.place import ROOT_UID


async def _no_tables(_request: SetTable, _descriptors: Sequence[int]) -> Reply:
    return Done(problems=("tables are not taken here",))


def _no_status() -> Mapping[str, Any]:
    return {}


def _no_note(_detail: str) -> None:
    pass


@dataclass(frozen=True, slots=True)
class Desk:
    """What a server does for its clients; every function returns at once, but ``hand_over`` may wait.

    It gets the descriptors of a message with it, and may not keep them; they are closed after it.
    """

    answer: Callable[[Request], Reply]
    hand_over: Callable[[SetTable, Sequence[int]], Awaitable[Reply]] = _no_tables
    status: Callable[[], Mapping[str, Any]] = _no_status
    tapes: Callable[[], Mapping[str, int]] = dict
    """The tape of each line that has one, as a descriptor that stays the gateway's."""
    complain: Callable[[str], None] = _no_note
    """Gets a sentence about what was refused; not more than one a minute of each kind."""
    masters: frozenset[int] = field(default_factory=lambda: frozenset((os.geteuid(), ROOT_UID)))
    """User ids that may change something; others may look."""
