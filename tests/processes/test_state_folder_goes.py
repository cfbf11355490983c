"""A state folder that goes while the gateway runs: no move is lost, log and status say it, and it passes."""

import os
import shutil

import pytest

from tests.processes.test_full_disk import Status
from tests.support.gateway import Site
from tests.support.processes import running


@pytest.mark.parametrize("how", ["taken away", "closed"])
def test_a_state_folder_that_cannot_be_used_is_told_and_costs_no_move(site: Site, how: str) -> None:
    if how == "closed" and os.geteuid() == 0:
        pytest.skip("root may write everywhere")
    state = site.socket.parent
    address = site.serve_page()
    with running("run", str(site.config)) as gateway:
        gateway.until_each("line-up", "relay-reached", "http-ready")
        master, status = site.master(), Status(address)
        assert master.move(50_000) == 50_050
        if how == "closed":
            state.chmod(0o500)
        else:
            state.rename(state.with_name("elsewhere"))
        told = gateway.until("state-folder-unusable")
        assert told["detail"].startswith(str(state))
        model = status.until(told["detail"], of="state_folder")
        assert "state folder" in [trouble["where"] for trouble in model["troubles"]]
        assert master.move(60_000) == 60_060
        if how == "closed":
            state.chmod(0o700)
        else:
            shutil.rmtree(state, ignore_errors=True)  # the supervisor may have made another one
            state.with_name("elsewhere").rename(state)
        gateway.until("state-folder-usable")
        status.until(None, of="state_folder")
        master.close()
        assert gateway.end() == 0
