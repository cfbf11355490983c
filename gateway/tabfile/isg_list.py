"""Parameter lists of the ISG kernel, ``key value`` with comments, and the keys of a leadscrew table in them.

Grammar (ISG kernel and TwinCAT CNC documentation, "Compensation value lists")::

    key value              the key has no blanks, the value is the rest of the line
    # comment              to the end of the line
    /* comment */          also over several lines

A comment begins the line or follows a blank: a comment mark inside a number is an error, not its end. A
comment must not begin inside another: the end of the first is probably damaged, and entries would be lost in
it. The case of a key does not matter.
"""

import re
from collections.abc import Iterable
from typing import Final

from msgspec import Struct

from gateway.tabfile.errors import FileProblem, TabFileError
from gateway.tabfile.text import DECIMAL_ALLOWED, INTEGER_ALLOWED, SourceText, shown, to_decimal, to_integer

MAX_PROBLEMS: Final = 20
_KEY: Final = re.compile(r"[a-z_]\w*(?:\[[0-9]{1,6}\])*(?:\.[a-z_]\w*(?:\[[0-9]{1,6}\])*)*", re.ASCII)
_OPENING: Final = re.compile(r"(?:^|(?<=[ \t]))(?:#|/\*)")
_OPENING_THERE: Final = re.compile(r"#|/\*")
_LIST_LINE: Final = "a line 'key value', such as 'kw.ssfk.table[0].pos 24', or a comment"


class IsgEntry(Struct, frozen=True):
    """One line of a list; ``key`` is in lower case."""

    key: str
    value: str
    line: int


def parse_list(source: SourceText) -> list[IsgEntry]:
    """Return the entries of a list in the order of the file, without comments and blank lines.

    Raises:
        TabFileError: a line that is neither an entry nor a comment, or a comment that does not end.
    """
    entries: list[IsgEntry] = []
    problems: list[FileProblem] = []
    opened: int | None = None
    """Line of the open block comment."""
    for line in source.lines:
        text, is_open, is_nested = _without_comments(line.text, is_open=opened is not None)
        if is_nested:
            allowed = f"'*/' first, for the comment that began on line {opened or line.number}"
            problems.append(source.problem("'/*' inside a comment", allowed, line=line.number))
        opened = (opened or line.number) if is_open else None
        found = _entry(text, line.number)
        if isinstance(found, IsgEntry):
            entries.append(found)
        elif found is not None:
            problems.append(source.problem(found, _LIST_LINE, line=line.number))
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    if opened is not None:
        raise source.error("a comment that does not end", "'*/' after each '/*'", line=opened)
    return entries


def _entry(text: str, line: int) -> IsgEntry | str | None:
    """Return the entry, None for a line without one, or what was found instead."""
    if not text:
        return None
    key, *value = text.split(None, 1)
    if not _KEY.fullmatch(key.lower()):
        return shown(text)
    if not value:
        return f"{shown(key)} without a value"
    return IsgEntry(key.lower(), value[0], line)


def _without_comments(text: str, *, is_open: bool) -> tuple[str, bool, bool]:
    """Return the text without comments, whether one is open at the end, and whether one began in another."""
    kept: list[str] = []
    is_nested, at = False, 0
    while True:
        if is_open:
            # An index into the text, not a copy of the rest: a line may hold very many comments.
            end = text.find("*/", at)
            is_nested = is_nested or "/*" in text[at : end if end >= 0 else None]
            if end < 0:
                return "".join(kept).strip(), True, is_nested
            kept.append(" ")
            at = end + 2
        # What directly follows a comment is a comment, too.
        opening = _OPENING_THERE.match(text, at) if is_open else None
        opening = opening or _OPENING.search(text, at)
        if opening is None:
            return "".join((*kept, text[at:])).strip(), False, is_nested
        kept.append(text[at : opening.start()])
        if opening.group() == "#":
            return "".join(kept).strip(), False, is_nested
        is_open, at = True, opening.end()


# --- The keys of a leadscrew table: their names, each once, and their values

PREFIX: Final = "kw.ssfk."
CYCLES: Final = "lr_param.n_backlash_cyc"
AXIS_NAMES: Final = ("kopf.log_achs_name", "kopf.achs_name")
SETTINGS: Final = frozenset(
    {
        "unit",
        "interval",
        "kw_startpos",
        "kw_nr_max",
        "bilateral",
        "modulo",
        "max_points",
        "manual_activation",
        "set_pos_without_comp",
    }
)
_RESERVED: Final = re.compile(r"res[0-9]")
"""Reserved for later settings in older lists; a value other than 0 would be an unknown setting."""
_POINT: Final = re.compile(r"table\[(0|[1-9][0-9]{0,5})\]\.(setpoint|pos|neg)")


