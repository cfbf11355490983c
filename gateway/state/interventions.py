"""The journal of interventions: who changed what, and when, in files that show every later change.

A folder has numbered files of JSON, one entry a line, and ``head.json`` with number and digest of the newest
entry. An entry is written with sorted keys and without spaces, so that it has one form only. Its ``digest``
is the SHA-256 of this form without ``digest`` and ``who``; the next entry has it as ``previous``. ``who`` is
the personal part, with a random salt. The chain covers only ``who_digest``, so that ``who`` can be taken out
later: it becomes null, and an entry ``erasure`` says so.

All functions block.
"""

import contextlib
import errno
import fcntl
import hashlib
import json
import os
import secrets
import stat
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any, Final

from gateway.clock import boot_ns, wall_s
from gateway.plain import JsonObject
from gateway.state.folder import write_whole
from gateway.times import NS_PER_S

FOLDER_NAME: Final = "interventions"
SUFFIX: Final = ".jsonl"
HEAD_NAME: Final = "head.json"
FILE_BYTES: Final = 1_000_000
MOST_BYTES: Final = 64_000_000
"""Limit for all files together: more than 100 000 entries. Whole files are dropped, the oldest first."""
START: Final = "0" * 64
"""``previous`` of the first entry."""
JUMP_S: Final = 5.0
"""A clock that moved by more than this against the monotonic one was set."""
MOST_ENTRIES: Final = 1 << 62
"""A larger number was never written."""
MOST_RANGES: Final = 1000
"""Number of ranges of erased entries in one entry."""
BOOT_ID: Final = Path("/proc/sys/kernel/random/boot_id")
TORN: Final = (b"{", b"\0")
"""How the rest of an entry begins after a power cut: as an entry, or with bytes that were never written."""
OWN: Final = "gateway"
"""``via`` of what the journal says of itself."""
STRANGER: Final = "is named as a file of the journal and is none"
Entry = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Intervention:
    """What an entry says. Both times are those of the intervention, also if it is written later."""

    what: str
    via: str
    axis: str | None = None
    file: str | None = None
    before: Any = None
    after: Any = None
    who: Mapping[str, object] = field(default_factory=dict)
    """The personal part; empty: unknown."""
    wall_s: float = field(default_factory=wall_s)
    monotonic_ns: int = field(default_factory=boot_ns)

    def as_entry(self, seq: int, previous: str) -> Entry:
        """Return the entry of this number behind the entry of that digest."""
        who = {**self.who, "salt": secrets.token_hex(16)} if self.who else None
        entry: Entry = {
            "seq": seq,
            "previous": previous,
            "time": datetime.fromtimestamp(self.wall_s, UTC).isoformat(timespec="milliseconds"),
            "boot": _boot(),
            "monotonic_ns": self.monotonic_ns,
            "what": self.what,
            "axis": self.axis,
            "file": self.file,
            "before": self.before,
            "after": self.after,
            "via": self.via,
            "who": who,
            "who_digest": None if who is None else _sha256(who),
        }
        return {**entry, "digest": _digest(entry)}


_KEYS: Final = {
    *("seq", "previous", "digest", "time", "boot", "monotonic_ns"),
    *("what", "axis", "file", "before", "after", "via", "who", "who_digest"),
}


_TYPES: Final[Mapping[str, Any]] = {
    **dict.fromkeys(("seq", "monotonic_ns"), int),
    **dict.fromkeys(("previous", "time", "boot", "what", "via"), str),
    **dict.fromkeys(("axis", "file"), str | None),
    "who": dict | None,
}
"""The type of each field, which is checked: a forged entry with a right digest must not stop a reader."""


@cache
def _boot() -> str:
    """Return the id of this boot; where a service may not read it, that of this start of the service."""
    try:
        return BOOT_ID.read_text("ascii").strip()
    except OSError:
        return os.environ.get("INVOCATION_ID", "")


def _canonical(data: object) -> bytes:
    return _ENCODER.encode(data).encode(errors="backslashreplace")


_ENCODER: Final = json.JSONEncoder(sort_keys=True, ensure_ascii=False, separators=(",", ":"), allow_nan=False)


def _sha256(data: object) -> str:
    return hashlib.sha256(_canonical(data)).hexdigest()


def _digest(entry: Entry) -> str:
    return _sha256({key: value for key, value in entry.items() if key not in ("digest", "who")})


