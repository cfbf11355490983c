"""Signed tables while a gateway runs: what is taken over, and when a signature is waited for."""

import asyncio
import os
import time
from pathlib import Path

import pytest

from gateway.ipc.log import LogEntry
from gateway.state.last_good import last_plan
from gateway.supervisor.debounce import UNSIGNED_S, FileStamp
from gateway.supervisor.file_stamps import ignore_broken_leases, scan
from gateway.supervisor.interventions import Cause
from gateway.supervisor.supervisor import Supervisor
from gateway.supervisor.tables import Reloader
from gateway.supervisor.watching import Watch
from tests.support.config import STEEPER, axis, gateway_toml, line, section, written
from tests.support.signing import Signer, needs_ssh_keygen

pytestmark = needs_ssh_keygen
CONFIG = gateway_toml(line(1, {"cnc": 2}), axis(compensation="on", table="x.tab"), allowed_signers="signers")


@pytest.fixture(scope="module")
def eva(tmp_path_factory: pytest.TempPathFactory) -> Signer:
    return Signer(tmp_path_factory.mktemp("keys"), "eva")


@pytest.fixture
def config(tmp_path: Path, eva: Signer) -> Path:
    path = written(tmp_path, CONFIG)
    (tmp_path / "signers").write_text(eva.line())
    eva.sign(table(path))
    return path


@pytest.fixture
def reloader(config: Path) -> Reloader:
    reloader = Reloader(config)
    assert reloader.reload().all_problems == ()
    assert largest(config) == 0.1
    return reloader


def table(config: Path) -> Path:
    return config.parent / "tables" / "x.tab"


def stamp(config: Path) -> FileStamp:
    return scan(config.parent / "tables", ["x.tab"], signed=True)["x.tab"]


def largest(config: Path) -> float | None:
    found = last_plan(config.parent / "state")
    assert found is not None
    in_force = found.plan.lines[0].axes[0].table
    return None if in_force is None else in_force.max_correction()


def test_an_unsigned_table_changes_nothing_and_a_signed_one_is_taken(
    config: Path, reloader: Reloader, eva: Signer
) -> None:
    table(config).write_text(STEEPER)
    outcome = reloader.refresh({"x.tab": stamp(config)})
    (problem,) = outcome.rejected["x"]
    assert (problem.file, problem.key) == (str(table(config)), "axis.x.table")
    assert problem.remedy.startswith("sign it again: ssh-keygen -Y sign -n pitch-gateway -f KEY ")
    assert largest(config) == 0.1
    eva.sign(table(config))
    assert reloader.refresh({"x.tab": stamp(config)}).all_problems == ()
    assert largest(config) == 0.2


def test_a_reload_that_somebody_asks_for_takes_no_unsigned_table_either(
    config: Path, reloader: Reloader
) -> None:
    table(config).write_text(STEEPER)
    (said,) = reloader.reload().all_problems
    assert said.startswith(f"{table(config)}: axis.x.table: x.tab.sig is no signature of this content (")
    assert largest(config) == 0.1


def test_a_reload_asks_for_signatures_from_now_on_and_is_refused_until_there_are(
    config: Path, eva: Signer
) -> None:
    signature = table(config).with_name("x.tab.sig")
    signature.unlink()
    config.write_text(CONFIG.replace('allowed_signers = "signers"\n', ""))
    reloader = Reloader(config)
    assert reloader.reload().all_problems == ()
    config.write_text(CONFIG)
    outcome = reloader.reload()
    assert (outcome.is_refused, outcome.is_owed, outcome.changed) == (True, False, ())
    assert "not signed: there is no x.tab.sig; sign it: ssh-keygen " in outcome.problems[0]
    assert reloader.loaded is not None
    assert reloader.loaded.sections.allowed_signers is None
    eva.sign(table(config))
    assert reloader.reload().changed == ("gateway.allowed_signers",)
    assert reloader.loaded.sections.allowed_signers == config.parent / "signers"


def test_of_a_group_none_is_taken_while_one_is_not_signed(config: Path, eva: Signer) -> None:
    second = axis("y", unit_id=2, compensation="on", table="y.tab")
    config.write_text(CONFIG + second + section("[group.beam]", {"axes": ["x", "y"]}))
    other = table(config).with_name("y.tab")
    other.write_text(table(config).read_text().replace("AXIS X", "AXIS Y"))
    eva.sign(other)
    reloader = Reloader(config)
    assert reloader.reload().all_problems == ()
    for path in (table(config), other):
        path.write_text(STEEPER.replace("AXIS X", f"AXIS {path.stem.upper()}"))
    eva.sign(table(config))
    outcome = reloader.reload()
    assert (set(outcome.rejected), set(outcome.held), largest(config)) == ({"y"}, {"x"}, 0.1)
    eva.sign(other)
    assert reloader.reload().all_problems == ()
    assert largest(config) == 0.2


