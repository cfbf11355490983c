"""The configuration is reloaded where that is safe; what needs a restart is named, and nothing changes."""

import json
import signal
from typing import Any

from gateway.ipc.client import ask
from gateway.ipc.messages import GetStatus, Status
from tests.support.commands import typed
from tests.support.config import STEEPER
from tests.support.gateway import Master, Site, gateway_of
from tests.support.processes import eventually
from tests.support.status_models import plain


def axis_status(site: Site) -> dict[str, Any]:
    status = ask(site.socket, GetStatus())
    assert isinstance(status, Status)
    axis: dict[str, Any] = plain(status.status.axes["x"])
    return axis


def test_gain_and_limits_are_taken_over_while_it_runs(site: Site) -> None:
    config = str(site.config)
    text = site.config.read_text()
    with gateway_of(site) as (gateway, master):
        assert typed("reload", config).stdout == "nothing has changed\n"  # the supervisor has read it, too
        assert master.move(50_000) == 50_050
        typed("reload", config)  # the supervisor reads it by itself when it finds the relay: be after that
        site.change('table = "x.tab"', 'table = "x.tab"\ngain = 0.5\nbudget_us = 250')
        done = typed("reload", config)
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.splitlines() == [
            "x: its new correction is applied at the next different target",
            "applied now: axis.x.gain, axis.x.budget_us",
        ]
        status = axis_status(site)
        assert status["gain"] == {"forward": 0.5, "backward": 0.5}
        assert status["latency"]["budget_us"] == 250.0
        assert master.move(50_000) == 50_050
        assert master.move(50_002) == 50_027
        site.config.write_text(text)
        assert typed("reload", config).returncode == 0
        assert master.move(50_000) == 50_050
        assert axis_status(site)["latency"]["budget_us"] == 1000.0
    assert [note["keys"] for note in gateway.notes if note["event"] == "configuration-changed"] == [
        ["axis.x.gain", "axis.x.budget_us"]
    ] * 2


def there_and_back(master: Master) -> tuple[int, int]:
    """Stream an axis forward to 60 mm and back to 40 mm; returns what its drive is told at both ends."""
    forward = [master.move(target) for target in range(40_000, 60_001, 1_000)]
    backward = [master.move(target) for target in range(59_000, 39_999, -1_000)]
    return forward[-1], backward[-1]


def test_a_table_comes_and_goes_beside_a_backlash(site: Site) -> None:
    config = str(site.config)
    keys = 'setpoints = "stream"\nreversal = "step"\nbacklash = { width = 0.2, kind = "homed-forward" }'
    text = site.config.read_text().replace('table = "x.tab"', f'table = "x.tab"\n{keys}')
    alone = text.replace('table = "x.tab"\n', "")
    site.config.write_text(alone)
    with gateway_of(site) as (_, master):
        # homed forward: nothing forward, 0.2 mm less backward
        assert there_and_back(master) == (60_000, 39_800)
        site.config.write_text(text)
        assert typed("reload", config).returncode == 0
        # and 0.001 of the position from the table
        assert there_and_back(master) == (60_060, 39_840)
        site.config.write_text(alone)
        assert typed("reload", config).returncode == 0
        assert there_and_back(master) == (60_000, 39_800)
        assert axis_status(site)["table"]["file"] is None


def status_when(config: str, kinds: list[str]) -> dict[str, Any]:
    """Look until these are the troubles; the supervisor looks five times a second."""

    def are_these(status: dict[str, Any]) -> bool:
        return [each["kind"] for each in status["troubles"] if each["kind"] != "over-budget"] == kinds

    return eventually(lambda: json.loads(typed("status", config, "--json").stdout), are_these)


def test_how_long_a_controller_may_be_silent_is_taken_over_while_it_runs(site: Site) -> None:
    config = str(site.config)
    text = site.config.read_text()
    with gateway_of(site) as (_, master):
        assert master.move(50_000) == 50_050
        status_when(config, [])
        for limit in ("0.001", "90000"):
            site.config.write_text(text.replace('name = "cnc"', f'name = "cnc"\nsilent_after_s = {limit}'))
            done = typed("reload", config)
            assert (done.returncode, done.stderr) == (0, "")
            assert done.stdout == "applied now: line.xyz.controllers[1].silent_after_s\n"
            status = status_when(config, ["controller-silent"] if limit == "0.001" else [])
            [controller] = status["lines"]["xyz"]["controllers"]
            assert controller["silent_after_s"] == float(limit)


