"""A socket that somebody else holds: nothing is said to it."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from tests.support.processes import started

ROOT = Path(__file__).parents[2]
HOLDER = """
import os, socket, sys
os.setuid(65533)
held = socket.socket(socket.AF_UNIX)
held.bind(sys.argv[1])
os.chmod(sys.argv[1], 0o777)
held.listen()
print("ready", flush=True)
print(held.accept()[0].recv(1000), flush=True)
"""
CLIENT = """
import os, sys
from pathlib import Path
from gateway.ipc.client import NoGatewayError, ask
from gateway.ipc.messages import Ping
os.setuid(65534)
try:
    ask(Path(sys.argv[1]), Ping())
except NoGatewayError as error:
    print(error)
"""


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be two other users")
def test_a_socket_of_another_user_is_told_nothing() -> None:
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o777)
        path = f"{folder}/relay.sock"
        with started([sys.executable, "-c", HOLDER, path], stdout=subprocess.PIPE, text=True) as holder:
            assert holder.stdout is not None
            assert holder.stdout.readline() == "ready\n"
            client = subprocess.run(
                [sys.executable, "-c", CLIENT, path],
                capture_output=True,
                text=True,
                timeout=60,
                check=True,
                cwd=ROOT,
            )
            assert client.stdout.startswith(
                f"{path} belongs to user 65533, but this is user 65534, so nothing was sent: run this as"
            )
            assert holder.stdout.readline() == "b''\n"
