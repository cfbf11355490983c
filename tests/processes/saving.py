"""How programs save a file over an older one: each leaves the same content, and other traces on the way."""

import shutil
from pathlib import Path


def in_place(table: Path, content: str) -> None:
    """As ``cat > file`` and many editors do."""
    table.write_text(content)


def renamed_over(table: Path, content: str) -> None:
    """As rsync, vim and careful programs do."""
    beside = table.with_name(f".{table.name}.new")
    beside.write_text(content)
    beside.replace(table)


def old_moved_away(table: Path, content: str) -> None:
    """As editors do that keep a backup."""
    table.replace(table.with_name(f"{table.name}~"))
    table.write_text(content)


def removed_first(table: Path, content: str) -> None:
    """As some network clients do."""
    table.unlink()
    table.write_text(content)


def symlink_swapped(table: Path, content: str) -> None:
    """As Kubernetes does with what it mounts: the folder behind the link changes."""
    folder = table.parent
    numbers = [int(path.name[2:]) for path in folder.glob("..[0-9]*")]
    version = folder / f"..{max(numbers, default=0) + 1}"
    version.mkdir()
    (version / table.name).write_text(content)
    link = folder / "..next"
    link.symlink_to(version.name)
    link.replace(folder / "..data")
    if not table.is_symlink():
        table.unlink()
        table.symlink_to(f"..data/{table.name}")
    for number in numbers:
        shutil.rmtree(folder / f"..{number}")


STYLES = [in_place, renamed_over, old_moved_away, removed_first, symlink_swapped]
