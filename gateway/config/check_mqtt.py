"""Whether ``[mqtt]`` can work: the files that it names, and who could listen to its password."""

from datetime import datetime
from ipaddress import ip_address
from pathlib import Path

from gateway.config.certificate_times import warn_of_times
from gateway.config.findings import Findings
from gateway.config.mqtt_files import PASSWORD_KEY, read_password, tls_context
from gateway.config.mqtt_model import MqttSection, TlsSection
from gateway.config.named_files import NamedFileError, is_out_of_reach, path_of, warn_out_of_reach


def check_mqtt(findings: Findings, mqtt: MqttSection | None, folder: Path, now: datetime) -> None:
    """Refuse files that are missing, something else, or secret and readable by every user.

    Of a certificate that has expired, or soon will, it is warned.
    """
    if mqtt is None:
        return
    if mqtt.password_file is not None:
        _check_password(findings, mqtt, mqtt.password_file, folder)
    if mqtt.username is not None and mqtt.tls is None and not _is_here(mqtt.host):
        findings.warn(
            ("mqtt", "username"),
            f"the password goes to {mqtt.host} as plain text",
            "add tls, if the broker offers it",
        )
    if mqtt.tls is not None:
        _check_tls(findings, mqtt.tls, folder, now)


def _check_tls(findings: Findings, tls: TlsSection, folder: Path, now: datetime) -> None:
    for name, other in (("cert", "key"), ("key", "cert")):
        if getattr(tls, name) is not None and getattr(tls, other) is None:
            findings.refuse(("mqtt", "tls", name), f"without {other}", f"give {other} too, or neither")
            return
    named = {key: file for key in ("ca", "cert", "key") if (file := getattr(tls, key)) is not None}
    away = [key for key, file in named.items() if is_out_of_reach(file)]
    for key in away:
        warn_out_of_reach(findings, ("mqtt", "tls", key), named[key])
    if away:
        return
    try:
        tls_context(tls, folder)
    except NamedFileError as error:
        findings.refuse(error.key, error.found, error.remedy)
        return
    if tls.cert is not None:
        path = ("mqtt", "tls", "cert")
        warn_of_times(findings, path, path_of(path, tls.cert, folder), now)


def _check_password(findings: Findings, mqtt: MqttSection, file: str, folder: Path) -> None:
    if mqtt.username is None:
        remedy = "give username too: MQTT 3.1.1 knows no password alone"
        findings.refuse(PASSWORD_KEY, "without username", remedy)
    elif is_out_of_reach(file):
        warn_out_of_reach(findings, PASSWORD_KEY, file)
    else:
        try:
            read_password(file, folder)
        except NamedFileError as error:
            findings.refuse(error.key, error.found, error.remedy)


def _is_here(host: str) -> bool:
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
