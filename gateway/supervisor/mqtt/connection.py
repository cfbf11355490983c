"""One connection to the broker, from CONNECT to the last word."""

import asyncio
import contextlib
import logging
import ssl
from collections.abc import AsyncIterator, Callable
from typing import Final

import aiomqtt
import paho.mqtt.client
from aiomqtt.types import PahoSocket
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from gateway.config.mqtt_model import MqttVersion
from gateway.supervisor.mqtt.ending import apart, end
from gateway.supervisor.mqtt.messages import OFFLINE
from gateway.supervisor.mqtt.settings import Settings

ANSWER_S: Final = 10.0
"""A broker that has not answered by then is as good as gone."""
GOODBYE_S: Final = 2.0
"""Whoever stops the gateway waits no longer for the broker."""
AT_ONCE_S: Final = 0.1
THREAD_S: Final = 6.0
"""The library's thread gives up after 5 s."""
LARGEST_PACKET: Final = 65536
"""Bytes that a broker of version 5 may send at once; commands have a hundred."""

# The library's log is for its developers: what matters is in the status and the events.
_SILENT: Final = logging.getLogger("gateway.mqtt")
_SILENT.addHandler(logging.NullHandler())
_SILENT.propagate = False


@contextlib.asynccontextmanager
async def connected(
    settings: Settings, take: Callable[[aiomqtt.Message], None]
) -> AsyncIterator[aiomqtt.Client]:
    """Yield a client that is connected; say goodbye at the end, as far as the broker listens.

    ``take`` gets each message as it comes, and must not block; ``client.messages`` has none, and ends with
    the connection.

    Raises:
        NamedFileError: the password or a certificate cannot be used.
        aiomqtt.MqttError: no connection, or it has been lost.
    """
    password = await asyncio.to_thread(settings.password)
    context = await asyncio.to_thread(settings.tls_context)
    client = _client(settings, password, context, take)
    try:
        await _enter(client)
    except aiomqtt.MqttError:
        await _leave(client, AT_ONCE_S)  # else its socket stays open, if it came so far
        raise
    try:
        yield client
    except asyncio.CancelledError:
        await _say_goodbye(client, settings)
        raise
    except Exception:  # whoever used it failed, whatever at: its socket may not stay open
        await _leave(client)
        raise
    await _leave(client)


class _Socket(ssl.SSLSocket):
    """Closes itself where the two sides do not agree: the library leaves that to the garbage collector."""

    def do_handshake(self, block: bool = False) -> None:
        """Agree on a key. Raises OSError."""
        try:
            super().do_handshake(block)
        except OSError:
            self.close()
            raise


class _Client(aiomqtt.Client):
    """Closes a gap of the library, which asks for a socket by its number, and in the next round of the loop.

    By then it may have been closed: an error that nobody can catch, or, where the number has been given away
    again, somebody else's socket. Should a later release name the method differently, its own holds again.
    """

    def _on_socket_register_write(
        self, client: paho.mqtt.client.Client, userdata: object, sock: PahoSocket
    ) -> None:
        def write() -> None:
            try:
                client.loop_write()
            except Exception as error:  # noqa: BLE001 - as the library has it: whatever it is ends the connection
                if not self._disconnected.done():
                    self._disconnected.set_exception(error)

        def register() -> None:
            if sock.fileno() >= 0:
                self._loop.add_writer(sock.fileno(), write)

        self._loop.call_soon_threadsafe(register)


def _inbox(take: Callable[[aiomqtt.Message], None]) -> type[asyncio.Queue[aiomqtt.Message]]:
    """Return a queue that hands on each message at once: the library drops, in silence, what has no room."""

    class Inbox(asyncio.Queue[aiomqtt.Message]):
        def put_nowait(self, item: aiomqtt.Message) -> None:
            take(item)

    return Inbox


def _client(
    settings: Settings,
    password: str | None,
    context: ssl.SSLContext | None,
    take: Callable[[aiomqtt.Message], None],
) -> aiomqtt.Client:
    if context is not None:
        context.sslsocket_class = _Socket
    is_v5 = settings.version is MqttVersion.V5
    properties = None
    if is_v5:
        properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
        properties.MaximumPacketSize = LARGEST_PACKET
    return _Client(
        settings.host,
        settings.port,
        username=settings.username,
        password=password,
        logger=_SILENT,
        identifier=settings.client_id,
        protocol=aiomqtt.ProtocolVersion.V5 if is_v5 else aiomqtt.ProtocolVersion.V311,
        will=aiomqtt.Will(settings.topics.availability, OFFLINE, qos=1, retain=True),
        # A session that outlives the connection would keep commands for later, when nobody expects them.
        clean_session=None if is_v5 else True,
        timeout=ANSWER_S,
        keepalive=settings.keepalive_s,
        queue_type=_inbox(take),
        properties=properties,
        tls_context=context,
    )


async def _enter(client: aiomqtt.Client) -> None:
    """Connect. Who is cancelled meanwhile waits a little: the library connects in a thread of its own."""
    entering = asyncio.ensure_future(client.__aenter__())
    try:
        await asyncio.shield(entering)
    except asyncio.CancelledError:
        await asyncio.wait((entering,), timeout=THREAD_S)
        await end((entering,))
        is_in = not entering.cancelled() and entering.exception() is None
        await _leave(client, GOODBYE_S if is_in else AT_ONCE_S)
        raise


async def _say_goodbye(client: aiomqtt.Client, settings: Settings) -> None:
    """Publish what the will would say: the broker does not, where a client leaves properly."""
    with contextlib.suppress(aiomqtt.MqttError):
        topic = settings.topics.availability
        await apart(client.publish(topic, OFFLINE, qos=1, retain=True, timeout=GOODBYE_S))
    await _leave(client)


async def _leave(client: aiomqtt.Client, timeout_s: float = GOODBYE_S) -> None:
    client.timeout = timeout_s
    with contextlib.suppress(aiomqtt.MqttError):
        await apart(client.__aexit__(None, None, None))
