"""What is known about how the drive of one axis was told to move, beside its positions."""

from gateway.drives.motion import Action, MotionPlan


class MotionState:
    """Contents of mode and trigger registers as the drive acknowledged them, and what they lead to."""

    __slots__ = (
        "_blocked_at",
        "_coils",
        "_lost_modes",
        "_memory",
        "blocked_by",
        "is_blocked_first",
        "last_run",
        "losses",
        "plan",
        "rule_addresses",
        "runs_stored",
        "staged",
        "told_restaged_ns",
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
        self._blocked_at = 0
        self.is_blocked_first = False
        """The target was lost for its own sake, not because another axis of the group was blocked (M11)."""
        self.losses = 0
        """Targets and modes lost so far: what was sent before a loss does not make up for it."""
        self._lost_modes: dict[int, tuple[int, int]] = {}
        """Mode registers whose writing was lost: its exception code, and ``losses`` then."""
        self.staged: int | None = None
        """The command field that a trigger without a number runs."""
        self.last_run = Action.ABSOLUTE
        """How the last target was meant: the best guess for one that is staged before its mode is known."""
        self.told_restaged_ns: int | None = None
        """When restaging was reported last."""
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

    def note_words(self, words: dict[int, int], losses: int) -> None:
        """Note what the drive acknowledged; ``losses``: when it was sent."""
        self._memory.update(words)
        for address in words:
            if self._lost_modes.get(address, (0, 0))[1] <= losses:
                self._lost_modes.pop(address, None)

    def note_read(self, address: int, word: int) -> None:
        """Note what a register was read to hold."""
        self._memory[address] = word

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

    def lose_mode(self, address: int, code: int) -> None:
        """Note that the writing of a mode register was lost."""
        self.losses += 1
        self._lost_modes[address] = (code, self.losses)

    def block(self, code: int, *, is_first: bool = True) -> bool:
        """Refuse triggers from now on; return whether that is news."""
        self.losses += 1
        self._blocked_at = self.losses
        is_news = self.blocked_by is None
        if is_news:
            self.blocked_by = code
        self.is_blocked_first |= is_first
        return is_news

    def release(self, losses: int) -> bool:
        """A complete target was accepted; return whether triggers pass again with it, and did not before.

        ``losses``: when it was sent.
        """
        if losses < self._blocked_at:
            return False
        was_blocked = self.blocked_by is not None
        self.blocked_by = None
        self.is_blocked_first = False
        return was_blocked

    def lost_mode(self, number: int | None) -> int | None:
        """Return the exception code with which the mode of a command field was lost, if it was."""
        mode = None if number is None else self.plan.mode(number)
        return None if mode is None else self._lost_modes.get(mode.address, (None, 0))[0]
