"""``[mqtt]``: what could not be published to is refused, with the key; who could overhear is warned of."""

import re
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

from gateway.config.load import load, reread_tables
from gateway.config.mqtt_model import MqttSection, MqttVersion, TlsSection
from gateway.supervisor.mqtt.settings import settings_of
from tests.config.config_bench import GOOD, loaded, refusal, warning_of, written
from tests.support.certificates import Shop, authority, signed_by

REFERENCE = (Path(__file__).parents[2] / "docs" / "configuration.md").read_text()


def with_mqtt(text: str) -> str:
    return f"{GOOD}\n[mqtt]\n{text}\n"


def mqtt(folder: Path, text: str) -> MqttSection:
    section = loaded(folder, with_mqtt(text)).sections.mqtt
    assert section is not None
    return section


def test_an_empty_section_is_a_broker_on_this_machine(tmp_path: Path) -> None:
    settings = settings_of(mqtt(tmp_path, ""), "mill-1", tmp_path)
    assert (settings.broker, settings.client_id, settings.version) == (
        "127.0.0.1:1883",
        "pitch-gateway-mill-1",
        MqttVersion.V311,
    )
    assert settings.topics.root == "pitch-gateway/mill-1"
    assert (settings.discovery, settings.allows_commands, settings.tls) == ("", False, None)
    assert settings.password() is None
    assert settings.tls_context() is None


def test_without_the_section_nothing_is_published(tmp_path: Path) -> None:
    assert loaded(tmp_path).sections.mqtt is None


@pytest.mark.parametrize("base", ["plant/hall-2/cell 7", "ü", "a" * 200])
def test_topics_that_mqtt_allows(tmp_path: Path, base: str) -> None:
    assert mqtt(tmp_path, f'base_topic = "{base}"').base_topic == base


@pytest.mark.parametrize(
    "base", ["", "/", "a/", "/a", "a//b", "a/+", "#", "a#b", "$SYS", "a\\u0000b", "a\\tb", "a" * 201]
)
@pytest.mark.parametrize("key", ["base_topic", "discovery"])
def test_topics_that_nobody_could_publish_to(tmp_path: Path, base: str, key: str) -> None:
    if (key, base) == ("discovery", ""):
        return  # that is how it is switched off
    problem = refusal(tmp_path, with_mqtt(f'{key} = "{base}"'), f"mqtt.{key}", at=f"{key} = ")
    assert problem.remedy.startswith(
        'allowed: levels between slashes, as in "plant/hall-2"; no + # or control'
    )


@pytest.mark.parametrize(
    ("text", "key", "said"),
    [
        ('version = "3.1"', "version", '"3.1.1" or "5"'),
        ("version = 5", "version", '"3.1.1" or "5"'),
        ("port = 0", "port", "at least 1, at most 65535"),
        ("interval_s = 0.01", "interval_s", "at least 0.05, at most 3600"),
        ("keepalive_s = 1", "keepalive_s", "at least 5, at most 3600"),
        ('host = ""', "host", "a name or an address alone"),
        ('host = "broker.lan:1883"', "host", "a name or an address alone"),
        ('host = "mqtt://broker.lan"', "host", "a name or an address alone"),
        ('client_id = "a\\nb"', "client_id", "1 to 128 characters"),
        ('commands = "yes"', "commands", "true or false"),
        ("tls = true", "tls", "a table"),
        ('tls = { ca_file = "x" }', "tls.ca_file", "ca, cert, key"),
        ('username = "m"\npassword = "secret"', "password", "password_file"),
    ],
)
def test_values_that_are_refused(tmp_path: Path, text: str, key: str, said: str) -> None:
    assert said in refusal(tmp_path, with_mqtt(text), f"mqtt.{key}").remedy


def test_a_password_is_read_from_its_file_and_shown_nowhere(tmp_path: Path) -> None:
    path = tmp_path / "mqtt.password"
    path.write_text("  with spaces \r\n")
    path.chmod(0o600)
    result = loaded(tmp_path, with_mqtt('username = "mill"\npassword_file = "mqtt.password"'))
    assert result.warnings == ()
    assert result.sections.mqtt is not None
    settings = settings_of(result.sections.mqtt, "mill-1", tmp_path)
    assert settings.password() == "  with spaces "
    assert "with spaces" not in repr(settings) + repr(result)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "no such file"),
        (b"", "empty"),
        (b"\n", "empty"),
        (b"one\ntwo\n", "more than one line"),
        (b"\xff\n", "not UTF-8"),
        (b"x" * 5000, "more than 4096 bytes"),
    ],
)
def test_password_files_that_hold_no_password(tmp_path: Path, content: bytes | None, said: str) -> None:
    if content is not None:
        (tmp_path / "pw").write_bytes(content)
        (tmp_path / "pw").chmod(0o600)
    problem = refusal(tmp_path, with_mqtt('username = "m"\npassword_file = "pw"'), "mqtt.password_file")
    assert said in problem.found


def test_a_password_without_a_name(tmp_path: Path) -> None:
    (tmp_path / "pw").write_text("x")
    problem = refusal(tmp_path, with_mqtt('password_file = "pw"'), "mqtt.password_file")
    assert problem.found == "without username"


def test_a_password_that_every_user_can_read_is_refused(tmp_path: Path) -> None:
    (tmp_path / "pw").write_text("x")
    (tmp_path / "pw").chmod(0o644)
    problem = refusal(tmp_path, with_mqtt('username = "m"\npassword_file = "pw"'), "mqtt.password_file")
    assert problem.found == f"{tmp_path / 'pw'}: every user of this machine may read it (mode 0644)"
    assert problem.remedy == f"chmod o-r {tmp_path / 'pw'}"


