"""The configuration that a recording holds."""

import tempfile
import tomllib
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from gateway.config.recording_header import ANY_BYTES
from gateway.recording.replay import ReplayError
from gateway.recording.traffic import CAPTURED, FORMAT, WITHOUT_PEERS, Header

if TYPE_CHECKING:
    from gateway.state.plan import GatewayPlan

TABLES_FOLDER = "tables"


def plan_of(header: Header) -> "GatewayPlan":
    """Return the plan of the configuration in a recording, wherever its files were.

    Raises:
        ReplayError: a recording of another format, or a configuration that cannot be laid out here.
        ConfigErrors: this release does not accept the configuration.
    """
    from gateway.config.load import load

    if header.format not in (FORMAT, CAPTURED, WITHOUT_PEERS):
        raise ReplayError(
            f"a recording of format {header.format}, made by release {header.gateway_version}; "
            f"this release replays formats {WITHOUT_PEERS} to {CAPTURED}"
        )
    with tempfile.TemporaryDirectory(prefix="pitch-gateway-replay-") as name:
        folder = Path(name)
        config = folder / (Path(header.config_name).name or "gateway.toml")
        files = {PurePosixPath(TABLES_FOLDER) / n: text for n, text in header.tables.items()}
        moved = {old: f"files/{i}.toml" for i, old in enumerate(sorted(header.files))}
        files |= {PurePosixPath(new): header.files[old] for old, new in moved.items()}
        for place, content in files.items():
            path = folder / place.parent / place.name
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(content.encode(ANY_BYTES))
        (folder / TABLES_FOLDER).mkdir(exist_ok=True)
        config.write_bytes(_portable(header.config, moved).encode("utf-8"))
        return load(config, is_elsewhere=True).plan


def for_any_writer(plan: "GatewayPlan") -> "GatewayPlan":
    """Return the plan of a recording that knows no hosts: as then, everybody may move every axis."""
    lines = (
        replace(line, axes=tuple(replace(axis, has_one_writer=False) for axis in line.axes))
        for line in plan.lines
    )
    return replace(plan, lines=tuple(lines))


def _plain(text: str) -> str:
    return text.removeprefix("\ufeff").replace("\r\n", "\n")


def _portable(text: str, moved: dict[str, str]) -> str:
    """Return a configuration with its files under the names that they have beside it now."""
    before: dict[str, Any] = tomllib.loads(_plain(text))
    wanted: dict[str, Any] = tomllib.loads(_plain(text))
    tables = before.get("gateway", {}).get("tables", TABLES_FOLDER)
    changes = {**moved, tables: TABLES_FOLDER}
    if tables != TABLES_FOLDER:
        wanted["gateway"]["tables"] = TABLES_FOLDER
    for axis in wanted.get("axis", {}).values():
        axis["drive"] = moved.get(axis["drive"], axis["drive"]) if "drive" in axis else None
        if axis["drive"] is None:
            del axis["drive"]
    changed = _plain(text)
    for old, new in changes.items():
        changed = changed.replace(f'"{old}"', f'"{new}"').replace(f"'{old}'", f'"{new}"')
    if tomllib.loads(changed) != wanted:
        raise ReplayError(
            f"the files of its configuration cannot be laid out here (tables = {tables!r}); "
            "give the configuration with --config"
        )
    return changed