def _parsed_line(line: bytes) -> Entry:
    """Return the entry of a line, with its end.

    Raises:
        ValueError: the line is not as it was written; the text says why.
    """
    try:
        entry: Entry = json.loads(line.decode())
        is_whole = entry.keys() == _KEYS and _canonical(entry) + b"\n" == line
        is_whole = is_whole and all(isinstance(entry[key], types) for key, types in _TYPES.items())
        is_whole = is_whole and max(entry["seq"], abs(entry["monotonic_ns"])) < 1 << 63 and entry["seq"] > 0
        is_whole = is_whole and datetime.fromisoformat(entry["time"]).tzinfo is not None
    except (ValueError, RecursionError, TypeError, AttributeError):
        is_whole = False
    if not is_whole:
        raise ValueError("is no entry of the journal, or was rewritten")
    if _digest(entry) != entry["digest"]:
        raise ValueError(f"entry {entry['seq']} was changed: it has another digest")
    if entry["who"] is not None and _sha256(entry["who"]) != entry["who_digest"]:
        raise ValueError(f"`who` of entry {entry['seq']} was changed")
    return entry


@dataclass(frozen=True, slots=True)
class Head:
    """Number and digest of an entry."""

    seq: int
    digest: str


def files_in(folder: Path) -> list[Path]:
    """Return the files of a journal, oldest first."""
    return [path for path in _named_in(folder) if _is_file(path)]


def strangers_in(folder: Path) -> list[Path]:
    """Return what is named as a file of a journal and is none: a folder, a link, a device."""
    return [path for path in _named_in(folder) if not _is_file(path)]


def _named_in(folder: Path) -> list[Path]:
    return sorted(path for path in folder.glob(f"[0-9]*{SUFFIX}") if path.stem.isdecimal())


def _is_file(path: Path) -> bool:
    return stat.S_ISREG(path.lstat().st_mode)


def head_in(folder: Path) -> Head | None:
    """Return the newest entry that was synced to the disk; None: the file is missing or damaged."""
    try:
        found = json.loads((folder / HEAD_NAME).read_bytes())
        seq, digest = found["seq"], found["digest"]
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return None
    is_head = isinstance(seq, int) and 0 < seq < MOST_ENTRIES and isinstance(digest, str)
    return Head(seq, digest) if is_head else None


def newest_files_in(folder: Path) -> tuple[list[Path], bool]:
    """Return the files from the newest with a ``state`` on, and whether there are older ones."""
    files = files_in(folder)
    for at in range(len(files) - 1, 0, -1):
        if b'"what":"state"' in files[at].read_bytes():
            return files[at:], True
    return files, False