def test_what_was_compiled_beside_a_gateway_that_runs_reaches_it_with_the_next_reload(site: Site) -> None:
    config = str(site.config)
    with gateway_of(site) as (_, master):
        assert master.move(50_000) == 50_050
        site.change('table = "x.tab"', 'table = "x.tab"\ngain = 0.5\nbudget_us = 250')
        assert typed("check", "--compile", config).returncode == 0
        assert typed("reload", config).returncode == 0
        status = axis_status(site)
        assert status["gain"] == {"forward": 0.5, "backward": 0.5}
        assert status["configured"]["budget_us"] == status["latency"]["budget_us"] == 250.0
        assert master.move(50_002) == 50_027


def test_a_limit_that_the_table_breaks_changes_nothing(site: Site) -> None:
    text = site.config.read_text()
    with gateway_of(site) as (_, master):
        site.config.write_text(text.replace('table = "x.tab"', 'table = "x.tab"\nmax_correction = 0.05'))
        refused = typed("reload", str(site.config))
        assert refused.returncode == 1
        assert "0.1" in refused.stderr
        assert master.move(100_000) == 100_100


def test_what_needs_a_restart_is_named_and_nothing_changes(site: Site) -> None:
    text = site.config.read_text()
    with gateway_of(site) as (_, master):
        for number, (old, new, said) in enumerate(
            (
                ("counts_per_unit = 1000.0", "counts_per_unit = 2000.0", "axis.x.counts_per_unit"),
                ("unit_id = 1", "unit_id = 2", "axis.x.unit_id"),
                ("[axis.x]", "[relay]\nlock_memory = true\n[axis.x]", "relay.lock_memory"),
            )
        ):
            assert old in text
            site.config.write_text(
                text.replace(old, new).replace('table = "x.tab"', 'table = "x.tab"\ngain = 0.5')
            )
            refused = typed("reload", str(site.config))
            assert refused.returncode == 1
            assert refused.stderr == (
                f"{site.config}: restart the gateway: these keys changed since its start: {said}\n"
            )
            target = 50_000 + 1000 * number
            assert master.move(target) == target + target // 1000
            assert axis_status(site)["gain"] == {"forward": 1.0, "backward": 1.0}


def test_a_table_saved_just_before_a_reload_that_is_refused_comes_into_force_all_the_same(site: Site) -> None:
    text = site.config.read_text()
    with gateway_of(site) as (gateway, master):
        assert typed("reload", str(site.config)).stdout == "nothing has changed\n"  # it watches by now
        assert master.move(50_000) == 50_050
        site.config.write_text(text.replace("unit_id = 1", "unit_id = 2"))
        site.table.write_text(site.table.read_text().replace("50.0 0.05 0.05", "50.0 0.06 0.06"))
        gateway.process.send_signal(signal.SIGHUP)  # at once: before the file has stood still
        assert "axis.x.unit_id" in gateway.until("reload-refused")["problems"][0]
        gateway.until("table-handed-over")
        assert master.move(50_001) == 50_061


def test_a_wrong_configuration_changes_nothing_and_tables_go_on(site: Site) -> None:
    text = site.config.read_text()
    with gateway_of(site) as (gateway, master):
        assert typed("reload", str(site.config)).stdout == "nothing has changed\n"  # it watches by now
        site.config.write_text(text.replace("gain", "").replace("[axis.x]", "[axis.x]\ngains = 0.5"))
        refused = typed("reload", str(site.config), "--json")
        assert refused.returncode == 1
        assert "axis.x.gains" in refused.stderr
        # The tables of the configuration that is in force are still watched.
        site.table.write_text(site.table.read_text().replace("50.0 0.05 0.05", "50.0 0.06 0.06"))
        gateway.until("table-handed-over")
        assert master.move(50_000) == 50_060


def test_a_dry_run_ends_with_a_reload_and_comes_back_with_a_restart_only(site: Site) -> None:
    config, on = str(site.config), site.config.read_text()
    assert on.count('compensation = "on"') == 1
    shadow = on.replace('compensation = "on"', 'compensation = "shadow"')
    site.config.write_text(shadow)
    with gateway_of(site) as (gateway, master):
        assert master.move(50_000) == 50_000
        site.config.write_text(on)
        done = typed("reload", config)
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.splitlines() == [
            "x: its new correction is applied at the next different target",
            "applied now: axis.x.compensation",
        ]
        assert axis_status(site)["compensation"] == "active"
        assert master.move(50_000) == 50_000  # the same target: nothing moves
        assert master.move(60_000) == 60_060
        site.config.write_text(shadow)
        refused = typed("reload", config)
        assert refused.returncode == 1
        assert (
            "axis.x.compensation: restart the gateway, because only a restart sets an axis to shadow"
            in refused.stderr
        )
        assert master.move(50_000) == 50_050
    assert [note["axes"] for note in gateway.notes if note["event"] == "dry-run-ended"] == [["x"]]


