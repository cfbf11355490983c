"""A table that is being edited: its points, what its file would say, the way back, and the file itself.

Each state is written as text by the writer of the format, and read back as the gateway reads the file. So the
page shows what the file would hold, with every remark about it.
"""

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import count, zip_longest
from math import inf, isclose, isfinite
from pathlib import Path
from typing import Final

from msgspec import Struct

from gateway.commissioning.refining import as_old, letter_for
from gateway.commissioning.table_options import ReadOptions
from gateway.compensation.errors import TableError
from gateway.compensation.table import CorrectionTable, make_table
from gateway.config.signatures import sign_command, signature_path
from gateway.files import FileRefusedError, write_file
from gateway.report.words import scale_of, shortest
from gateway.tabfile import (
    FileContext,
    FileProblem,
    Lint,
    LoadedTable,
    TabFileError,
    WriteOptions,
    Written,
    dialect_named,
    parse_table,
)
from gateway.tabfile.checks import largest_difference
from gateway.tabfile.conversion import DECIMALS, is_modulo, rows_of, write, write_text
from gateway.tabfile.decoded import BRANCHES, line_of
from gateway.tabfile.load import read_bytes
from gateway.tabfile.text import SHOWN_CHARACTERS, decode

MOST_POINTS: Final = 1000
"""A grid of more points is no help to a person."""
SHOWN_DECIMALS: Final = 3
"""Of a small unit: nanometres. Inches with 8 decimals are no multiples of less."""
SAME_PLACE: Final = 1e-6
"""Of a unit: the digits of positions in the coarsest format."""
SHOWN_LINES: Final = 5
CONVERT: Final = "pitch-gateway table convert"
OWN_OPTIONS: Final = {
    "--to-axis": "--axis",
    "--to-file-axis": "--file-axis",
    "--to-counts-per-unit": "--file-counts-per-unit",
    "--to-sense": "--error-sense",
}
"""Names here for the options of ``table convert`` that the remedies of writers name."""
_NUMBER: Final = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


class EditError(Exception):
    """What was asked for is not done; the text says why, and what to do."""


class Draft(Struct, frozen=True):
    """A state of the table, and what is read of its file."""

    table: CorrectionTable
    written: Written | None = None
    loaded: LoadedTable | None = None
    problem: str = ""
    """Why there is no such file; empty: there is."""

    @property
    def refusals(self) -> list[str]:
        """Why it must not be saved."""
        errors = () if self.loaded is None else self.loaded.errors
        return [*filter(None, [self.problem]), *(f"{lint.code}: {lint.message}" for lint in errors)]


class Curves(Struct, frozen=True):
    """Corrections in the small unit."""

    forward: Sequence[float]
    backward: Sequence[float]


class Remark(Struct, frozen=True):
    """A lint, and the value on its line: a point, and ``forward`` or ``backward``."""

    code: str
    severity: str
    message: str
    point: int | None = None
    way: str = ""


class State(Struct, frozen=True, kw_only=True):
    """What the page shows; it gets this as JSON."""

    file: str
    folder: str
    format: str
    axis: str
    unit: str
    """Of positions."""
    small: str
    """Unit of corrections: µm, or arcsec."""
    one_way: bool
    """The format has one correction for both directions."""
    together: bool
    """Both directions are the same in the file: one changes with the other, unless a person says no."""
    positions: Sequence[str]
    places: Sequence[float]
    before: Curves
    now: Curves
    remarks: Sequence[Remark]
    refusals: Sequence[str]
    """Why it cannot be saved."""
    notes: Sequence[str]
    """What saving changes beside the values."""
    can_undo: bool
    can_redo: bool
    is_changed: bool
    said: str = ""
    """What has been done, or why it has not."""


