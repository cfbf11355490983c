"""A real broker for a test, on a free port of its own, and somebody who listens to it."""

import asyncio
import contextlib
import os
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import Any

import aiomqtt

from tests.ports import free_port

PATIENCE_S = 30.0


def mosquitto() -> str:
    """Return the broker's program."""
    found = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin")
    assert found, "mosquitto is not installed: apt-get install mosquitto mosquitto-clients"
    return found


def mosquitto_passwd() -> str:
    """Return the program that makes its password files."""
    found = shutil.which("mosquitto_passwd")
    assert found, "mosquitto_passwd is not installed: apt-get install mosquitto"
    return found


ANYBODY = "listener {port} 127.0.0.1\nallow_anonymous true\n"


class Broker:
    """A broker that can be stopped and started again; retained messages do not outlive it."""

    def __init__(self, folder: Path, text: str = ANYBODY) -> None:
        self.port = free_port()
        self.config = folder / "mosquitto.conf"
        # Started by root it would become another user, who may not look into the folders of a test.
        user = "user root\n" if os.geteuid() == 0 else ""
        self.config.write_text(user + text.format(port=self.port))
        self._log = folder / "mosquitto.log"
        self.process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        with self._log.open("ab") as log:
            self.process = subprocess.Popen([mosquitto(), "-c", str(self.config)], stdout=log, stderr=log)
        until = time.monotonic() + PATIENCE_S
        while True:
            try:
                socket.create_connection(("127.0.0.1", self.port), timeout=PATIENCE_S).close()
            except ConnectionRefusedError:
                assert self.process.poll() is None, self.log
                assert time.monotonic() < until, self.log
                time.sleep(0.01)
            else:
                return

    def stop(self, number: signal.Signals = signal.SIGTERM) -> None:
        if self.process is not None and self.process.poll() is None:
            self.process.send_signal(signal.SIGCONT)
            self.process.send_signal(number)
            try:
                self.process.wait(PATIENCE_S)
            finally:
                self.process.kill()
        self.process = None

    @property
    def log(self) -> str:
        return self._log.read_text() if self._log.exists() else ""

    def until_logged(self, text: str) -> None:
        """Wait until the broker's log holds a text."""
        until = time.monotonic() + PATIENCE_S
        while text not in self.log:
            assert time.monotonic() < until, self.log
            time.sleep(0.01)


@contextlib.contextmanager
def broker_in(folder: Path, text: str = ANYBODY) -> Iterator[Broker]:
    broker = Broker(folder, text)
    try:
        broker.start()
        yield broker
    finally:
        broker.stop(signal.SIGKILL)


class Watcher:
    """Hears everything that it may, in the order in which it comes."""

    def __init__(self, client: aiomqtt.Client) -> None:
        self.client = client
        self.heard: list[aiomqtt.Message] = []

    async def until(
        self, topic: str, fits: Callable[[bytes], bool] = lambda payload: True
    ) -> aiomqtt.Message:
        """Listen up to a message."""
        async with asyncio.timeout(PATIENCE_S):
            async for message in self.client.messages:
                self.heard.append(message)
                if message.topic.value == topic and fits(payload_of(message)):
                    return message
        raise AssertionError("the broker said nothing more")

    def topics(self) -> set[str]:
        return {message.topic.value for message in self.heard}


def payload_of(message: aiomqtt.Message) -> bytes:
    assert isinstance(message.payload, bytes)
    return message.payload


@contextlib.asynccontextmanager
async def watching(port: int, topic: str = "#", **options: Any) -> AsyncIterator[Watcher]:
    async with aiomqtt.Client("127.0.0.1", port, **options) as client:
        await client.subscribe(topic, qos=1)
        yield Watcher(client)
