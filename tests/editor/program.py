"""``pitch-gateway table edit`` as a process, and its page as a program reaches it."""

import contextlib
import http.client
import json
import os
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.support.processes import COMMAND, ROOT, SECONDS, started


class Program:
    """The command, and its page as a program reaches it."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self.process = process
        self.first = self.line()
        _, _, self.host, self.token, _ = self.first.split()[-1].split("/")
        self.hint = self.line()

    def line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().rstrip("\n")

    def ask(self, method: str, path: str, body: bytes = b"", **headers: str) -> tuple[int, Any, bytes]:
        connection = http.client.HTTPConnection(self.host, timeout=SECONDS)
        with contextlib.closing(connection):
            connection.request(method, path, body or None, {"Host": self.host, **headers})
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read()

    def do(self, **what: object) -> tuple[int, Any]:
        origin = f"http://{self.host}"
        status, _, body = self.ask("POST", f"/{self.token}/do", json.dumps(what).encode(), Origin=origin)
        return status, json.loads(body)

    @contextlib.contextmanager
    def tab(self) -> Iterator[None]:
        """Keep the stream of a tab open."""
        address, port = self.host.split(":")
        with socket.create_connection((address, int(port)), timeout=SECONDS) as stream:
            stream.sendall(f"GET /{self.token}/events HTTP/1.1\r\nHost: {self.host}\r\n\r\n".encode())
            assert stream.recv(12) == b"HTTP/1.1 200"
            yield


@contextlib.contextmanager
def editing(file: Path, *options: str, program: list[str] = COMMAND, **environment: str) -> Iterator[Program]:
    """Start the command; without a browser, unless the environment names one."""
    command = [*program, "table", "edit", str(file), *options, *([] if environment else ["--no-browser"])]
    env = {**os.environ, **environment}
    with started(command, cwd=ROOT, env=env, stdout=subprocess.PIPE, text=True) as process:
        yield Program(process)
