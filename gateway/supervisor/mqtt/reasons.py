"""Why there is no connection to the broker and what to do, for readers who do not know MQTT codes."""

import socket
import ssl
from collections.abc import Mapping
from typing import Final

from gateway.config.files import NamedFileError
from gateway.config.mqtt_model import MqttVersion
from gateway.supervisor.mqtt.connection import BrokerError, NoAnswerError
from gateway.supervisor.mqtt.settings import Settings

_LOST: Final = (
    "the connection to {broker} was lost: check that the broker runs. If it does, another client may have "
    "connected as {client_id}"
)
_REFUSED: Final[Mapping[str, str]] = {
    "Not authorized": "the broker refuses {who}: check [mqtt] username and password_file, and what the "
    "broker allows",
    "Bad user name or password": "the broker refuses {who}: check [mqtt] username and password_file",
    "Unsupported protocol version": "the broker does not speak MQTT {version}: set [mqtt] version to {other}",
    "Client identifier not valid": "the broker refuses the name {client_id}: set another [mqtt] client_id",
    "Server unavailable": "the broker reports that it is not available: look at its log",
    "Banned": "the broker has banned {who}: look at its log",
    "Bad authentication method": "the broker requires another way to log in than username and password",
    "Session taken over": (
        "give each gateway its own name, or a [mqtt] client_id: another client has connected as {client_id}"
    ),
    "Unspecified error": _LOST,
    "Packet too large": "the broker refuses messages of this size: raise its limit",
    "Retain not supported": "the broker keeps no retained messages, which the gateway needs: switch them on",
    "QoS not supported": "the broker does not accept QoS 1, which the gateway needs: switch it on",
}
_OF_TIME: Final = "renew the certificate of the broker. If it is valid, set the clock of this computer"
_OF_NAME: Final = "set [mqtt] host to a name in the certificate of the broker"
_OF_CERTIFICATE: Final[Mapping[int, str]] = {9: _OF_TIME, 10: _OF_TIME, 62: _OF_NAME, 64: _OF_NAME}
"""Remedies by the code of OpenSSL (x509_vfy.h): not yet valid, expired, mismatch of host name or address."""
OTHER_AUTHORITY: Final = "set [mqtt.tls] ca to the authority that signed the certificate of the broker"


def taken_over(settings: Settings) -> str:
    """Return the explanation for a broker that ends one connection after the other."""
    return (
        f"give each gateway its own name, or a [mqtt] client_id: {settings.broker} ends each connection "
        f"soon, usually because another client also connects as {settings.client_id}"
    )


def may_be_taken_over(reason: str, settings: Settings) -> bool:
    """Whether a reason is one that a broker gives, or omits, when another client takes over the client id."""
    taken = _REFUSED["Session taken over"].format(client_id=settings.client_id)
    return reason in (taken, _LOST.format(broker=settings.broker, client_id=settings.client_id))


def why(error: BaseException, settings: Settings) -> str:
    """Return a sentence on why a connection ended or was not made."""
    if isinstance(error, NamedFileError):
        return str(error)
    if isinstance(error, NoAnswerError):
        need = (
            "check that this is a broker's port without TLS"
            if settings.tls is None
            else "check that this is a broker's port, and whether the broker requires a certificate "
            "([mqtt.tls] cert and key)"
        )
        return f"{settings.broker} does not answer: {need}"
    for each in (error.__cause__, error):
        if isinstance(each, OSError):
            return _of_network(each, settings)
    if isinstance(error, BrokerError) and error.reason is not None:
        return _of_reason(str(error.reason), settings)
    if isinstance(error, BrokerError):
        return _LOST.format(broker=settings.broker, client_id=settings.client_id)
    return f"unexpected {type(error).__name__}: {error}; please report it"


def _of_network(error: OSError, settings: Settings) -> str:
    broker = settings.broker
    if isinstance(error, ConnectionRefusedError):
        return f"nothing listens at {broker}: start the broker, or correct [mqtt] host and port"
    if isinstance(error, ssl.SSLCertVerificationError):
        remedy = _OF_CERTIFICATE.get(error.verify_code, OTHER_AUTHORITY)
        return f"{broker} could not prove its identity ({error.verify_message.rstrip('.')}): {remedy}"
    if isinstance(error, ssl.SSLError) or (settings.tls is not None and isinstance(error, ConnectionError)):
        reason = getattr(error, "reason", None) or error.strerror or str(error)
        words = reason.lower().replace("_", " ")
        return f"no TLS with {broker} ({words}): check that this is the broker's port for TLS"
    if isinstance(error, socket.gaierror):
        return f"the name service does not know {settings.host}: correct [mqtt] host, or check the network"
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
