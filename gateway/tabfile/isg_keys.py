"""The keys of a leadscrew table in a list of the ISG kernel: which there are, each once, and their values."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from gateway.tabfile.errors import Problem, TabFileError
from gateway.tabfile.fields import DECIMAL_ALLOWED, INTEGER_ALLOWED, to_decimal, to_integer
from gateway.tabfile.isg_list import MAX_PROBLEMS, Entry
from gateway.tabfile.text import SourceText, shown

NAME: Final = "isg"
PER_UNIT: Final = 1e4
"""Numbers of unit 1 in one mm or degree."""
DEFAULT_MAX_POINTS: Final = 1500
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
"""Room for later settings in older lists; anything but 0 in it would be a setting unknown here."""
_POINT: Final = re.compile(r"table\[(0|[1-9][0-9]{0,5})\]\.(setpoint|pos|neg)")


@dataclass(frozen=True, slots=True)
class Keys:
    """The entries of one table, checked for repetitions and unknown keys."""

    source: SourceText
    settings: dict[str, Entry]
    points: dict[str, dict[int, Entry]]
    """Entries by field (setpoint, pos, neg) and index."""
    cycles: Entry | None
    axis_name: Entry | None
    others: tuple[Entry, ...]
    """What does not begin with kw.ssfk."""

    def setting(self, name: str) -> Entry:
        """Return a setting.

        Raises:
            TabFileError: it is not in the list.
        """
        entry = self.settings.get(name)
        if entry is None:
            raise self.source.error(
                f"no {PREFIX}{name}", f"a line '{PREFIX}{name} NUMBER'", line=self.source.last_line
            )
        return entry

    def number(self, entry: Entry) -> float:
        """Return the number of an entry.

        Raises:
            TabFileError: it is none.
        """
        number = to_decimal(entry.value)
        if number is None:
            raise self.source.error(f"{entry.key} {shown(entry.value)}", DECIMAL_ALLOWED, line=entry.line)
        return number

    def count(self, name: str, default: int | None = None) -> int:
        """Return a setting that is a number of points, at least 2.

        Raises:
            TabFileError: it is no such number, or not there and without a default.
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
            TabFileError: it is neither, or not there and without a default.
        """
        if default is not None and name not in self.settings:
            return default
        entry = self.setting(name)
        if entry.value not in {"0", "1"}:
            raise self.source.error(f"{name} {shown(entry.value)}", "0 or 1", line=entry.line)
        return entry.value == "1"


def sort_keys(source: SourceText, entries: Iterable[Entry]) -> Keys:
    """Sort the entries of a list.

    Raises:
        TabFileError: a key that stands there twice, an unknown one of kw.ssfk, or no leadscrew table at all.
    """
    settings: dict[str, Entry] = {}
    points: dict[str, dict[int, Entry]] = {"setpoint": {}, "pos": {}, "neg": {}}
    single: dict[str, Entry] = {}
    others: list[Entry] = []
    problems: list[Problem] = []
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
            f"a list of {section}, which corrects one axis by the position of another",
            "a leadscrew table (kw.ssfk) here; a cross compensation belongs into the 'cross' key of the axis",
            line=cross.line,
        )
