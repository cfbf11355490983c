"""A recording as a file: its configuration, and the result of replaying it."""

import tempfile
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any, Final

from gateway.config.load import load
from gateway.config.recording_header import ANY_BYTES
from gateway.exchange.events import Event
from gateway.files import open_regular_file
from gateway.recording.replay import Replay, ReplayError, ReplayResult, paced_first
from gateway.recording.traffic import (
    CAPTURED,
    FORMAT,
    WITHOUT_PEERS,
    End,
    Entry,
    Header,
    Input,
    Output,
    Port,
    WrongEntryError,
    decode,
)
from gateway.state.plan import GatewayPlan, as_started

LONGEST_LINE: Final = 64_000_000
"""A header holds all tables: more than the largest readable one."""
BEGIN: Final = b'{"kind":"'
"""Each entry begins so, also one that was cut off."""
TABLES_FOLDER: Final = "tables"


class RecordedFile:
    """A recording whose header was read; it is replayed once.

    Raises:
        ReplayError, WrongEntryError: it is not a recording.
        FileRefusedError, OSError: it cannot be read.
    """

    def __init__(self, file: Path) -> None:
        self._entries = _entries(file)
        self._first = next(self._entries, None)
        if self._first is None or not isinstance(self._first[1], Header):
            raise ReplayError("not a recording: it does not begin with a header")
        self.header = self._first[1]

    def plan(self, other: GatewayPlan | None = None) -> GatewayPlan:
        """Return the plan for the replay: that of its own configuration, or another.

        Raises:
            ReplayError, ConfigErrors: as :func:`plan_of`.
        """
        plan = plan_of(self.header) if other is None else other
        if self.header.format == WITHOUT_PEERS:
            plan = _for_any_writer(plan)
        # The axis records of a capture name the tables in force.
        return as_started(plan) if self.header.format == CAPTURED else plan

    def replay(
        self,
        plan: GatewayPlan,
        line: str | None = None,
        on_entry: Callable[[Input | Output, bool], None] | None = None,
        on_event: Callable[[str, Event], None] | None = None,
    ) -> ReplayResult:
        """Replay it through the exchange and compare the output.

        ``on_entry`` receives each entry of the line, and whether it differs.

        Raises:
            ReplayError: no such line, or nothing to compare.
            WrongEntryError, OSError: it contains other data, or cannot be read to its end.
        """
        again = Replay(plan, line, on_event)
        assert self._first is not None
        again.feed(*self._first)
        for number, entry in paced_first(self._entries):
            different = again.result.different
            is_ours = again.feed(number, entry)
            if on_entry and is_ours and not isinstance(entry, Header | End | Port):
                on_entry(entry, again.result.different > different)
        if again.result.before and not again.result.inputs:
            raise ReplayError(
                "this capture has no snapshot of an idle line, so no replay can begin: look at the frames "
                "with capture --pcapng, or raise size_mb in [capture]"
            )
        return again.result


def _entries(file: Path) -> Iterator[tuple[int, Entry]]:
    """Yield the entries of a file with their line numbers; a truncated last line is omitted."""
    with open_regular_file(file, "a recording") as lines:
        number = 0
        while data := lines.readline(LONGEST_LINE):
            number += 1
            if len(data) == LONGEST_LINE:
                raise WrongEntryError(
                    f"line {number}: more than {LONGEST_LINE} bytes, so this is not a recording"
                )
            is_cut = data[: len(BEGIN)] == BEGIN[: len(data)] or not data.strip(b"\0")  # NUL: a power cut
            if not data.endswith(b"\n") and number > 1 and is_cut:
                return
            try:
                yield number, decode(data)
            except WrongEntryError as error:
                raise WrongEntryError(f"line {number}: {error}") from None


def plan_of(header: Header) -> GatewayPlan:
    """Return the plan of the configuration in a recording, independent of the paths of its files.

    Raises:
        ReplayError: a recording of another format, or a configuration that cannot be written here.
        ConfigErrors: this release does not accept the configuration.
    """
    if header.format not in (FORMAT, CAPTURED, WITHOUT_PEERS):
        raise ReplayError(
            f"a recording of format {header.format}, made by release {header.gateway_version}: replay it "
            f"with that release; this one replays formats {WITHOUT_PEERS} to {CAPTURED}"
        )
    with tempfile.TemporaryDirectory(prefix="pitch-gateway-replay-") as name:
        folder = Path(name)
        config = folder / (Path(header.config_name).name or "gateway.toml")
        files = {PurePosixPath(TABLES_FOLDER) / n: text for n, text in header.tables.items()}
        moved = {old: f"files/{i}.toml" for i, old in enumerate(sorted(header.files))}
        files |= {PurePosixPath(new): header.files[old] for old, new in moved.items()}
        for file, content in files.items():
            path = folder / file.parent / file.name
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(content.encode(ANY_BYTES))
        (folder / TABLES_FOLDER).mkdir(exist_ok=True)
        config.write_bytes(_portable(header.config, moved).encode("utf-8"))
        return load(config, is_elsewhere=True).plan


def _for_any_writer(plan: GatewayPlan) -> GatewayPlan:
    """Return the plan for a recording without hosts: as then, every host may move every axis."""
    lines = (
        replace(line, axes=tuple(replace(axis, has_one_writer=False) for axis in line.axes))
        for line in plan.lines
    )
    return replace(plan, lines=tuple(lines))


def _plain(text: str) -> str:
    return text.removeprefix("\ufeff").replace("\r\n", "\n")


def _portable(text: str, moved: dict[str, str]) -> str:
    """Return a configuration with its files renamed to those beside it."""
    before: dict[str, Any] = tomllib.loads(_plain(text))
    expected: dict[str, Any] = tomllib.loads(_plain(text))
    tables = before.get("gateway", {}).get("tables", TABLES_FOLDER)
    changes = {**moved, tables: TABLES_FOLDER}
    if tables != TABLES_FOLDER:
        expected["gateway"]["tables"] = TABLES_FOLDER
    for axis in expected.get("axis", {}).values():
        axis["drive"] = moved.get(axis["drive"], axis["drive"]) if "drive" in axis else None
        if axis["drive"] is None:
            del axis["drive"]
    changed = _plain(text)
    for old, new in changes.items():
        changed = changed.replace(f'"{old}"', f'"{new}"').replace(f"'{old}'", f'"{new}"')
    if tomllib.loads(changed) != expected:
        raise ReplayError(
            f"give the configuration with --config: its files cannot be written here (tables = {tables!r})"
        )
    return changed
