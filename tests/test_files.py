"""Files that a person named, written whole or not at all."""

import os
import stat
from pathlib import Path

import pytest

from gateway.files import FileRefusedError, write_file


def _mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_a_new_file_has_the_mode_that_the_mask_leaves(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_file(tmp_path / "new", b"one", force=False)
    finally:
        os.umask(before)
    assert (tmp_path / "new").read_bytes() == b"one"
    assert _mode(tmp_path / "new") == 0o640


@pytest.mark.parametrize("force", [False, True])
def test_a_new_secret_is_for_its_owner_alone(force: bool, tmp_path: Path) -> None:
    write_file(tmp_path / "token", b"one", force=force, is_secret=True)
    assert _mode(tmp_path / "token") == 0o600


@pytest.mark.parametrize(("is_secret", "mode"), [(False, 0o664), (True, 0o640)])
def test_a_replaced_file_keeps_its_mode_and_a_secret_no_more_than_its_group(
    is_secret: bool, mode: int, tmp_path: Path
) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"old")
    path.chmod(0o664)
    write_file(path, b"new", force=True, is_secret=is_secret)
    assert path.read_bytes() == b"new"
    assert _mode(path) == mode
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_a_replaced_file_keeps_its_owner(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"old")
    os.chown(path, 1234, 4321)
    write_file(path, b"new", force=True)
    assert (path.stat().st_uid, path.stat().st_gid) == (1234, 4321)


def test_an_existing_file_is_replaced_only_with_force(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"old")
    with pytest.raises(FileExistsError):
        write_file(path, b"new", force=False)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_link_is_followed_with_force_and_stands_in_the_way_without(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    target, link = tmp_path / "there" / "file", tmp_path / "link"
    target.write_bytes(b"old")
    link.symlink_to(target)
    with pytest.raises(FileExistsError):
        write_file(link, b"new", force=False)
    write_file(link, b"new", force=True)
    assert link.is_symlink()
    assert target.read_bytes() == b"new"


def test_what_is_no_file_is_not_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo")
    with pytest.raises(FileRefusedError, match="a FIFO; give a regular file, or a new name"):
        write_file(tmp_path / "fifo", b"new", force=True)
    with pytest.raises(FileRefusedError, match="a folder"):
        write_file(tmp_path, b"new", force=True)
    assert stat.S_ISFIFO((tmp_path / "fifo").stat().st_mode)


def test_without_a_folder_nothing_is_written(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        write_file(tmp_path / "none" / "file", b"new", force=True)


@pytest.mark.parametrize("path", ["/", ".", ""])
@pytest.mark.parametrize("force", [False, True])
def test_a_path_without_a_name_is_refused(path: str, force: bool) -> None:
    with pytest.raises(FileRefusedError, match="a folder; give"):
        write_file(Path(path), b"new", force=force)
