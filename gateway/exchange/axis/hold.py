"""Who moves an axis: one writer at a time, until it disconnects or was quiet for long enough."""

from typing import Final

from gateway.times import NS_PER_S

NEVER_NS: Final = -(10**18)
"""Earlier than any real time."""
BACK_NS: Final = 2 * NS_PER_S
"""A writer without a connection keeps its axis for this time. It may be a controller that connects for each
request, or whose cable was unplugged: no other writer begins between two of its commands."""


class Hold:
    """The hold on one axis. A *writer* is a controller together with the host from which it connects.

    The last holder stays the writer until another one takes over, because it wrote what the drive holds.
    """

    __slots__ = ("_hold_ns", "is_shared", "jogged_by", "last_ns", "overwritten_by", "writer")

    def __init__(self, hold_s: float, *, is_shared: bool) -> None:
        self._hold_ns = int(hold_s * NS_PER_S)
        self.is_shared = is_shared
        """Any writer may move it at any time."""
        self.writer = ""
        """The writer that moved it last; empty: none."""
        self.last_ns = NEVER_NS
        """When its writer moved it last."""
        self.jogged_by = ""
        """The writer that started a motion without a target which has not ended; empty: none."""
        self.overwritten_by = ""
        """The writer that changed the target together with a stop, which is never refused; empty: none. That
        target is not run: the axis's writer must write another one."""

    def is_held(self, now_ns: int) -> bool:
        """Whether its writer still holds it."""
        return bool(self.writer) and now_ns - self.last_ns <= self._hold_ns

    def is_barred(self, writer: str, now_ns: int) -> bool:
        """Whether another writer holds it."""
        return not self.is_shared and writer != self.writer and self.is_held(now_ns)

    def leave(self, now_ns: int) -> None:
        """Its writer has no connection any more: it holds for at most :data:`BACK_NS`."""
        self.last_ns = min(self.last_ns, now_ns + BACK_NS - self._hold_ns)

    def move(self, writer: str, now_ns: int) -> None:
        """A writer moves the axis now."""
        self.writer = writer
        self.last_ns = now_ns

    def extend(self, now_ns: int) -> None:
        """Its writer moves it now."""
        self.last_ns = now_ns

    def set_jog(self, writer: str) -> None:
        """Record the writer that moves it without a target; empty: none any more."""
        self.jogged_by = writer

    def overwrite(self, writer: str) -> None:
        """Record the writer whose stop changed the target; empty: the axis's writer wrote a new one."""
        self.overwritten_by = writer