class Keys(Struct, frozen=True):
    """The entries of one table, checked for repetitions and unknown keys."""

    source: SourceText
    settings: dict[str, IsgEntry]
    points: dict[str, dict[int, IsgEntry]]
    """Entries by field (setpoint, pos, neg) and index."""
    cycles: IsgEntry | None
    axis_name: IsgEntry | None
    others: tuple[IsgEntry, ...]
    """Entries that do not begin with kw.ssfk."""

    def setting(self, name: str) -> IsgEntry:
        """Return a setting.

        Raises:
            TabFileError: the list does not have it.
        """
        entry = self.settings.get(name)
        if entry is None:
            raise self.source.error(
                f"no {PREFIX}{name}", f"a line '{PREFIX}{name} NUMBER'", line=self.source.last_line
            )
        return entry

    def number(self, entry: IsgEntry) -> float:
        """Return the number of an entry.

        Raises:
            TabFileError: it is not a number.
        """
        number = to_decimal(entry.value)
        if number is None:
            raise self.source.error(f"{entry.key} {shown(entry.value)}", DECIMAL_ALLOWED, line=entry.line)
        return number

    def count(self, name: str, default: int | None = None) -> int:
        """Return a setting that is a number of points, at least 2.

        Raises:
            TabFileError: it is not such a number, or is missing and has no default.
        """
        if default is not None and name not in self.settings:
            return default
        entry = self.setting(name)
        count = to_integer(entry.value)
        if count is None or count < 2:
            found = f"{name} {shown(entry.value)}"
            raise self.source.error(found, f"{INTEGER_ALLOWED}, at least 2", line=entry.line)
        return count

    def flag(self, name: str, *, default: bool | None = None) -> bool:
        """Return a setting that is 0 or 1.

        Raises:
            TabFileError: it is neither, or is missing and has no default.
        """
        if default is not None and name not in self.settings:
            return default
        entry = self.setting(name)
        if entry.value not in {"0", "1"}:
            raise self.source.error(f"{name} {shown(entry.value)}", "0 or 1", line=entry.line)
        return entry.value == "1"


def sort_keys(source: SourceText, entries: Iterable[IsgEntry]) -> Keys:
    """Sort the entries of a list.

    Raises:
        TabFileError: a repeated key, an unknown key of kw.ssfk, or no leadscrew table.
    """
    settings: dict[str, IsgEntry] = {}
    points: dict[str, dict[int, IsgEntry]] = {"setpoint": {}, "pos": {}, "neg": {}}
    single: dict[str, IsgEntry] = {}
    others: list[IsgEntry] = []
    problems: list[FileProblem] = []
    for entry in entries:
        name = entry.key.removeprefix(PREFIX)
        point = _POINT.fullmatch(name)
        earlier = entry
        if not entry.key.startswith(PREFIX):
            if entry.key in {CYCLES, *AXIS_NAMES}:
                earlier = single.setdefault(entry.key, entry)
            others.append(entry)
        elif point is not None:
            earlier = points[point[2]].setdefault(int(point[1]), entry)
        elif name in SETTINGS:
            earlier = settings.setdefault(name, entry)
        elif _RESERVED.fullmatch(name) and to_decimal(entry.value) == 0:
            earlier = single.setdefault(entry.key, entry)
        else:
            allowed = f"{', '.join(sorted(SETTINGS))}, table[i].setpoint, .pos or .neg"
            problems.append(source.problem(f"unknown key {shown(entry.key)}", allowed, line=entry.line))
        if earlier is not entry:
            found = f"{entry.key} again, after line {earlier.line}"
            problems.append(source.problem(found, "each key once", line=entry.line))
    if problems:
        raise TabFileError(*problems[:MAX_PROBLEMS])
    axis_name = next((single[key] for key in AXIS_NAMES if key in single), None)
    keys = Keys(source, settings, points, single.get(CYCLES), axis_name, tuple(others))
    _refuse_other_tables(keys)
    return keys


def _refuse_other_tables(keys: Keys) -> None:
    cross = next((entry for entry in keys.others if entry.key.startswith("kw.crosscomp")), None)
    if cross is not None and not keys.settings:
        section = ".".join(cross.key.split(".", 2)[:2])
        raise keys.source.error(
            f"a list of {section}, which corrects one axis over the position of another",
            "a leadscrew table (kw.ssfk); put a cross compensation into the 'cross' key of the axis",
            line=cross.line,
        )
