"""One connection to the broker, from CONNECT to DISCONNECT.

paho implements the protocol; asyncio's loop reads and writes its socket. Only connecting blocks, in its own
thread; until that ends, nothing else uses the client. paho's own reconnecting is not used: it does not report
why an attempt failed, does not read password and certificates again, and first resends what it had sent
before, however old.
"""

import asyncio
import contextlib
import logging
import ssl
from collections.abc import AsyncIterator, Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import msgspec
from paho.mqtt.client import Client, DisconnectFlags, MQTTMessage, MQTTv5, MQTTv311
from paho.mqtt.enums import CallbackAPIVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from gateway.config.mqtt_model import MqttVersion
from gateway.supervisor.in_thread import in_thread
from gateway.supervisor.mqtt.settings import Settings

if TYPE_CHECKING:
    from paho.mqtt.client import SocketLike

ONLINE: Final = b"online"
OFFLINE: Final = b"offline"

ANSWER_S: Final = 10.0
"""Without a response in this time the connection counts as lost."""
GOODBYE_S: Final = 2.0
"""Stopping the gateway waits no longer for the broker."""
TICK_S: Final = 1.0
"""Interval at which paho checks whether to ping the broker."""
LARGEST_PACKET: Final = 65536
"""Bytes that a version 5 broker may send in one packet; commands have a hundred."""

# The library's log is for its developers. Status and events contain what matters.
_SILENT: Final = logging.getLogger("gateway.mqtt")
_SILENT.addHandler(logging.NullHandler())
_SILENT.propagate = False

_encoder: Final = msgspec.json.Encoder(enc_hook=str)


def encode(payload: object) -> bytes:
    """Return a payload as JSON; numbers that JSON does not have become null."""
    return _encoder.encode(payload)


class BrokerError(Exception):
    """The connection failed or has ended; ``reason`` comes from the broker or paho, if they give one."""

    def __init__(self, reason: ReasonCode | None = None) -> None:
        super().__init__(str(reason))
        self.reason = reason


class NoAnswerError(BrokerError):
    """The broker was reached and does not answer."""