def test_a_mode_that_was_or_becomes_off_needs_a_restart_and_is_named(site: Site) -> None:
    on = site.config.read_text()
    for then, now in (("on", "off"), ("off", "on"), ("off", "shadow")):
        site.config.write_text(on.replace('compensation = "on"', f'compensation = "{then}"'))
        with gateway_of(site) as (_, master):
            moved = 50_050 if then == "on" else 50_000
            assert master.move(50_000) == moved
            site.config.write_text(on.replace('compensation = "on"', f'compensation = "{now}"'))
            refused = typed("reload", str(site.config))
            assert (refused.returncode, refused.stdout) == (1, "")
            assert refused.stderr == (
                f"{site.config}: restart the gateway: these keys changed since its start: "
                "axis.x.compensation\n"
            )
            assert master.move(60_000) == (60_060 if then == "on" else 60_000)


def test_the_line_that_the_warning_of_a_missing_mode_names_can_be_written_while_it_runs(site: Site) -> None:
    config, on = str(site.config), site.config.read_text()
    site.config.write_text(on.replace('compensation = "on"\n', ""))
    with gateway_of(site) as (_, master):
        assert master.move(50_000) == 50_050
        checked = typed("check", config)
        assert checked.returncode == 0
        assert "axis.x.compensation: missing: the axis is corrected with its table, as with" in checked.stderr
        assert 'write compensation = "on" below [axis.x]' in checked.stderr
        site.config.write_text(on)
        done = typed("reload", config)
        assert (done.returncode, done.stdout, done.stderr) == (0, "applied now: axis.x.compensation\n", "")
        assert master.move(60_000) == 60_060
    assert "missing" not in typed("check", config).stderr


def test_a_dry_run_that_cannot_end_yet_is_not_said_to_have_ended(site: Site) -> None:
    config, on = str(site.config), site.config.read_text()
    site.config.write_text(on.replace('compensation = "on"', 'compensation = "shadow"'))
    with gateway_of(site) as (gateway, master):
        assert master.move(50_000) == 50_000
        site.drive.is_silent = True
        master.send(60_000)
        assert master.is_answered_with_an_exception()  # nobody knows where it goes
        site.config.write_text(on)
        refused = typed("reload", config)
        assert (refused.returncode, refused.stdout) == (1, "")
        assert "axis x stays in shadow: " in refused.stderr
    assert "dry-run-ended" not in [note["event"] for note in gateway.notes]


# ``reload``: what changed is handed over, and what is wrong is said.


NOTHING = "nothing has changed\n"
"""Also where the supervisor, which watches the files, has been quicker than the command."""


def test_reload_hands_over_what_changed_and_says_what_is_wrong(site: Site) -> None:
    config = str(site.config)
    with gateway_of(site) as (_, master):
        assert master.move(50_000) == 50_050
        same = typed("reload", config)
        assert (same.returncode, same.stdout) == (0, NOTHING)
        site.table.write_text(STEEPER)
        new = typed("reload", config)
        assert (new.returncode, new.stderr) == (0, "")
        assert new.stdout in {"x: its new correction is applied at the next different target\n", NOTHING}
        assert master.move(50_001) == 50_101
        text = site.config.read_text()
        site.config.write_text(text.replace('table = "x.tab"', ""))
        gone = typed("reload", config)
        assert (gone.returncode, gone.stderr) == (0, "")
        assert gone.stdout.splitlines() == [
            "x: it has no table now; the old correction is removed at the next different target",
            "applied now: axis.x.table",
        ]
        assert master.move(50_000) == 50_000
        site.config.write_text(text)
        assert typed("reload", config).returncode == 0
        assert master.move(50_001) == 50_101
        site.table.write_text("no table")
        bad = typed("reload", config, "--json")
        assert bad.returncode == 1
        assert bad.stderr.startswith(f"{site.table}")
        result = json.loads(bad.stdout)
        assert (result["changed"], result["running"]) == ([], True)
        assert result["problems"] == bad.stderr.splitlines()
        assert master.move(50_000) == 50_100
        site.table.write_text(STEEPER)
        site.change("= 1000.0", "= 2000.0")
        other = typed("reload", config)
        assert other.returncode == 1
        assert other.stderr == (
            f"{config}: restart the gateway: these keys changed since its start: axis.x.counts_per_unit\n"
        )
        assert master.move(50_001) == 50_101


def test_without_a_gateway_reload_compiles_for_its_start(site: Site) -> None:
    done = typed("reload", str(site.config))
    assert (done.returncode, done.stdout) == (0, "no gateway runs: all is compiled for its next start\n")
    assert (site.config.parent / "state" / "plan.msgpack").exists()
