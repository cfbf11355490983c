"""When the certificates that are in force end: noticed while a gateway runs, without reading a file again."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final

from gateway.catalogue.entry import EventEntry
from gateway.catalogue.tls_events import CERTIFICATE_ENDED, CERTIFICATE_ENDS_SOON
from gateway.files import FileRefusedError
from gateway.transport.certificate_times import Life, TimeProblem, list_problem, time_problem

DAY: Final = timedelta(days=1)
"""So often a certificate is told of, at most; and when it ends."""
LOOK_EVERY: Final = timedelta(minutes=1)
NEVER: Final = datetime.max.replace(tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class Held:
    """A certificate, or a list of revoked ones, as it was when its file came into force."""

    key: str
    """Of ``tls``: ``certificate``, ``clients`` or ``revoked``."""
    file: str
    life: Life | None
    """None: a list, or a file that only OpenSSL can read."""
    ends: datetime | None
    """None: never, or nobody knows."""

    def problem(self, now: datetime) -> TimeProblem | None:
        """Return what is to be said of its time, None for nothing."""
        if self.life is None:
            return list_problem(self.file, self.ends, now)
        return time_problem(self.life, now)


def read_held(paths: Mapping[str, Path]) -> tuple[Held, ...]:
    """Return what is in the files of ``tls`` that OpenSSL has taken, by their keys. It may block."""
    return tuple(
        held
        for key in ("certificate", "clients", "revoked")
        if key in paths
        for held in _read(key, paths[key])
    )


def _read(key: str, path: Path) -> Iterator[Held]:
    from gateway.transport.certificate_facts import list_ends, read_lives

    try:
        if key == "revoked":
            yield Held(key, str(path), None, list_ends(path)[1])
        else:
            for life in read_lives(path):
                yield Held(key, str(path), life, life.ends)
    except FileRefusedError:  # a check says so; until when it is good stays unknown here
        yield Held(key, str(path), None, None)


class Endings:
    """Tells of what ends soon, or has ended: of each certificate at the start and once a day at most.

    ``tell`` gets the event with its fields, and does not block. ``place`` is where the keys stand in the
    configuration, as ``http.tls``. The time is an argument.
    """

    def __init__(self, tell: Callable[[EventEntry, dict[str, object]], None], place: str) -> None:
        self._tell = tell
        self._place = place
        self._held: tuple[Held, ...] = ()
        self._told: dict[Held, tuple[bool, datetime]] = {}
        """Whether it was still good when it was told of, and when that was."""
        self._looked: datetime | None = None

    def is_other(self, held: tuple[Held, ...]) -> bool:
        """Whether one of these files holds something else than what is in force of it."""
        files = {(each.key, each.file) for each in held}
        return any((each.key, each.file) in files and each not in held for each in self._held)

    def take(self, held: tuple[Held, ...]) -> None:
        """Go by these from now on; what was told of one that stays counts."""
        self._held = held
        self._told = {each: told for each, told in self._told.items() if each in held}
        self._looked = None

    def is_due(self, now: datetime) -> bool:
        """Whether there is something to tell of; may be asked at any time, and looks once a minute."""
        if self._looked is not None and abs(now - self._looked) < LOOK_EVERY:
            return False
        self._looked = now
        return any(True for _ in self._due(now))

    def tell(self, now: datetime) -> None:
        """Tell of what is due."""
        for held, problem in list(self._due(now)):
            self._told[held] = problem.is_good_now, now
            fields: dict[str, object] = {
                "file": held.file,
                "days_left": _days_left(held.ends, now),
                "detail": f"{self._place}.{held.key}: {problem.found}",
                "remedy": problem.remedy,
            }
            self._tell(CERTIFICATE_ENDS_SOON if problem.is_good_now else CERTIFICATE_ENDED, fields)

    def status(self, now: datetime) -> list[dict[str, Any]]:
        """Return when each file is good no more: of several certificates in one the first to end counts."""
        first: dict[str, Held] = {}
        for held in self._held:
            if held.key not in first or (held.ends or NEVER) < (first[held.key].ends or NEVER):
                first[held.key] = held
        return [
            {
                "key": key,
                "file": held.file,
                "subject": "" if held.life is None else held.life.subject,
                "ends": None if held.ends is None else held.ends.isoformat(timespec="seconds"),
                "days_left": _days_left(held.ends, now),
            }
            for key, held in first.items()
        ]

    def _due(self, now: datetime) -> Iterator[tuple[Held, TimeProblem]]:
        for held in self._held:
            problem = held.problem(now)
            if problem is None:
                continue
            was_good, told = self._told.get(held, (None, now))
            # A clock that was set back counts as a day: nobody knows how much has gone by.
            if was_good is not problem.is_good_now or not timedelta() <= now - told < DAY:
                yield held, problem


def _days_left(ends: datetime | None, now: datetime) -> int | None:
    """Return whole days: 0 on the last one, negative after the end; None where there is no end."""
    return None if ends is None else (ends - now) // DAY