@pytest.mark.parametrize(
    ("host", "warned"), [("127.0.0.1", False), ("::1", False), ("localhost", False), ("broker.lan", True)]
)
def test_a_password_as_plain_text_over_a_network_is_warned_of(
    tmp_path: Path, host: str, warned: bool
) -> None:
    result = loaded(tmp_path, with_mqtt(f'host = "{host}"\nusername = "m"'))
    assert [warning.key for warning in result.warnings] == (["mqtt.username"] if warned else [])


def test_a_password_file_that_goes_away_does_not_keep_tables_from_being_read(tmp_path: Path) -> None:
    (tmp_path / "pw").write_text("x")
    (tmp_path / "pw").chmod(0o640)
    result = loaded(tmp_path, with_mqtt('username = "m"\npassword_file = "pw"'))
    (tmp_path / "pw").unlink()
    assert reread_tables(result).tables.keys() == {"x"}


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("certificates")
    authority(folder, "ca")
    signed_by(folder, "ca", "mill", "DNS:mill-1")
    signed_by(folder, "ca", "other", "DNS:other")
    (folder / "open.key").write_bytes((folder / "mill.key").read_bytes())
    (folder / "open.key").chmod(0o644)
    (folder / "empty.pem").touch()
    (folder / "text.pem").write_text("no certificate\n")
    return folder


def tls(folder: Path, **files: str) -> str:
    named = ", ".join(f'{key} = "{folder / name}"' for key, name in files.items())
    return f"tls = {{ {named} }}"


def test_certificates_that_belong_together(tmp_path: Path, certificates: Path) -> None:
    section = mqtt(tmp_path, tls(certificates, ca="ca.crt", cert="mill.crt", key="mill.key"))
    context = settings_of(section, "mill-1", tmp_path).tls_context()
    assert context is not None
    assert [ca["subject"] for ca in context.get_ca_certs()] == [((("commonName", "ca"),),)]


def test_a_certificate_that_ended_is_warned_of(tmp_path: Path) -> None:
    Shop(tmp_path).leaf("mill", ended=timedelta(days=3))
    section = tls(tmp_path, cert="mill.pem", key="mill.key")
    warning = warning_of(tmp_path, with_mqtt(section), "mqtt.tls.cert")
    assert warning.found.startswith("CN=mill expired on ")


@pytest.mark.parametrize(
    ("files", "key", "said"),
    [
        ({"ca": "none.pem"}, "ca", "no such file"),
        ({"ca": "empty.pem"}, "ca", "no certificates"),
        ({"ca": "text.pem"}, "ca", "no certificates"),
        ({"ca": "."}, "ca", "a folder"),
        ({"cert": "mill.crt"}, "cert", "without key"),
        ({"key": "mill.key"}, "key", "without cert"),
        ({"cert": "mill.crt", "key": "other.key"}, "cert", "key values mismatch"),
        ({"cert": "text.pem", "key": "mill.key"}, "cert", "cannot be used together"),
        ({"cert": "mill.crt", "key": "none.key"}, "key", "no such file"),
        (
            {"cert": "mill.crt", "key": "open.key"},
            "key",
            "every user of this machine may read it (mode 0644)",
        ),
    ],
)
def test_certificates_that_cannot_be_used(
    tmp_path: Path, certificates: Path, files: dict[str, str], key: str, said: str
) -> None:
    assert said in refusal(tmp_path, with_mqtt(tls(certificates, **files)), f"mqtt.tls.{key}").found


def rows() -> dict[str, list[str]]:
    section = REFERENCE[REFERENCE.index("## `[mqtt]`") : REFERENCE.index("## `[group.NAME]`")]
    cells = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in section.splitlines() if "|" in line
    ]
    return {row[0].strip("`"): row[1:] for row in cells[2:]}


def test_the_reference_lists_exactly_the_keys_and_their_defaults() -> None:
    def written_as(value: Any) -> str:
        if isinstance(value, MqttVersion):
            value = value.value
        return {str: f'`"{value}"`', bool: f"`{str(value).lower()}`"}.get(type(value), f"`{value}`")

    said = rows()
    assert list(said) == list(MqttSection.model_fields)
    for name, field in MqttSection.model_fields.items():
        if name == "client_id":
            assert said[name][1] == '`"pitch-gateway-NAME"`'
        elif field.default is None:
            assert said[name][1].startswith("none")
        else:
            assert said[name][1].startswith(written_as(field.default)), name
    assert all(
        f"`{key}`" in said["tls"][2] or f"{key} = " in said["tls"][2] for key in TlsSection.model_fields
    )


def test_the_section_of_the_example_may_be_uncommented(tmp_path: Path) -> None:
    example = (Path(__file__).parents[2] / "deploy" / "gateway.example.toml").read_text()
    section = example[example.index("# [mqtt]") :]
    lines = re.findall(r"^# ([a-z_\[].*)$", section, re.MULTILINE)
    kept = [line for line in lines if not line.startswith(("tls", "password_file"))]
    path = written(tmp_path, GOOD + "\n" + "\n".join(kept) + "\n")
    assert load(path).sections.mqtt == MqttSection(
        username="mill-1", discovery="homeassistant", client_id="pitch-gateway-mill-1"
    )
