"""``service``: the units fitted to a configuration, and the reasons for what stays open."""

import grp
import json
import os
import tempfile
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from gateway.cli.app import app
from gateway.config.load import load
from gateway.config.service_units import drop_ins
from tests.support.lesser import lesser

CONFIG = """
[gateway]
name = "mill"
{gateway}
[http]
listen = "{http}"
{more}
[line.xyz]
drives = {{ {drives} }}

[[line.xyz.controllers]]
name = "cnc"
{controller}

[axis.x]
line = "xyz"
unit_id = 1
units = "mm"
counts_per_unit = 1000.0
travel = [0.0, 100.0]
referenced = "absolute"
registers.command = [{{ address = 100, type = "int32" }}]
"""
HEAD = (
    "# Made from gateway.toml by `pitch-gateway service`: make it again when that has changed.\n[Service]\n"
)


def config_in(folder: Path, **changes: str) -> Path:
    keys = {
        "gateway": "",
        "http": "127.0.0.1:8480",
        "more": "",
        "drives": 'tcp = "192.168.0.21:502"',
        "controller": 'tcp = "0.0.0.0:1502"\nallow = ["10.1.0.0/16", "10.2.0.7"]',
    }
    (folder / "gateway.toml").write_text(CONFIG.format(**(keys | changes)))
    return folder / "gateway.toml"


def fitted(config: Path) -> tuple[str, str]:
    """The drop-ins of relay and supervisor, without their common head."""
    result = CliRunner().invoke(app, ["service", str(config), "--json"])
    assert result.exit_code == 0, result.output
    relay, supervisor = json.loads(result.stdout)["drop_ins"].values()
    assert relay.startswith(HEAD)
    assert supervisor.startswith(HEAD)
    return relay.removeprefix(HEAD), supervisor.removeprefix(HEAD)


def test_all_addresses_are_known(tmp_path: Path) -> None:
    relay, supervisor = fitted(config_in(tmp_path))
    assert relay == (
        "IPAddressDeny=any\n"
        "IPAddressAllow=localhost 192.168.0.21 10.1.0.0/16 10.2.0.7/32\n"
        "DeviceAllow=\n"
        "PrivateDevices=yes\n"
    )
    assert supervisor == "IPAddressDeny=any\nIPAddressAllow=localhost\n"


@pytest.mark.parametrize(
    ("drives", "allowed"),
    [
        ("[fe80::1%eth0]:502", "localhost fe80::1 10"),  # systemd would pass over one with an interface
        ("[::ffff:192.0.2.1]:502", "localhost 192.0.2.1 10"),  # those packets are of IPv4
        ("[::ffff:127.0.0.1]:502", "localhost 10"),
    ],
)
def test_addresses_are_allowed_as_packets_have_them(tmp_path: Path, drives: str, allowed: str) -> None:
    relay, _ = fitted(config_in(tmp_path, drives=f'tcp = "{drives}"'))
    assert f"IPAddressAllow={allowed}" in relay


def test_a_controller_from_anywhere_and_drives_by_name_leave_it_open(tmp_path: Path) -> None:
    config = config_in(tmp_path, drives='tcp = "drives.local:502"', controller='tcp = "0.0.0.0:1502"')
    relay, _ = fitted(config)
    assert relay.startswith(
        "# IPAddressDeny= is left open:\n#   the drives of line xyz: their address is a host name, "
        "drives.local, not an address for systemd\n#   controller cnc of line xyz has no `allow`: it may "
        "come from anywhere\n"
    )


def test_serial_ports_are_allowed_by_their_kind(tmp_path: Path) -> None:
    config = config_in(
        tmp_path,
        drives='rtu = "/dev/serial/by-id/usb-FTDI_B-if00-port0", baudrate = 19200',
        controller='rtu = "/dev/ttyS1"\nbaudrate = 19200',
    )
    relay, _ = fitted(config)
    assert relay == (
        "IPAddressDeny=any\nIPAddressAllow=localhost\nDeviceAllow=\n"
        "DeviceAllow=char-ttyUSB rw\nDeviceAllow=char-ttyACM rw\nDeviceAllow=char-ttyS rw\n"
    )
    config = config_in(tmp_path, drives='rtu = "/dev/mill-bus", baudrate = 19200')
    relay, _ = fitted(config)
    assert relay.endswith(
        "# DeviceAllow= is left as it is: of what kind /dev/mill-bus is, its name does not say\n"
    )


