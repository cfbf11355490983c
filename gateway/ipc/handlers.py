"""What the gateway does for the clients of its socket."""

import os
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from gateway.exchange.commands import SetTable
from gateway.ipc.address import ROOT_UID, Peer
from gateway.ipc.messages import Done, Reply, Request
from gateway.status.model import RelayModel

ASKED_AGAIN_S: Final = 0.002
"""A delayed status is tried again after this time, which is shorter than the time between two frames."""
LONGEST_WAIT_S: Final = 0.25
"""The longest delay: with many lines some frame is nearly always being forwarded."""


async def _no_tables(_request: SetTable, _descriptors: Sequence[int], _peer: Peer) -> Reply:
    return Done(problems=("tables are not accepted here",))


def _never() -> bool:
    return False


def _ignore(_detail: str) -> None:
    pass


@dataclass(frozen=True, slots=True)
class RequestHandlers:
    """What a server does for its clients; every function returns immediately, but ``hand_over`` may wait.

    ``hand_over`` gets the descriptors of a message with it, and may not keep them: they are closed after it.
    """

    answer: Callable[[Request, Peer], Reply]
    hand_over: Callable[[SetTable, Sequence[int], Peer], Awaitable[Reply]] = _no_tables
    status: Callable[[], RelayModel] = RelayModel
    has_to_wait: Callable[[], bool] = _never
    """Whether a status must wait: it takes milliseconds, and would interrupt a frame that is being
    forwarded."""
    tapes: Callable[[], Mapping[str, int]] = dict
    """The trace buffer of each line that has one, as a descriptor that the gateway owns."""
    complain: Callable[[str], None] = _ignore
    """Gets a sentence about each refusal, at most one a minute of each kind."""
    masters: frozenset[int] = field(default_factory=lambda: frozenset((os.geteuid(), ROOT_UID)))
    """User ids that may send commands; all others may only read."""
