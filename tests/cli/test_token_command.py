"""``pitch-gateway token``: a random token for this user only, and never over another one by mistake."""

import stat
from pathlib import Path

from gateway.config.files import read_token
from tests.support.commands import typed


def test_a_token_that_the_gateway_takes_and_nobody_else_reads(tmp_path: Path) -> None:
    file = tmp_path / "people.token"
    done = typed("token", str(file))
    assert (done.returncode, done.stdout, done.stderr) == (0, f"{file}: new token written\n", "")
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    found = read_token(("x",), "people.token", tmp_path)
    assert len(found) == 43
    assert found not in done.stdout
    assert [path.name for path in tmp_path.iterdir()] == ["people.token"]


def test_a_file_that_exists_stays_without_force(tmp_path: Path) -> None:
    file = tmp_path / "people.token"
    file.write_text("mine\n")
    done = typed("token", str(file))
    assert (done.returncode, done.stderr) == (1, f"{file}: exists already; --force replaces its token\n")
    assert file.read_text() == "mine\n"
    file.chmod(0o640)
    assert typed("token", str(file), "--force").returncode == 0
    assert read_token(("x",), "people.token", tmp_path) != "mine"
    assert stat.S_IMODE(file.stat().st_mode) == 0o640  # of a group, as it was
    file.chmod(0o644)
    assert typed("token", str(file), "--force").returncode == 0
    assert stat.S_IMODE(file.stat().st_mode) == 0o640  # others never


def test_where_nothing_can_be_written_it_says_so(tmp_path: Path) -> None:
    for file in (tmp_path / "none" / "a.token", tmp_path):
        for more in ([], ["--force"]):
            done = typed("token", str(file), *more)
            assert done.returncode == 1
            assert done.stderr.startswith(f"{file}: ")
            if file != tmp_path:
                assert f"(folder {tmp_path}/none: No such file or directory)" in done.stderr
    assert list(tmp_path.iterdir()) == []