class Editing:
    """One file while it is edited.

    ``context`` is that of its reader, ``source`` the options behind it.

    Raises:
        TabFileError: the file cannot be read, or not be written again as what it is.
    """

    def __init__(self, file: Path, context: FileContext, source: ReadOptions) -> None:
        self.file = file
        self._context = context
        self._on_disk = read_bytes(file)
        loaded = parse_table(self._on_disk, str(file), context)
        self._dialect = dialect_named(loaded.format)
        self._check_kind(loaded)
        asked = WriteOptions(letter_for(loaded, source.axis, file), is_modulo=is_modulo(loaded, loaded.table))
        self._writing = as_old(asked, loaded, self._dialect, source)
        self._modulo = loaded.source.modulo
        self._scale = scale_of(loaded.table.units)
        self._history = [loaded.table]
        self._at = 0
        self._opened = loaded
        self._saved = loaded.table
        self._backup: Path | None = None
        self._draft = self._draft_of(loaded.table)
        self._notes = tuple(self._opening_notes(self._draft))

    def _check_kind(self, loaded: LoadedTable) -> None:
        """Check that a file of this kind can be edited.

        Raises:
            TabFileError: it cannot be written, has too many points, or holds tables of other axes.
        """
        file, convert = self.file, f"{CONVERT} {self.file.name} {self.file.stem}-edit.csv --to csv"
        name, count_of_points = self._dialect.name, len(loaded.table.positions)
        if not self._dialect.is_writable:
            raise _refusal(file, f"format {name}, which is read, not written", f"a copy to edit: {convert}")
        if self._dialect.moves_points:
            found = f"format {name}, whose points move with their values"
            raise _refusal(file, found, f"a copy to edit: {convert}")
        if count_of_points > MOST_POINTS:
            allowed = f"at most {MOST_POINTS}: {convert} --resample STEP"
            raise _refusal(file, f"{count_of_points} points", allowed)
        if (axis := self._context.file_axis) is None:
            return
        try:
            parse_table(self._on_disk, str(file), replace(self._context, file_axis=None))
        except TabFileError:
            found = "tables of several axes, of which saving would keep only one"
            raise _refusal(file, found, f"a copy of this one to edit: {convert} --file-axis {axis}") from None

    def _opening_notes(self, draft: Draft) -> Iterator[str]:
        """Yield what saving changes besides the edited values.

        Raises:
            TabFileError: the writer of the format makes no such file.
        """
        opened = self._opened.table
        if draft.loaded is None or draft.written is None:
            raise _refusal(self.file, f"a table that could not be saved as it is: {draft.problem}", "")
        difference, at = largest_difference(rows_of(opened), rows_of(draft.loaded.table))
        if difference:
            size = f"{difference:.3g} {opened.units.value}"
            yield f"corrections change by up to {size} (at {at:g}) in the digits of the format"
        lost = list(self._lost_lines(draft.written.text))
        if lost:
            shown = "; ".join(lost[:SHOWN_LINES]) + ("; …" if len(lost) > SHOWN_LINES else "")
            yield f"{len(lost)} lines are written in other words or left out: {shown}"
        yield from draft.written.losses

    def _lost_lines(self, text: str) -> Iterator[str]:
        """Yield the lines of the file, with their numbers, whose words are not in the new text."""
        kept = {_words_of(line) for line in text.splitlines()}
        for line in decode(self._on_disk, self.file.name).lines:
            if line.text and _words_of(line.text) not in kept:
                yield f"line {line.number}: {line.text[:SHOWN_CHARACTERS]}"

    # --- What the page shows

    def state(self, draft: Draft | None = None) -> State:
        """Return what the page shows."""
        draft = draft or self._draft
        opened = self._opened.table
        is_one_way = self._dialect.directions == 1
        return State(
            file=self.file.name,
            folder=str(self.file.absolute().parent),
            format=self._dialect.name,
            axis=self._writing.axis or "",
            unit=self._scale.position,
            small=self._scale.deviation,
            one_way=is_one_way,
            together=is_one_way or opened.is_unidirectional,
            positions=[shortest(position) for position in opened.positions],
            places=list(opened.positions),
            before=self._shown(opened),
            now=self._shown(draft.table if draft.loaded is None else draft.loaded.table),
            remarks=[
                _remark(lint, loaded) for loaded in filter(None, [draft.loaded]) for lint in loaded.lints
            ],
            refusals=draft.refusals,
            notes=self._notes,
            can_undo=self._at > 0,
            can_redo=self._at + 1 < len(self._history),
            is_changed=self.is_changed,
        )

    @property
    def is_changed(self) -> bool:
        """Whether there is something to save."""
        return self._history[self._at] is not self._saved

    def conclusion(self) -> str:
        """Say what has become of the file, for the end."""
        if self.is_changed:
            return f"{self.file}: changes that were not saved are dropped"
        return (
            f"{self.file}: {f'saved; the old file is {self._backup.name}' if self._backup else 'not changed'}"
        )

    def _shown(self, table: CorrectionTable) -> Curves:
        forward, backward = (
            [round(self._scale.of(each), SHOWN_DECIMALS) + 0.0 for each in curve]
            for curve in (table.forward, table.backward)
        )
        return Curves(forward, backward)

    # --- What a person does

    def change(self, index: int, way: str, value: float, *, together: bool, is_kept: bool = True) -> State:
        """Give a point another correction; ``value`` is in the small unit. Return the new state.

        ``together``: the other direction changes by as much. A drag that goes on is not kept.

        Raises:
            EditError: there is no such point, or no table with this value.
        """
        table = self._history[self._at]
        if not 0 <= index < len(table.positions) or not isfinite(value):
            raise EditError(f"there is no point {index} with a value of {value}")
        curves = {"forward": list(table.forward), "backward": list(table.backward)}
        change = value / self._scale.factor - curves[way][index]
        last = len(table.positions) - 1
        # The ends of a table that repeats are one place.
        indices = {0, last} if self._modulo is not None and index in (0, last) else {index}
        both = together or self._dialect.directions == 1
        for curve in curves.values() if both else (curves[way],):
            for each in indices:
                curve[each] = round(curve[each] + change, DECIMALS) + 0.0
        try:
            changed = make_table(table.positions, curves["forward"], curves["backward"], table.units)
        except TableError as error:
            raise EditError(f"not changed: {error}; type a value of the size of the others") from None
        draft = self._draft_of(changed)
        if is_kept:
            self._history[self._at + 1 :] = [changed]
            self._at += 1
            self._draft = draft
        return self.state(draft)

    def go(self, steps: int) -> State:
        """Undo (-1) or redo (+1) a change; at the end of the history do nothing. Return the new state."""
        self._at = min(max(self._at + steps, 0), len(self._history) - 1)
        self._draft = self._draft_of(self._history[self._at])
        return self.state()

    def save(self) -> str:
        """Write the file, and before the first time the old one beside it; say so.

        Raises:
            EditError: the gateway would refuse the table, another program changed the file, or it cannot be
                written.
        """
        written = self._savable()
        try:
            now: bytes | None = read_bytes(self.file)
        except TabFileError:
            now = None
        if now != self._on_disk:
            what = "is no longer there" if now is None else "was changed by another program"
            raise EditError(
                f"not saved: {self.file.name} {what} since this page read it. Save a copy, compare it with "
                "the file, and start table edit again"
            )
        if self._backup is None:
            self._backup = self._put_beside(".bak", self._on_disk)
        try:
            write(self.file, written.text, force=True, encoding=written.encoding)
        except TabFileError as error:
            raise EditError(f"not saved: {error}") from None
        self._on_disk = written.text.encode(written.encoding)
        self._saved = self._history[self._at]
        saved = f"{self.file.name} is saved; the file as it was is in {self._backup.name}"
        if not signature_path(self.file).exists():
            return saved
        return f"{saved}. Its signature was for that one: sign it again: {sign_command(self.file)}"

    def save_copy(self) -> str:
        """Write what is shown beside the file, under a new name; say so.

        Raises:
            EditError: the gateway would refuse the table, or it cannot be written.
        """
        written = self._savable()
        path = self._put_beside(".edited.bak", written.text.encode(written.encoding))
        return f"the edited table is in {path.name}; {self.file.name} is as it was"

    def _savable(self) -> Written:
        refusals = self._draft.refusals
        if refusals or self._draft.written is None:
            raise EditError(f"not saved: {'; '.join(refusals)}")
        return self._draft.written

    def _put_beside(self, ending: str, content: bytes) -> Path:
        """Write a file beside that of the table, under the first free name.

        Raises:
            EditError: it cannot be written.
        """
        for number in count(1):
            path = self.file.with_name(f"{self.file.name}{'' if number == 1 else f'.{number}'}{ending}")
            try:
                with suppress(FileExistsError):
                    write_file(path, content, force=False)
                    return path
            except (OSError, FileRefusedError) as error:
                raise EditError(f"not saved: {path.name} cannot be written ({error})") from None
        raise AssertionError("numbers do not end")

    def _draft_of(self, table: CorrectionTable) -> Draft:
        """Write a table as text, and read it as the gateway reads the file."""
        try:
            written = write_text(table, self._dialect, self._writing)
            loaded = parse_table(written.text.encode(), str(self.file), self._context)
        except (TabFileError, TableError) as error:
            problem = str(error) if isinstance(error, TableError) else _in_words(error)
            return Draft(table, problem=problem)
        points = zip_longest(table.positions, loaded.table.positions, fillvalue=inf)
        if not all(isclose(one, other, rel_tol=1e-9, abs_tol=SAME_PLACE) for one, other in points):
            return Draft(
                table, problem="its reader would find other points in the file: state more facts about it"
            )
        return Draft(table, written, loaded)


def _remark(lint: Lint, loaded: LoadedTable) -> Remark:
    places = [
        (index, way)
        for index, row in enumerate(loaded.source.rows if lint.line else ())
        for way in BRANCHES
        if line_of(row, way) == lint.line
    ]
    # Some formats have more points than one on a line.
    index, way = places[0] if len({index for index, _ in places}) == 1 else (None, "")
    return Remark(lint.code, lint.severity.value, lint.message, index, way)


def _refusal(file: Path, found: str, allowed: str) -> TabFileError:
    return TabFileError(FileProblem(str(file), found, allowed))


def _in_words(error: TabFileError) -> str:
    """Return an error without the name of a file, and with the options of this command."""
    text = f"{error.found}; allowed: {error.allowed}" if error.allowed else error.found
    for option, own in OWN_OPTIONS.items():
        text = text.replace(option, own)
    return text


def _words_of(line: str) -> str:
    """Return a line without blanks, and with any number as 0.

    >>> _words_of("  +0.50  -1e-3 ; mm")
    '00;mm'
    """
    return "".join(_NUMBER.sub("0", line).split())
