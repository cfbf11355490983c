"""What the system says about a folder, and what to do then."""

import errno
import os
from pathlib import Path

import pytest

from gateway.state.folder import problem_of, why_open_to_others


@pytest.mark.parametrize(
    ("number", "remedy"),
    [
        (errno.ENOSPC, "free space on its disk, or "),
        (errno.EDQUOT, "free space: this user may have no more on its disk, or "),
        (errno.EROFS, "mount its disk read-write, or "),
        (errno.ENOTDIR, "a file is where a folder should be: move it away, or "),
        (errno.EEXIST, "a file is where a folder should be: move it away, or "),
        (errno.ENOENT, "make the folder that the path or its link leads to, or "),
        (errno.EACCES, "give this user write permission to the folder, or "),
        (errno.EIO, ""),
    ],
)
def test_the_remedy_is_that_of_the_error(number: int, remedy: str) -> None:
    problem = problem_of(OSError(number, os.strerror(number), "/run/x/relay.lock"), Path("/run/x"))
    assert problem.found == f"/run/x/relay.lock: {os.strerror(number)}"
    assert problem.remedy == f"{remedy}choose another folder with [gateway] state"


def test_a_folder_of_somebody_else_is_open_to_them(tmp_path: Path) -> None:
    own = os.geteuid()
    assert why_open_to_others(tmp_path, frozenset((own,))) is None
    other = why_open_to_others(tmp_path, frozenset((own + 1,)))
    assert other is not None
    assert other.found == f"{tmp_path} belongs to user {own}, and this is user {own}"
    assert why_open_to_others(tmp_path, None) is None
    assert why_open_to_others(tmp_path / "none", frozenset()) is None