def test_what_needs_more_gets_it(tmp_path: Path) -> None:
    config = config_in(
        tmp_path, gateway="[relay]\nfifo = 40\nlock_memory = true\n", controller='tcp = "127.0.0.1:502"'
    )
    relay, _ = fitted(config)
    assert relay.endswith(
        "# Ports below 1024: 502.\n"
        "CapabilityBoundingSet=CAP_NET_BIND_SERVICE\nAmbientCapabilities=CAP_NET_BIND_SERVICE\n"
        "# What [relay] asks for, the relay asks the system for when everything is loaded.\n"
        "RestrictRealtime=no\nLimitRTPRIO=40\nLimitMEMLOCK=infinity\n"
        "SystemCallFilter=sched_setscheduler sched_setaffinity setrlimit\n"
        "# In a user namespace of its own neither a capability nor a limit that is raised would count.\n"
        "PrivateUsers=no\n"
    )


def test_a_temperature_sensor_is_let_in_to_the_supervisor(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text("position_mm,correction_mm\n0,0\n100,0.01\n")
    config = config_in(tmp_path, gateway='tables = "."')
    source = '{ modbus = "192.168.0.40:502", address = 100 }'
    with config.open("a") as file:
        file.write(f'table = "x.csv"\nthermal = {{ alpha = 11.5e-6, source = {source} }}\n')
    relay, supervisor = fitted(config)
    assert supervisor == "IPAddressDeny=any\nIPAddressAllow=localhost 192.168.0.40\n"
    assert "192.168.0.40" not in relay


def with_contact(folder: Path, device: str) -> Path:
    """A configuration with a contact, whose section stands before all others."""
    config = config_in(folder)
    config.write_text(f"[alarm_output]\ndevice = {device}\ncoil = 0\n{config.read_text()}")
    return config


def test_the_module_of_a_contact_is_let_in_to_the_supervisor(tmp_path: Path) -> None:
    relay, supervisor = fitted(with_contact(tmp_path, '{ tcp = "192.168.0.50:502" }'))
    assert supervisor == "IPAddressDeny=any\nIPAddressAllow=localhost 192.168.0.50\n"
    assert "192.168.0.50" not in relay


@pytest.mark.parametrize(
    ("device", "kinds"),
    [
        ("/dev/ttyS9", ["ttyS"]),
        ("/dev/serial/by-id/usb-contact", ["ttyUSB", "ttyACM"]),
        ("/dev/contact", ["ttyUSB", "ttyACM", "ttyAMA", "ttymxc", "ttyS"]),  # nobody knows what that will be
    ],
)
def test_the_serial_port_of_a_contact_is_let_in_to_the_supervisor_alone(
    tmp_path: Path, device: str, kinds: list[str]
) -> None:
    without, _ = fitted(config_in(tmp_path))
    relay, supervisor = fitted(with_contact(tmp_path, f'{{ rtu = "{device}" }}'))
    assert relay == without
    assert supervisor == (
        "IPAddressDeny=any\nIPAddressAllow=localhost\n# The serial port of [alarm_output].\n"
        "PrivateDevices=no\nSupplementaryGroups=dialout\n"
        + "".join(f"DeviceAllow=char-{kind} rw\n" for kind in kinds)
    )


@pytest.mark.parametrize("is_group", [True, False])
def test_the_line_of_a_contact_is_let_in_to_the_supervisor_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_group: bool
) -> None:
    """Without the group systemd would not start the service at all."""
    group = grp.getgrgid(os.getgid())

    def named(name: str) -> grp.struct_group:
        if not is_group or name != "gpio":
            raise KeyError(name)
        return group

    monkeypatch.setattr(grp, "getgrnam", named)
    config = config_in(tmp_path)
    without, _ = fitted(config)
    config.write_text(
        f'[alarm_output]\ngpio = {{ chip = "/dev/gpiochip0", line = 17 }}\n{config.read_text()}'
    )
    relay, supervisor = fitted(config)
    assert relay == without
    assert supervisor == (
        "IPAddressDeny=any\nIPAddressAllow=localhost\n"
        "# The GPIO line of [alarm_output]: docs/install.md has the group and the udev rule.\n"
        "PrivateDevices=no\n"
        + ("SupplementaryGroups=gpio\n" if is_group else "# There is no group gpio here.\n")
        + "DeviceAllow=char-gpiochip rw\n"
    )


