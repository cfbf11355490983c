"""The connection to the broker: how it is made, why it fails, how it ends."""

import asyncio
import contextlib
import logging
import socket
import ssl
from collections.abc import AsyncIterator, Callable, Coroutine, Iterable, Mapping
from typing import Any, Final, TypeVar

import aiomqtt
import paho.mqtt.client
from aiomqtt.types import PahoSocket
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from gateway.config.files import NamedFileError
from gateway.config.mqtt_model import MqttVersion
from gateway.supervisor.mqtt.topics import OFFLINE, Settings

# --- Tasks that end when they are told to

AGAIN_S: Final = 0.1

Result = TypeVar("Result")


async def apart(work: Coroutine[Any, Any, Result]) -> Result:
    """Return what comes of ``work``; a cancellation ends both, whatever ``work`` makes of it."""
    task = asyncio.create_task(work)
    try:
        await asyncio.wait((task,))
    except asyncio.CancelledError:
        await end((task,))
        raise
    return task.result()


async def end(tasks: Iterable[asyncio.Task[Any]]) -> None:
    """Cancel tasks until all of them have ended."""
    running = {task for task in tasks if not task.done()}
    while running:
        for task in running:
            task.cancel()
        _, running = await asyncio.wait(running, timeout=AGAIN_S)


# --- Why there is no connection to the broker, and what to do: for people who have never seen an MQTT code

TIMED_OUT: Final = "Operation timed out"
"""What the library says of a broker that was reached and does not answer."""

_LOST: Final = (
    "the connection to {broker} was lost: is the broker still running? Where it is, another client may have "
    "connected as {client_id}"
)
_REFUSED: Final[Mapping[str, str]] = {
    "Not authorized": "the broker refuses {who}: check [mqtt] username and password_file, and what the "
    "broker allows",
    "Bad user name or password": "the broker refuses {who}: check [mqtt] username and password_file",
    "Unsupported protocol version": "the broker does not speak MQTT {version}: set [mqtt] version to {other}",
    "Client identifier not valid": "the broker refuses the name {client_id}: set another [mqtt] client_id",
    "Server unavailable": "the broker says that it is not available: look at its log",
    "Banned": "the broker has banned {who}: look at its log",
    "Bad authentication method": "the broker wants another way to log in than username and password",
    "Session taken over": "another client has connected as {client_id}: give each gateway a name of its own, "
    "or a [mqtt] client_id",
    "Unspecified error": _LOST,
    "Packet too large": "the broker refuses messages of this size: raise its limit",
    "Retain not supported": "the broker keeps no retained messages, which the gateway needs: switch them on",
    "QoS not supported": "the broker does not take QoS 1, which the gateway needs: switch it on",
}


def taken_over(settings: Settings) -> str:
    """Return what it means that the broker ends one connection after the other."""
    return (
        f"{settings.broker} ends each connection soon after it was made: as a rule another client connects "
        f"as {settings.client_id} too, and each takes the other's place; give each gateway a name of its "
        "own, or a [mqtt] client_id"
    )


def is_cut(reason: str, settings: Settings) -> bool:
    """Whether a reason is one that a broker gives, or leaves open, where another client takes our place."""
    taken = _REFUSED["Session taken over"].format(client_id=settings.client_id)
    return reason in (taken, _LOST.format(broker=settings.broker, client_id=settings.client_id))


def why(error: BaseException, settings: Settings) -> str:
    """Return a sentence on what ended a connection, or kept it from being made."""
    if isinstance(error, NamedFileError):
        return str(error)
    if isinstance(error, aiomqtt.MqttError) and str(error) == TIMED_OUT:
        need = (
            "is it a broker's port, and is it one without TLS?"
            if settings.tls is None
            else "is it a broker's port, and does the broker want a certificate ([mqtt.tls] cert and key)?"
        )
        return f"{settings.broker} does not answer: {need}"
    for each in (error.__cause__, error.__context__, error):
        if isinstance(each, OSError):
            return _of_network(each, settings)
        if isinstance(each, aiomqtt.exceptions.MqttCodeError) and isinstance(each.rc, ReasonCode):
            return _of_reason(str(each.rc), settings)
    if isinstance(error, aiomqtt.MqttError):
        return _LOST.format(broker=settings.broker, client_id=settings.client_id)
    return f"unexpected {type(error).__name__}: {error}; please report it"


def _of_network(error: OSError, settings: Settings) -> str:
    broker = settings.broker
    if isinstance(error, ConnectionRefusedError):
        return f"nobody listens at {broker}: start the broker, or correct [mqtt] host and port"
    if isinstance(error, ssl.SSLCertVerificationError):
        return (
            f"{broker} could not prove who it is ({error.verify_message}): [mqtt.tls] ca must name the "
            "authority that signed its certificate, and [mqtt] host a name that stands in it"
        )
    if isinstance(error, ssl.SSLError) or (settings.tls is not None and isinstance(error, ConnectionError)):
        reason = getattr(error, "reason", None) or error.strerror or str(error)
        words = reason.lower().replace("_", " ")
        return f"no TLS with {broker} ({words}): is this the broker's port for TLS?"
    if isinstance(error, socket.gaierror):
        return f"{settings.host} is not known to the name service: correct [mqtt] host, or check the network"
    if isinstance(error, TimeoutError):
        return f"{broker} does not answer: check the network, and [mqtt] host and port"
    reason = error.strerror or str(error)
    return f"the connection to {broker} failed ({reason}): check the broker and the network"


def _of_reason(reason: str, settings: Settings) -> str:
    other = MqttVersion.V5 if settings.version is MqttVersion.V311 else MqttVersion.V311
    words = _REFUSED.get(reason)
    if words is None:
        return f"the connection to {settings.broker} ended ({reason.lower()}): look at the broker's log"
    return words.format(
        who=f'the user "{settings.username}"' if settings.username else "clients without a username",
        broker=settings.broker,
        version=settings.version.value,
        other=f'"{other.value}"',
        client_id=settings.client_id,
    )


# --- One connection to the broker, from CONNECT to the last word

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
