"""What the gateway does for those who are connected to its socket."""

import os
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from gateway.exchange.commands import SetTable
from gateway.ipc.address import ROOT_UID
from gateway.ipc.messages import Done, Reply, Request
from gateway.status.model import RelayModel

ASKED_AGAIN_S: Final = 0.002
"""A status that has to wait is tried again after so long: shorter than what lies between two frames."""
LONGEST_WAIT_S: Final = 0.25
"""So long it waits at most: on many lines some frame is leaving nearly always."""


async def _no_tables(_request: SetTable, _descriptors: Sequence[int]) -> Reply:
    return Done(problems=("tables are not taken here",))


def _never() -> bool:
    return False


def _ignore(_detail: str) -> None:
    pass


@dataclass(frozen=True, slots=True)
class RequestHandlers:
    """What a server does for its clients; every function returns at once, but ``hand_over`` may wait.

    It gets the descriptors of a message with it, and may not keep them; they are closed after it.
    """

    answer: Callable[[Request], Reply]
    hand_over: Callable[[SetTable, Sequence[int]], Awaitable[Reply]] = _no_tables
    status: Callable[[], RelayModel] = RelayModel
    has_to_wait: Callable[[], bool] = _never
    """Whether a status has to wait, which takes milliseconds: a frame is leaving that must not break off."""
    tapes: Callable[[], Mapping[str, int]] = dict
    """The tape of each line that has one, as a descriptor that stays the gateway's."""
    complain: Callable[[str], None] = _ignore
    """Gets a sentence about what was refused; not more than one a minute of each kind."""
    masters: frozenset[int] = field(default_factory=lambda: frozenset((os.geteuid(), ROOT_UID)))
    """User ids that may change something; others may look."""