def test_secrets_are_handed_to_both(tmp_path: Path) -> None:
    loaded = load(config_in(tmp_path))
    broker = {"password_file": "credential:mqtt", "tls": {"key": "credential:mqtt-key", "ca": "ca.pem"}}
    said = {**loaded.document.tables, "mqtt": broker, "list": [{"file": "credential:mqtt"}]}
    relay, supervisor = drop_ins(replace(loaded, document=replace(loaded.document, tables=said))).values()
    lines = (
        "LoadCredential=mqtt:/etc/pitch-gateway/secrets/mqtt\n"
        "LoadCredential=mqtt-key:/etc/pitch-gateway/secrets/mqtt-key\n"
    )
    assert relay.endswith(f"PrivateDevices=yes\n{lines}")
    assert supervisor.endswith(f"IPAddressAllow=localhost\n{lines}")


def test_it_writes_what_has_changed_and_nothing_else(tmp_path: Path) -> None:
    config = config_in(tmp_path)
    units = tmp_path / "units"
    command = ["service", str(config), "--systemd", str(units), "--json"]
    for expected in ([True, True], [False, False]):
        files = json.loads(CliRunner().invoke(app, command).stdout)["files"]
        assert [each["changed"] for each in files] == expected
    relay = units / "pitch-gateway-relay.service.d" / "configuration.conf"
    assert relay.stat().st_mode & 0o777 == 0o644
    before = relay.stat().st_mtime_ns
    config_in(tmp_path, http="")
    again = json.loads(CliRunner().invoke(app, command).stdout)["files"]
    assert [each["changed"] for each in again] == [False, False]
    assert relay.stat().st_mtime_ns == before
    config_in(tmp_path, controller='tcp = "0.0.0.0:1502"\nallow = ["10.3.0.0/16"]')
    again = json.loads(CliRunner().invoke(app, command).stdout)["files"]
    assert [each["changed"] for each in again] == [True, False]


def test_a_folder_that_cannot_be_written_is_named_with_the_remedy(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    result = CliRunner().invoke(
        app, ["service", str(config_in(tmp_path)), "--systemd", str(tmp_path / "file")]
    )
    assert result.exit_code == 1
    assert "cannot be written" in result.output
    assert "--systemd" in result.output


def test_init_fits_the_units_to_what_it_wrote(tmp_path: Path) -> None:
    config, units = tmp_path / "mill.toml", tmp_path / "units"
    answers = ["--controller-compensation-off", "--drive", "oriental-az", "--units", "mm", "--unit-id", "1"]
    places = ["--drives-at", "10.0.0.5:502", "--controller-at", "127.0.0.1:1502", "--travel", "-300", "0"]
    more = ["--counts-per-unit", "1000", "--no-ask", "--systemd", str(units)]
    result = CliRunner().invoke(app, ["init", str(config), *answers, *places, *more])
    assert result.exit_code == 0, result.output
    text = (units / "pitch-gateway-relay.service.d" / "configuration.conf").read_text()
    assert "IPAddressAllow=localhost 10.0.0.5\n" in text
    # The units let it write nowhere else.
    assert '\nstate = "/var/lib/pitch-gateway"' in config.read_text()


def test_a_state_folder_that_the_units_keep_closed_is_said(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["service", str(config_in(tmp_path))])
    assert result.exit_code == 0
    assert f"the state is in {tmp_path}/state; write state = " in result.stderr
    fits = config_in(tmp_path, gateway='state = "/var/lib/pitch-gateway"')
    assert CliRunner().invoke(app, ["service", str(fits)]).stderr == ""


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be another user")
def test_init_in_a_folder_that_may_not_be_entered_says_so() -> None:
    with tempfile.TemporaryDirectory() as folder, lesser() as somebody:  # pytest's own folders are all closed
        ended = somebody.run("init {} --no-ask", f"{folder}/gateway.toml")
    assert ended.returncode == 1
    assert ended.stderr.startswith(f"{folder}/gateway.toml cannot be written ({folder} is not writable)")


def test_no_text_of_a_configuration_becomes_a_line_of_a_unit(tmp_path: Path) -> None:
    """Whoever may save the configuration is not root; whoever runs this is."""
    mqtt = '[mqtt]\nhost = "127.0.0.1"\nusername = "credential:key\\nExecStartPre=+/bin/sh"\n'
    relay, supervisor = fitted(config_in(tmp_path, more=mqtt))
    assert "ExecStartPre" not in relay + supervisor
