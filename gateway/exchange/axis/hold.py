"""Who moves an axis: one writer at a time, until it has gone or has been quiet for long enough."""

from typing import Final

from gateway.times import NS_PER_S

NEVER_NS: Final = -(10**18)
"""Long before every time there is."""
BACK_NS: Final = 2 * NS_PER_S
"""So long a writer without a connection may still be one that connects anew, for each request or after its
cable was pulled: nobody else begins between two of its commands."""


class Hold:
    """The hold on one axis. A *writer* is a controller and the host that it connects from.

    Whoever held it last stays its writer until another one takes it over: what the drive holds is from there.
    """

    __slots__ = ("_hold_ns", "is_shared", "jogged_by", "last_ns", "overwritten_by", "writer")

    def __init__(self, hold_s: float, *, is_shared: bool) -> None:
        self._hold_ns = int(hold_s * NS_PER_S)
        self.is_shared = is_shared
        """Everybody may move it at any time."""
        self.writer = ""
        """Who moved it last; empty: nobody has."""
        self.last_ns = NEVER_NS
        """When its writer moved it last."""
        self.jogged_by = ""
        """Who made it move without a target, until that was ended; empty: nobody."""
        self.overwritten_by = ""
        """Who changed the target in the drive beside a stop, which nobody is refused; "": nobody. It is not
        run: its writer has to write another one."""

    def is_held(self, now_ns: int) -> bool:
        """Whether its writer still holds it."""
        return bool(self.writer) and now_ns - self.last_ns <= self._hold_ns

    def is_barred(self, writer: str, now_ns: int) -> bool:
        """Whether another writer holds it."""
        return not self.is_shared and writer != self.writer and self.is_held(now_ns)

    def leave(self, now_ns: int) -> None:
        """Its writer has no connection any more: it holds for :data:`BACK_NS` at most."""
        self.last_ns = min(self.last_ns, now_ns + BACK_NS - self._hold_ns)

    def move(self, writer: str, now_ns: int) -> None:
        """A writer moves the axis now."""
        self.writer = writer
        self.last_ns = now_ns

    def extend(self, now_ns: int) -> None:
        """Its writer moves it now."""
        self.last_ns = now_ns

    def set_jog(self, writer: str) -> None:
        """Note who makes it move without a target; "": nobody any more."""
        self.jogged_by = writer

    def overwrite(self, writer: str) -> None:
        """Note who changed the target beside a stop; "": its writer has written another one since."""
        self.overwritten_by = writer
