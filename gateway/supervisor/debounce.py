"""Decides when to read a table file that is being saved: when it is stable, or really gone.

Some editors write in place, some write a second file and rename it, some first move the old file away. A slow
link takes time. A file that is read in the middle of this has content that was never intended.
"""

from dataclasses import dataclass, field
from enum import Enum
from typing import Final

STILL_S: Final = 0.5
"""A file is stable after so long without a change: longer than an editor's pauses and a clock's tick."""
STILL_UNSEEN_S: Final = 10.0
"""The same where the system does not tell who writes the file: longer than a copy over a slow link pauses."""
GONE_S: Final = 5.0
"""A file is gone after so long. Editors move it away and back within a fraction of this."""
UNSIGNED_S: Final = 10.0
"""A file whose signature is missing or older is stable after so long: longer than copying both takes."""
OVERDUE_S: Final = 30.0
"""A file that has not been stable for so long is reported: no save takes this long."""


@dataclass(frozen=True, slots=True)
class FileStamp:
    """What the file system shows of a file without reading it. Equal content gives equal stamps."""

    is_there: bool
    """Whether a file is there, readable or not."""
    mark: tuple[object, ...] = ()
    """Device, inode, size and times, or the error."""
    is_being_written: bool | None = False
    """Whether a program of this machine has it open for writing; None if the system does not tell."""
    changed_ns: int = 0
    """When it or its signature was last written to, by the clock of its file system."""
    is_signature_due: bool = field(default=False, compare=False)
    """Whether signatures are asked for, and that of the file is missing or older than it: it may come yet."""

    @property
    def still_s(self) -> float:
        """After how long without a change it may be read, or is gone."""
        if not self.is_there:
            return GONE_S
        if self.is_being_written is None:
            return STILL_UNSEEN_S
        return UNSIGNED_S if self.is_signature_due else STILL_S


class FileStability(Enum):
    """What a poll shows about the file."""

    SAME = "same"
    """The same file that was last read."""
    MOVING = "moving"
    """It changes, or has been gone for a short time only."""
    READY = "ready"
    """It differs from the file that was last read and is stable, or it is really gone."""


class FileDebounce:
    """Follows one file. Each poll passes the time, in seconds of any monotonic clock."""

    def __init__(self) -> None:
        self._taken: tuple[bool, tuple[object, ...]] | None = None
        self._is_taken_early = False
        self._seen: FileStamp | None = None
        self._since_s = 0.0
        self._moving_since_s: float | None = None

    def observe(self, stamp: FileStamp, now_s: float) -> FileStability:
        """Take the stamp of a poll."""
        state = self._judge(stamp, now_s)
        if state is not FileStability.MOVING:
            self._moving_since_s = None
        elif self._moving_since_s is None:
            self._moving_since_s = now_s
        return state

    def is_read(self, stamp: FileStamp) -> bool:
        """Whether a file with this stamp was read, however early."""
        return (stamp.is_there, stamp.mark) == self._taken

    def is_overdue(self, now_s: float) -> bool:
        """Whether the file has not been stable for very long."""
        return self._moving_since_s is not None and now_s - self._moving_since_s >= OVERDUE_S

    def _judge(self, stamp: FileStamp, now_s: float) -> FileStability:
        if stamp != self._seen:
            self._seen, self._since_s = stamp, now_s
        is_still = now_s - self._since_s >= stamp.still_s
        if self.is_read(stamp):
            is_ready = self._is_taken_early and is_still and not stamp.is_being_written
            return FileStability.READY if is_ready else FileStability.SAME
        if stamp.is_being_written:
            return FileStability.MOVING
        return FileStability.READY if is_still else FileStability.MOVING

    def take(self, stamp: FileStamp, now_s: float) -> None:
        """Note that the file was read with this stamp.

        A file that was read before it was stable is read once more when it is stable. Within a tick of the
        file system's clock it can change and keep its stamp.
        """
        if stamp != self._seen:
            self._seen, self._since_s = stamp, now_s
        self._taken = (stamp.is_there, stamp.mark)
        self._is_taken_early = stamp.is_there and now_s - self._since_s < stamp.still_s

    def forget(self) -> None:
        """Read the file again as soon as it is stable, even if its stamp is the same."""
        self._taken = None