@contextlib.contextmanager
def locked(folder: Path, kind: int = fcntl.LOCK_SH) -> Iterator[None]:
    """Wait until no process writes here; with LOCK_EX, until none reads either."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, kind)
        yield
    finally:
        os.close(descriptor)


# --- Verify


class Verification:
    """Reads a journal and finds what was changed, cut, doubled or reordered.

    ``head`` is the newest entry as the folder has it. With ``since``, the digest of an entry, nothing before
    that entry counts. ``is_end``: only the newest files are read.
    """

    def __init__(self, head: Head | None = None, since: str | None = None, *, is_end: bool = False) -> None:
        self.entries = 0
        self.first: Entry | None = None
        self.last: Entry | None = None
        self.problems: list[str] = []
        """Each begins with file and line."""
        self.notes: list[str] = []
        self._head = head
        self._since = since
        self._is_head_there = False
        self._place = "the journal"
        self._unread: list[str] = []
        """Lines after the last good entry that are no entries."""
        self._may_be_torn = False
        self._needs_beginning = not is_end
        self._without_who: dict[int, str] = {}
        self._dropped: set[tuple[object, object]] = {(0, START)}

    def read(self, files: Iterable[Path]) -> Iterator[Entry]:
        """Yield the good entries of all files, in order; then call :meth:`finish`."""
        for path in files:
            with path.open("rb") as file:
                for number, line in enumerate(file, 1):
                    place = f"{path.name}:{number}"
                    try:
                        entry = _parsed_line(line)
                    except ValueError as error:
                        if not self._unread:
                            self._may_be_torn = line[:1] in TORN
                        self._unread.append(f"{place}: {error}")
                        continue
                    self._take(entry, place)
                    yield entry

    def finish(self, *, is_folder: bool = True) -> None:
        """Add the problems that show only at the end. ``is_folder``: no exported file (without a head)."""
        head, last = self._head, self.last
        seq = 0 if last is None else last["seq"]
        if self._unread and self._may_be_torn and head is not None and head.seq <= seq:
            self.notes.append(
                f"{self._unread[0].partition(': ')[0]}: torn by a power cut before it was synced; the "
                "supervisor mends it with its next entry"
            )
        else:
            self.problems += self._unread
        if head is not None and head.seq > seq:
            self.problems.append(f"{self._place}: cut: entry {head.seq} was behind entry {seq}")
        elif head is not None and not self._is_head_there and self._since is None and self._is_due(head):
            self.problems.append(f"{HEAD_NAME}: entry {head.seq} is not the one that was written")
        elif head is None and is_folder and (seq > 1 or last is None):
            self.problems.append(f"{HEAD_NAME}: missing or damaged, so a cut end would not show")
        if self._since is not None:
            self.problems.append(f"no entry has the digest {self._since}: cut, or another journal")
        if self.first is not None:
            before = (self.first["seq"] - 1, self.first["previous"])
            if self._needs_beginning and before not in self._dropped:
                self.problems.append(f"the beginning is missing: the first entry is {self.first['seq']}")
        for place in self._without_who.values():
            self.problems.append(f"{place}: `who` was taken out, and no entry says so")

    def as_data(self) -> JsonObject:
        """Return the result as plain data."""

        def ends(entry: Entry | None) -> JsonObject | None:
            return entry and {key: entry[key] for key in ("seq", "time", "digest")}

        return {
            "whole": not self.problems,
            "entries": self.entries,
            "first": ends(self.first),
            "last": ends(self.last),
            "notes": list(self.notes),
            "problems": list(self.problems),
        }

    def lines(self) -> Iterator[str]:
        """Yield the result in words, without notes and problems."""
        if self.first is not None and self.last is not None:
            yield f"{self.entries} entries, from {self.first['time']} to {self.last['time']}"
            yield f"newest entry: {self.last['seq']}, digest {self.last['digest']}"
        if not self.problems:
            yield "whole: nothing was changed, cut, doubled or reordered"

    def _is_due(self, head: Head) -> bool:
        """Whether the head must be among the entries that were read."""
        return self._needs_beginning or self.first is None or head.seq >= self.first["seq"]

    def _take(self, entry: Entry, place: str) -> None:
        last = self.last
        if last is not None and not self._unread:  # the link to a line that is no entry cannot be checked
            if (entry["previous"], entry["seq"]) != (last["digest"], last["seq"] + 1):
                self.problems.append(f"{place}: entry {entry['seq']} does not follow entry {last['seq']}")
            elif entry["boot"] and entry["boot"] == last["boot"]:
                self._compare_clocks(last, entry, place)
        if self._unread:
            self._needs_beginning &= last is not None  # one of these lines was the beginning
            self.problems += self._unread
            self._unread.clear()
        self.entries += 1
        self.first = self.first or entry
        self.last, self._place = entry, place
        if self._head is not None and (entry["seq"], entry["digest"]) == (self._head.seq, self._head.digest):
            self._is_head_there = True
        if entry["who"] is None and entry["who_digest"] is not None:
            self._without_who[entry["seq"]] = place
        self._take_own(entry, place)
        if entry["digest"] == self._since:
            self._since, self.entries, self.first = None, 1, entry
            self.problems.clear()
            self.notes.clear()
            self._without_who.clear()
            self._needs_beginning = False

    def _take_own(self, entry: Entry, place: str) -> None:
        after = entry["after"]
        match entry["what"]:
            case "damaged":
                self.problems.append(f"{place}: says that the journal was damaged before")
            case "dropped" if isinstance(after, dict):
                with contextlib.suppress(TypeError):  # this program never writes such a value
                    self._dropped.add((after.get("seq"), after.get("digest")))
            case "erasure":
                with contextlib.suppress(TypeError, ValueError, OverflowError):  # nor that
                    for first, last in after:
                        erased: Iterable[int] = range(first, min(last, entry["seq"]) + 1)
                        if last - first > len(self._without_who):  # a forged range may be endless
                            erased = [seq for seq in self._without_who if seq in erased]
                        for seq in erased:
                            self._without_who.pop(seq, None)

    def _compare_clocks(self, last: Entry, entry: Entry, place: str) -> None:
        wall = datetime.fromisoformat(entry["time"]) - datetime.fromisoformat(last["time"])
        jump_s = wall.total_seconds() - (entry["monotonic_ns"] - last["monotonic_ns"]) / NS_PER_S
        if abs(jump_s) > JUMP_S:
            self.notes.append(f"{place}: the clock was set by {jump_s:+.0f} s before this entry")


def read_journal(folder: Path, since: str | None = None) -> tuple[Verification, list[Entry], bytes]:
    """Return what is wrong with the journal of a folder, its good entries, and its bytes as one file.

    Raises:
        OSError: it cannot be read.
    """
    with locked(folder):
        verification = Verification(head_in(folder), since)
        files = files_in(folder)
        entries = list(verification.read(files))
        content = b"".join(path.read_bytes() for path in files)
        strangers = strangers_in(folder)
    verification.finish()
    verification.notes += [f"{path.name}: {STRANGER}; move it away" for path in strangers]
    return verification, entries, content


# --- Write


class Writer:
    """Appends to a journal. Each call reads where the journal ends, so that writers may take turns.

    ``state`` returns what is in force: each further file begins with it.
    """

    def __init__(
        self,
        folder: Path,
        file_bytes: int = FILE_BYTES,
        most_bytes: int = MOST_BYTES,
        state: Callable[[], object] | None = None,
    ) -> None:
        self._state = state
        self._folder = folder
        self._file_bytes = file_bytes
        self._most_bytes = most_bytes
        self._file: Path | None = None
        """The file that is written; None: none yet."""
        self._end = Head(0, START)
        self.strangers: list[Path] = []
        """As the last call found them: the journal passes their names over."""
        self.head: Head | None = None
        """The newest entry, as the last call that succeeded left it; None: there is none."""

    def write(self, waiting: deque[Intervention]) -> None:
        """Append all that waits, each synced to the disk, and remove it from ``waiting``.

        Raises:
            OSError: the rest still waits, or only the head could not be written.
        """
        with self._alone():
            while waiting:
                self._append(waiting[0])
                waiting.popleft()
            self._write_head()

    def erase(self, is_meant: Callable[[Entry], bool], by: Intervention) -> int:
        """Take ``who`` out of the entries that are meant, with an entry ``by``; return their number.

        The entry comes first: after a crash in between, the same call takes out the rest.

        Raises:
            OSError: not everything could be written.
        """
        with self._alone():
            for rest in self._folder.glob(f".*{SUFFIX}.*"):
                rest.unlink()  # an unfinished copy of a killed process; it has names too
            found = {
                path: {
                    entry["seq"]
                    for entry in Verification().read((path,))
                    if entry["who"] is not None and is_meant(entry)
                }
                for path in files_in(self._folder)
            }
            ranges = list(_ranges(sorted(seq for seqs in found.values() for seq in seqs)))
            for first in range(0, len(ranges), MOST_RANGES):
                some = ranges[first : first + MOST_RANGES]
                self._append(Intervention("erasure", by.via, after=some, who=by.who))
            self._write_head()
            for path, seqs in found.items():
                if seqs and path.exists():
                    lines = path.read_bytes().splitlines(keepends=True)
                    write_whole(path, b"".join(_without_who(line, seqs) for line in lines))
        return sum(map(len, found.values()))

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        try:
            self._folder.mkdir(mode=0o700)  # never the state folder itself: it must not reappear
        except FileExistsError:
            if not self._folder.is_dir():  # also a link to a disk that is not there: no missing state folder
                raise NotADirectoryError(
                    errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(self._folder)
                ) from None
        head = self._folder / HEAD_NAME
        if head.is_dir():  # without a head each call would report a damaged journal
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(head))
        with locked(self._folder, fcntl.LOCK_EX):
            self.strangers = strangers_in(self._folder)
            for remark in self._find_end():
                self._put(remark)
            yield

    def _find_end(self) -> list[Intervention]:
        """Find the last entry; return the entries that must be written about it.

        Entries after the head were not synced: a power cut may leave half an entry there, which is removed.
        The entry that the head names was synced. If it is missing, nothing is removed, and the chain
        continues from the head in a new file, so that the gap stays visible.
        """
        head, files = head_in(self._folder), files_in(self._folder)
        self._file, self._end = files[-1] if files else None, Head(0, START)
        good, is_head_there = (files[0] if files else None, 0), head is None
        for path, line, end_bytes in _backwards(files):
            with contextlib.suppress(ValueError):
                entry = _parsed_line(line)
                here = Head(entry["seq"], entry["digest"])
                if not self._end.seq:
                    self._end, good = here, (path, end_bytes)
                if head is None or here.seq <= head.seq:
                    is_head_there = head is None or here == head
                    break
        found = {"seq": self._end.seq, "digest": self._end.digest}
        rests = [(path, good[1] if path == good[0] else 0) for path in files if path >= (good[0] or path)]
        torn = [(path, kept, path.read_bytes()[kept:]) for path, kept in rests]
        if head is None and (self._end.seq > 1 or sum(rest.count(b"\n") for *_, rest in torn) > 1):
            self._begin_file()
            return [Intervention("damaged", OWN, file=HEAD_NAME, after=found)]
        if head is not None and not is_head_there:
            self._end = head
            self._begin_file()
            before = {"seq": head.seq, "digest": head.digest}
            return [Intervention("damaged", OWN, before=before, after=found)]
        remarks: list[Intervention] = []
        for path, kept, rest in torn:
            if rest:
                os.truncate(path, kept)
                what = {"bytes": len(rest), "sha256": hashlib.sha256(rest).hexdigest()}
                remarks.append(Intervention("torn", OWN, file=path.name, before=what))
        return remarks

    def _append(self, one: Intervention) -> None:
        """Append an entry; begin a new file if this one is full, and drop the oldest if all are."""
        # Room for the rest of an entry besides its values.
        expected_bytes = 1000 + len(_canonical([one.before, one.after, dict(one.who)]))
        if self._file is not None and self._file.stat().st_size + expected_bytes > self._file_bytes:
            self._begin_file()
            files = files_in(self._folder)
            total = sum(path.stat().st_size for path in files)
            while len(files) > 1 and total + self._file_bytes > self._most_bytes:
                oldest = files.pop(0)
                total -= oldest.stat().st_size
                read = Verification()
                for _ in read.read((oldest,)):
                    pass
                if read.first is not None and read.last is not None:
                    last = {"seq": read.last["seq"], "digest": read.last["digest"], "time": read.last["time"]}
                    first = {"seq": read.first["seq"], "time": read.first["time"]}
                    self._put(Intervention("dropped", OWN, file=oldest.name, before=first, after=last))
                oldest.unlink()
            if self._state is not None:
                self._put(Intervention("state", OWN, after=self._state()))
        self._put(one)

    def _begin_file(self) -> None:
        number = 0 if self._file is None else int(self._file.stem)
        while True:
            number += 1
            self._file = self._folder / f"{number:06d}{SUFFIX}"
            if self._file not in self.strangers:
                return

    def _put(self, one: Intervention) -> None:
        """Append an entry whole or not at all."""
        if self._file is None:
            self._begin_file()
        assert self._file is not None, "it was just begun"
        entry = one.as_entry(self._end.seq + 1, self._end.digest)
        line = _canonical(entry) + b"\n"
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
        descriptor = os.open(self._file, flags, 0o600)
        try:
            before = os.fstat(descriptor).st_size
            try:
                if os.write(descriptor, line) < len(line):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._file))
                os.fdatasync(descriptor)
            except OSError:
                with contextlib.suppress(OSError):
                    os.ftruncate(descriptor, before)
                raise
        finally:
            os.close(descriptor)
        self._end = Head(entry["seq"], entry["digest"])

    def _write_head(self) -> None:
        if self._end.seq and head_in(self._folder) != self._end:
            content = _canonical({"seq": self._end.seq, "digest": self._end.digest})
            write_whole(self._folder / HEAD_NAME, content + b"\n")
        self.head = self._end if self._end.seq else None


def _backwards(files: list[Path]) -> Iterator[tuple[Path, bytes, int]]:
    """Yield the lines of all files, the last one first, each with the offset of its end."""
    for path in reversed(files):
        whole = path.read_bytes()
        end = len(whole)
        while end:
            start = whole.rfind(b"\n", 0, end - 1) + 1
            yield path, whole[start:end], end
            end = start


def _ranges(numbers: Iterable[int]) -> Iterator[list[int]]:
    """Yield the ranges of sorted numbers.

    >>> list(_ranges([1, 2, 3, 7]))
    [[1, 3], [7, 7]]
    """
    first = last = None
    for number in numbers:
        if last is not None and number == last + 1:
            last = number
            continue
        if first is not None and last is not None:
            yield [first, last]
        first = last = number
    if first is not None and last is not None:
        yield [first, last]


def _without_who(line: bytes, seqs: set[int]) -> bytes:
    with contextlib.suppress(ValueError):
        entry = _parsed_line(line)
        if entry["seq"] in seqs:
            return _canonical({**entry, "who": None}) + b"\n"
    return line