class BrokerConnection:
    """A connection, on the loop that made it.

    ``take`` is called with the connection and each received message; it must not block.
    """

    def __init__(
        self,
        settings: Settings,
        password: str | None,
        context: ssl.SSLContext | None,
        take: "Callable[[BrokerConnection, MQTTMessage], None]",
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._settings = settings
        self._take = take
        self._accepted: asyncio.Future[None] = self._loop.create_future()
        self.lost: asyncio.Future[BrokerError] = self._loop.create_future()
        """Why the connection has ended, as soon as it has."""
        self._answers: dict[int | None, asyncio.Future[Any]] = {}
        """Messages that the broker has not taken or acknowledged yet, by packet identifier; None: the
        connection ended before paho gave one."""
        self._ticking: asyncio.TimerHandle | None = None
        is_v5 = settings.version is MqttVersion.V5
        self._client = Client(
            CallbackAPIVersion.VERSION2,
            client_id=settings.client_id,
            # A session that outlives the connection would deliver commands later, when they are unexpected.
            clean_session=None if is_v5 else True,
            protocol=MQTTv5 if is_v5 else MQTTv311,
            reconnect_on_failure=False,
        )
        self._client.enable_logger(_SILENT)
        self._client.will_set(settings.topics.availability, OFFLINE, qos=1, retain=True)
        if settings.username is not None:
            self._client.username_pw_set(settings.username, password)
        if context is not None:
            context.sslsocket_class = _Socket
            self._client.tls_set_context(context)

    async def open(self) -> None:
        """Connect, and wait until the broker has accepted. Raises OSError or BrokerError."""
        properties = None
        if self._settings.version is MqttVersion.V5:
            properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
            properties.MaximumPacketSize = LARGEST_PACKET
        host, port, keepalive_s = self._settings.host, self._settings.port, self._settings.keepalive_s
        await in_thread(partial(self._client.connect, host, port, keepalive_s, properties=properties))
        self._serve()
        await self._within(self._accepted)

    async def subscribe(self, topics: Sequence[tuple[str, int]]) -> list[str]:
        """Subscribe to topics, each with a QoS; return those that are not granted. Raises BrokerError."""
        _, mid = self._client.subscribe(list(topics))
        codes: list[ReasonCode] = await self._answer(mid)
        return [topic for (topic, _), code in zip(topics, codes, strict=True) if code.is_failure]

    async def publish(
        self,
        topic: str,
        payload: bytes,
        *,
        qos: int = 0,
        retain: bool = False,
        correlation: bytes | None = None,
    ) -> None:
        """Publish; wait until the message is written, with QoS 1 acknowledged. Raises BrokerError."""
        properties = None
        if correlation is not None:
            properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
            properties.CorrelationData = correlation
        await self._answer(self._client.publish(topic, payload, qos, retain, properties).mid)

    async def disconnect(self) -> None:
        """Publish the content of the will, then disconnect.

        The broker sends no will for a regular DISCONNECT.
        """
        with contextlib.suppress(BrokerError, TimeoutError):
            async with asyncio.timeout(GOODBYE_S):
                await self.publish(self._settings.topics.availability, OFFLINE, qos=1, retain=True)
        self._client.disconnect()
        await asyncio.wait((self.lost,), timeout=GOODBYE_S)

    def close(self) -> None:
        """Close the socket if it is still open, without a DISCONNECT."""
        if (sock := self._client.socket()) is not None:
            self._stop_serving(sock)
            sock.close()
        self._end(NoAnswerError())

    def _serve(self) -> None:
        """Let asyncio's loop read and write from now on."""
        client, loop = self._client, self._loop
        sock = client.socket()
        if sock is None:
            self._end(NoAnswerError())
            return
        client.on_connect = self._on_connect
        client.on_disconnect = self._on_disconnect
        client.on_message = lambda _client, _data, message: self._take(self, message)
        client.on_publish = lambda _client, _data, mid, *_: self._acknowledge(mid, None)
        client.on_subscribe = lambda _client, _data, mid, codes, _properties: self._acknowledge(mid, codes)
        client.on_socket_close = lambda *_: self._stop_serving(sock)
        client.on_socket_register_write = lambda *_: loop.add_writer(sock, self._step, client.loop_write)
        client.on_socket_unregister_write = lambda *_: self._stop_writing(sock)
        loop.add_reader(sock, self._read)
        self._tick()

    def _stop_writing(self, sock: "SocketLike") -> None:
        self._loop.remove_writer(sock)

    def _stop_serving(self, sock: "SocketLike") -> None:
        # paho's destructor would call them again, with a closed socket.
        self._client.on_socket_close = self._client.on_socket_unregister_write = None
        self._loop.remove_reader(sock)
        self._stop_writing(sock)
        if self._ticking is not None:
            self._ticking.cancel()

    def _read(self) -> None:
        self._step(self._client.loop_read)
        # Data that TLS has already decrypted does not make the socket readable.
        sock = self._client.socket()
        while isinstance(sock, ssl.SSLSocket) and not self.lost.done() and sock.pending():
            self._step(self._client.loop_read)

    def _tick(self) -> None:
        self._step(self._client.loop_misc)
        if not self.lost.done():
            self._ticking = self._loop.call_later(TICK_S, self._tick)

    def _step(self, work: Callable[[], object]) -> None:
        try:
            work()
        except Exception as error:  # noqa: BLE001 - bytes from a broker that paho cannot read
            lost = BrokerError()
            lost.__cause__ = error
            self._end(lost)

    def _on_connect(
        self, _client: Client, _data: object, _flags: object, reason: ReasonCode, *_: object
    ) -> None:
        if reason.is_failure:
            self._end(BrokerError(reason))
        elif not self._accepted.done():
            self._accepted.set_result(None)

    def _on_disconnect(
        self, _client: Client, _data: object, flags: DisconnectFlags, reason: ReasonCode, *_: object
    ) -> None:
        has_reason = self._accepted.done() or flags.is_disconnect_packet_from_server
        self._end(BrokerError(reason) if has_reason else NoAnswerError())

    def _end(self, error: BrokerError) -> None:
        if not self.lost.done():
            self.lost.set_result(error)

    def _acknowledge(self, mid: int, answer: object) -> None:
        if (waiting := self._answers.pop(mid, None)) is not None:
            waiting.set_result(answer)

    async def _answer(self, mid: int | None) -> Any:
        self._answers[mid] = self._loop.create_future()
        try:
            return await self._within(self._answers[mid])
        finally:
            self._answers.pop(mid, None)

    async def _within(self, answer: "asyncio.Future[Any]") -> Any:
        """Return a response of the broker, or raise why there is none."""
        await asyncio.wait((answer, self.lost), timeout=ANSWER_S, return_when=asyncio.FIRST_COMPLETED)
        if answer.done():
            return answer.result()
        raise self.lost.result() if self.lost.done() else NoAnswerError


@contextlib.asynccontextmanager
async def connected(
    settings: Settings, take: Callable[[BrokerConnection, MQTTMessage], None]
) -> AsyncIterator[BrokerConnection]:
    """Yield a connection. When cancelled, it disconnects regularly if the broker still reads.

    Raises:
        NamedFileError: the password or a certificate cannot be used.
        OSError: the broker cannot be reached.
        BrokerError: the broker does not accept, or the connection is lost.
    """
    password = await asyncio.to_thread(settings.password)
    context = await asyncio.to_thread(settings.tls_context)
    connection = BrokerConnection(settings, password, context, take)
    try:
        await connection.open()
        try:
            yield connection
        except asyncio.CancelledError:
            await connection.disconnect()
            raise
    finally:
        connection.close()


class _Socket(ssl.SSLSocket):
    """Closes itself after a failed handshake; paho leaves that to the garbage collector."""

    def do_handshake(self, block: bool = False) -> None:
        """Negotiate TLS. Raises OSError."""
        try:
            super().do_handshake(block)
        except OSError:
            self.close()
            raise