@pytest.mark.parametrize("way", ["http", "mqtt"])
async def test_whoever_asks_a_supervisor_for_a_reload_gets_the_same_answer(config: Path, way: str) -> None:
    Reloader(config).reload()
    notes: list[LogEntry] = []
    supervisor = Supervisor(config, config.parent / "state", notes.append)
    running = asyncio.create_task(supervisor.run())
    first = await asyncio.wait_for(supervisor.reload(Cause(way)), 30.0)
    table(config).write_text(STEEPER)
    outcome = await asyncio.wait_for(supervisor.reload(Cause(way)), 30.0)
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    assert (first.all_problems, set(outcome.rejected), largest(config)) == ((), {"x"}, 0.1)
    assert "table-rejected" in [note.event for note in notes]


# When a signature is waited for.


def test_a_signature_is_a_part_of_its_file(config: Path, eva: Signer) -> None:
    before = stamp(config)
    assert not before.is_signature_due
    eva.sign(table(config))  # ed25519 signs the same content with the same bytes: it is another file
    assert stamp(config).mark != before.mark
    table(config).with_name("x.tab.sig").unlink()
    assert stamp(config).mark != before.mark
    assert stamp(config).is_signature_due


def test_whether_one_is_asked_for_makes_no_other_file(config: Path) -> None:
    """Otherwise a reload with the new key would wait for files that do not change."""
    table(config).with_name("x.tab.sig").unlink()
    assert scan(table(config).parent, ["x.tab"])["x.tab"] == stamp(config)
    assert not scan(table(config).parent, ["x.tab"])["x.tab"].is_signature_due


def test_an_older_signature_is_due_and_a_newer_or_equally_old_one_is_not(config: Path) -> None:
    signature = table(config).with_name("x.tab.sig")
    for signed_ns, is_due in ((999, True), (1000, False), (1001, False)):
        os.utime(table(config), ns=(0, 1000))
        os.utime(signature, ns=(0, signed_ns))
        assert stamp(config).is_signature_due is is_due


def test_a_signature_that_a_program_has_open_is_being_written(config: Path) -> None:
    ignore_broken_leases()
    assert stamp(config).is_being_written is False
    with table(config).with_name("x.tab.sig").open("a"):
        assert stamp(config).is_being_written is True


async def test_a_table_that_comes_before_its_signature_waits_for_it(
    config: Path, eva: Signer, monkeypatch: pytest.MonkeyPatch
) -> None:
    watch = Watch()
    watch.follow(table(config).parent, {"x": "x.tab"}, signed=True)
    watch.take(scan(table(config).parent, ["x.tab"], signed=True), began_s=time.monotonic())
    table(config).write_text(STEEPER)
    os.utime(table(config))
    await watch.scan()
    began_s = time.monotonic()

    def after(seconds: float) -> None:
        monkeypatch.setattr("gateway.supervisor.watching.time.monotonic", lambda: began_s + seconds)

    after(UNSIGNED_S - 1.0)
    assert not await watch.scan()
    assert watch.moving == {"x"}
    eva.sign(table(config))
    assert not await watch.scan()  # it has just changed
    after(UNSIGNED_S - 0.4)
    assert await watch.scan()  # complete for 0.6 s
    assert watch.moving == frozenset()


async def test_a_table_that_nobody_signs_is_read_in_the_end(
    config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    watch = Watch()
    watch.follow(table(config).parent, {"x": "x.tab"}, signed=True)
    table(config).with_name("x.tab.sig").unlink()
    await watch.scan()
    began_s = time.monotonic()
    monkeypatch.setattr("gateway.supervisor.watching.time.monotonic", lambda: began_s + UNSIGNED_S + 1.0)
    assert await watch.scan()


def test_a_supervisor_that_starts_between_table_and_signature_waits_too(
    config: Path, reloader: Reloader, monkeypatch: pytest.MonkeyPatch
) -> None:
    table(config).write_text(STEEPER)
    os.utime(table(config), ns=(0, table(config).stat().st_mtime_ns + 1_000_000_000))
    changed_s = table(config).stat().st_mtime
    monkeypatch.setattr("gateway.supervisor.tables.wall_s", lambda: changed_s + UNSIGNED_S - 0.1)
    outcome = Reloader(config).reload({})
    assert (set(outcome.waiting), set(outcome.rejected), outcome.problems) == ({"x"}, set(), ())
    monkeypatch.setattr("gateway.supervisor.tables.wall_s", lambda: changed_s + UNSIGNED_S + 0.1)
    assert set(Reloader(config).reload({}).rejected) == {"x"}
    assert largest(config) == 0.1
