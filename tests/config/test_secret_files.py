"""Where secrets are, and who else may read them."""

from pathlib import Path

import pytest

from gateway.files import FileRefusedError
from gateway.secret_files import CREDENTIALS_FOLDER, refuse_open_to_others, secret_path


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
