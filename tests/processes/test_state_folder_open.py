"""A state folder that others may write to is said at the start."""

from pathlib import Path

import pytest

from tests.support.gateway import site_in
from tests.support.processes import running


@pytest.mark.parametrize("mode", [0o700, 0o777])
def test_a_relay_warns_of_a_folder_that_every_user_may_write_to(tmp_path: Path, mode: int) -> None:
    with site_in(tmp_path) as site:
        site.compile()
        state = site.socket.parent
        state.chmod(mode)
        with running("relay", str(site.config)) as relay:
            relay.until("ready")
            assert relay.end() == 0
    said = [note for note in relay.notes if note["event"] == "state-folder-open"]
    if mode == 0o700:
        assert said == []
        return
    [note] = said
    assert (note["level"], note["detail"]) == ("warning", f"every user may write to {state} (mode 0777)")
    assert note["remedy"] == f"who can write there can command axes: chmod o-w {state}"
