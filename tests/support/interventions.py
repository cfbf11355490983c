"""A journal of interventions in a folder: written, read and verified."""

from collections import deque
from pathlib import Path
from typing import Any

from gateway.state.interventions import (
    FILE_BYTES,
    MOST_BYTES,
    Entry,
    Intervention,
    Verification,
    Writer,
    files_in,
    head_in,
)


def switched(axis: str, **more: Any) -> Intervention:
    return Intervention("compensation", "socket", axis, before="off", after="on", **more)


def written(
    folder: Path, *items: Intervention, file_bytes: int = FILE_BYTES, most_bytes: int = MOST_BYTES
) -> Path:
    Writer(folder, file_bytes, most_bytes).write(deque(items))
    return folder


def verified(folder: Path, since: str | None = None) -> tuple[Verification, list[Entry]]:
    verification = Verification(head_in(folder), since)
    entries = list(verification.read(files_in(folder)))
    verification.finish()
    return verification, entries


def problems(folder: Path) -> list[str]:
    return verified(folder)[0].problems


def only_file(folder: Path) -> Path:
    [path] = files_in(folder)
    return path
