"""What is known about how the drive of one axis was told to move, beside its positions."""

from gateway.drives.motion import Action, MotionPlan


class MotionState:
    """Contents of mode and trigger registers as the drive acknowledged them, and what they lead to."""

    __slots__ = (
        "_coils",
        "_memory",
        "blocked_by",
        "last_run",
        "lost_modes",
        "plan",
        "rule_addresses",
        "runs_stored",
        "staged",
        "told_unknown",
    )

    def __init__(self, plan: MotionPlan) -> None:
        self.plan = plan
        modes = {mode.address for mode in plan.modes if mode is not None}
        triggers = {trigger.address for trigger in plan.triggers if not trigger.is_coil}
        self.rule_addresses = tuple(sorted(modes | triggers | plan.starts_on))
        """Registers whose writing may mean something."""
        self._memory: dict[int, int] = {}
        self._coils: dict[int, int] = {}
        self.blocked_by: int | None = None
        """Exception code of the target that was lost; its triggers are refused with it (M3)."""
        self.lost_modes: set[int] = set()
        """Mode registers whose writing was lost: what the controller believes is not what the drive holds."""
        self.staged: int | None = None
        """The command field that a trigger without a number runs."""
        self.last_run = Action.ABSOLUTE
        """How the last target was meant: the best guess for one that is staged before its mode is known."""
        self.told_unknown: tuple[tuple[int, int], ...] | None = None
        """Register contents that were reported as unknown last."""
        self.runs_stored = False
        """A position that the drive keeps was run: where the axis goes is not known."""

    @property
    def is_blocked(self) -> bool:
        """Whether triggers are refused."""
        return self.blocked_by is not None

    def word(self, address: int) -> int | None:
        """Return the content of a register, as far as it is known."""
        return self._memory.get(address)

    def coil(self, address: int) -> int | None:
        """Return the state of a coil, as far as it is known."""
        return self._coils.get(address)

    def note_words(self, words: dict[int, int]) -> None:
        """Note what the drive acknowledged."""
        self._memory.update(words)
        self.lost_modes.difference_update(words)

    def note_coils(self, coils: dict[int, int]) -> None:
        """Note which coils the drive acknowledged."""
        self._coils.update(coils)

    def doubt(self, words: dict[int, int], coils: dict[int, int]) -> None:
        """Note that what these registers and coils hold is not known any more."""
        for address in words:
            self._memory.pop(address, None)
        for address in coils:
            self._coils.pop(address, None)

    def forget(self) -> None:
        """Nobody knows any more what the drive's registers hold."""
        self._memory.clear()
        self._coils.clear()
        self.staged = None

    def block(self, code: int) -> bool:
        """Refuse triggers from now on; return whether that is news."""
        is_news = self.blocked_by is None
        if is_news:
            self.blocked_by = code
        return is_news

    def release(self) -> bool:
        """A complete target was accepted; return whether triggers pass again with it, and did not before."""
        if self.blocked_by is None or self.lost_modes:
            return False
        self.blocked_by = None
        return True
