"""A real broker for a test, on a free port of its own, and somebody who listens to it."""

import asyncio
import contextlib
import os
import shutil
import signal
import socket
import ssl
import subprocess
import time
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import Any

from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
from paho.mqtt.properties import Properties

from tests.support.ports import free_port

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


class BrokerLeftError(Exception):
    """The broker refused a connection, or ended it."""


class Speaker:
    """A client of the broker, in paho's own thread: nothing of the gateway is in it."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._loop = asyncio.get_running_loop()
        self._accepted: asyncio.Future[None] = self._loop.create_future()
        self._granted: asyncio.Future[None] = self._loop.create_future()
        self._messages: asyncio.Queue[MQTTMessage | None] = asyncio.Queue()
        client.on_connect = lambda _client, _data, _flags, reason, _more: self._soon(
            self._connect, str(reason)
        )
        client.on_subscribe = lambda *_: self._soon(self._granted.set_result, None)
        client.on_message = lambda _client, _data, message: self._soon(self._messages.put_nowait, message)
        client.on_disconnect = lambda *_: self._soon(self._messages.put_nowait, None)

    async def connect(self, port: int) -> None:
        await asyncio.to_thread(self._client.connect, "127.0.0.1", port)
        self._client.loop_start()
        async with asyncio.timeout(PATIENCE_S):
            await self._accepted

    async def subscribe(self, topic: str) -> None:
        """Ask for a topic, once."""
        self._client.subscribe(topic, qos=1)
        async with asyncio.timeout(PATIENCE_S):
            await self._granted

    async def publish(
        self,
        topic: str,
        payload: str | bytes = b"",
        *,
        qos: int = 0,
        retain: bool = False,
        properties: Properties | None = None,
    ) -> None:
        """Publish, and wait until the broker has it."""
        info = self._client.publish(topic, payload, qos, retain, properties)
        await asyncio.to_thread(info.wait_for_publish, PATIENCE_S)

    async def next(self) -> MQTTMessage:
        message = await self._messages.get()
        if message is None:
            raise BrokerLeftError("the connection is over")
        return message

    async def leave(self) -> None:
        self._client.disconnect()
        await asyncio.to_thread(self._client.loop_stop)
        # paho closes what is left when nothing names it any more: not while its callbacks name this object.
        self._client.on_connect = self._client.on_subscribe = None
        self._client.on_message = self._client.on_disconnect = None

    def _soon(self, take: Callable[..., None], value: object) -> None:
        self._loop.call_soon_threadsafe(take, value)

    def _connect(self, reason: str) -> None:
        if reason == "Success":
            self._accepted.set_result(None)
        else:
            self._accepted.set_exception(BrokerLeftError(reason))


@contextlib.asynccontextmanager
async def speaking(
    port: int,
    *,
    identifier: str = "",
    username: str | None = None,
    password: str | None = None,
    version: MQTTProtocolVersion = MQTTProtocolVersion.MQTTv311,
    tls_context: ssl.SSLContext | None = None,
) -> AsyncIterator[Speaker]:
    """Yield a client that the broker has accepted. Raises BrokerLeftError where it does not."""
    client = Client(CallbackAPIVersion.VERSION2, identifier, protocol=version, reconnect_on_failure=False)
    if username is not None:
        client.username_pw_set(username, password)
    if tls_context is not None:
        client.tls_set_context(tls_context)
    speaker = Speaker(client)
    try:
        await speaker.connect(port)
        yield speaker
    finally:
        await speaker.leave()


class Watcher:
    """Hears everything that it may, in the order in which it comes."""

    def __init__(self, client: Speaker) -> None:
        self.client = client
        self.heard: list[MQTTMessage] = []

    async def until(self, topic: str, fits: Callable[[bytes], bool] = lambda payload: True) -> MQTTMessage:
        """Listen up to a message. Raises BrokerLeftError."""
        async with asyncio.timeout(PATIENCE_S):
            while True:
                message = await self.client.next()
                self.heard.append(message)
                if message.topic == topic and fits(payload_of(message)):
                    return message

    def topics(self) -> set[str]:
        return {message.topic for message in self.heard}


def payload_of(message: MQTTMessage) -> bytes:
    return bytes(message.payload)


@contextlib.asynccontextmanager
async def watching(port: int, topic: str = "#", **options: Any) -> AsyncIterator[Watcher]:
    async with speaking(port, **options) as client:
        await client.subscribe(topic)
        yield Watcher(client)
