"""Whether ``[mqtt]`` can work: the files that it names, and who could listen to its password."""

from ipaddress import ip_address
from pathlib import Path

from gateway.config.findings import Findings
from gateway.config.mqtt_files import MqttFileError, may_be_read_by_others, read_password, tls_context
from gateway.config.mqtt_model import MqttSection


def check_mqtt(findings: Findings, mqtt: MqttSection | None, folder: Path) -> None:
    """Refuse files that are missing or something else; warn of a password that others can read."""
    if mqtt is None:
        return
    if mqtt.password_file is not None:
        _check_password(findings, mqtt, folder / mqtt.password_file)
    if mqtt.username is not None and mqtt.tls is None and not _is_here(mqtt.host):
        findings.warn(
            ("mqtt", "username"),
            f"the password goes to {mqtt.host} as plain text",
            "add tls, if the broker offers it",
        )
    if mqtt.tls is not None:
        for name, other in (("cert", "key"), ("key", "cert")):
            if getattr(mqtt.tls, name) is not None and getattr(mqtt.tls, other) is None:
                findings.refuse(("mqtt", "tls", name), f"without {other}", f"give {other} too, or neither")
                return
        try:
            tls_context(mqtt.tls, folder)
        except MqttFileError as error:
            findings.refuse(error.key, error.found, error.remedy)


def _check_password(findings: Findings, mqtt: MqttSection, path: Path) -> None:
    key = ("mqtt", "password_file")
    if mqtt.username is None:
        findings.refuse(key, "without username", "give username too: MQTT 3.1.1 knows no password alone")
        return
    try:
        read_password(path)
    except MqttFileError as error:
        findings.refuse(key, error.found, error.remedy)
        return
    if (mode := may_be_read_by_others(path)) is not None:
        findings.warn(key, f"every user may read {path} (mode {mode})", f"chmod o-r {path}")


def _is_here(host: str) -> bool:
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
