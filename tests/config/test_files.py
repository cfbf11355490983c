"""Who may read secrets and write files: named with the mode and the command that closes them."""

from pathlib import Path

import pytest

from gateway.config.problems import Problem
from gateway.files import FileRefusedError
from gateway.secret_files import CREDENTIALS_FOLDER, refuse_open_to_others, secret_path
from tests.config.config_bench import GOOD, line_of, loaded


def opened(folder: Path, name: str, mode: int) -> list[Problem]:
    """Return the warnings of a good configuration once a file or folder of it has this mode."""
    assert loaded(folder).warnings == ()
    (folder / name).chmod(mode)
    return [each for each in loaded(folder).warnings if "every user may write" in each.found]


@pytest.mark.parametrize(
    ("name", "mode", "key"),
    [
        ("gateway.toml", 0o666, ""),
        (".", 0o777, ""),
        ("tables", 0o757, "gateway.tables"),
        ("tables/cnc10x.tab", 0o646, "axis.x.table"),
    ],
)
def test_what_everybody_may_write_is_named_with_its_mode(
    tmp_path: Path, name: str, mode: int, key: str
) -> None:
    [warning] = opened(tmp_path, name, mode)
    path = tmp_path / name
    assert (warning.key, warning.found) == (key, f"every user may write to {path} (mode {mode:04o})")
    assert warning.remedy == f"who can write there can command axes: chmod o-w {path}"
    if key == "axis.x.table":
        assert warning.line == line_of(GOOD, "table =")


@pytest.mark.parametrize("mode", [0o644, 0o664, 0o600])
def test_what_its_owner_and_group_may_write_is_not_warned_of(tmp_path: Path, mode: int) -> None:
    assert opened(tmp_path, "tables/cnc10x.tab", mode) == []


def test_in_a_folder_as_tmp_nobody_may_replace_the_files_of_another(tmp_path: Path) -> None:
    assert opened(tmp_path, ".", 0o1777) == []


def test_a_drive_profile_of_ones_own_is_looked_at_too(tmp_path: Path) -> None:
    text = GOOD[: GOOD.index("[axis.x.registers]")].replace("units =", 'drive = "./mine.toml"\nunits =')
    registers = GOOD[GOOD.index("[axis.x.registers]") :].replace("axis.x.registers", "registers")
    profile = tmp_path / "mine.toml"
    profile.write_text('title = "A drive"\n' + registers)
    profile.chmod(0o666)
    [warning] = [each for each in loaded(tmp_path, text).warnings if "every user" in each.found]
    assert (warning.key, str(profile) in warning.found) == ("axis.x.drive", True)


# Where secrets are, and who else may read them.


def test_a_path_is_relative_to_the_configuration() -> None:
    assert secret_path("http.token", Path("/etc/pitch-gateway")) == Path("/etc/pitch-gateway/http.token")
    assert secret_path("/run/token", Path("/etc/pitch-gateway")) == Path("/run/token")


def test_a_credential_is_in_the_folder_that_the_service_manager_names(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(CREDENTIALS_FOLDER, str(tmp_path))
    assert secret_path("credential:http.token", Path("/etc")) == tmp_path / "http.token"


@pytest.mark.parametrize("name", ["", ".", "..", "../key", "folder/key", "/etc/shadow"])
def test_a_credential_leads_nowhere_else(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(CREDENTIALS_FOLDER, str(tmp_path))
    with pytest.raises(FileRefusedError, match="is no name of a credential"):
        secret_path(f"credential:{name}", tmp_path)


def test_without_a_service_manager_it_is_said_how_to_get_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(CREDENTIALS_FOLDER, raising=False)
    with pytest.raises(FileRefusedError, match=r"LoadCredential=http\.token:PATH"):
        secret_path("credential:http.token", Path("/etc"))


@pytest.mark.parametrize(
    ("mode", "taken"), [(0o600, ""), (0o640, ""), (0o604, "r"), (0o602, "w"), (0o606, "rw")]
)
def test_what_every_user_may_read_or_write_is_refused(mode: int, taken: str, tmp_path: Path) -> None:
    path = tmp_path / "key"
    path.touch()
    path.chmod(mode)
    if not taken:
        refuse_open_to_others(path)
        return
    with pytest.raises(FileRefusedError, match=rf"mode {mode:04o}\); chmod o-{taken} {path}"):
        refuse_open_to_others(path)
