"""What counts of a tables folder in which files move."""

import asyncio
import hashlib
import os
import resource
import shutil
import socket
import threading
import time
from pathlib import Path

import pytest

from gateway.config.compile import compile_into_state
from gateway.config.load import Loaded, load, reread_tables
from gateway.exchange.commands import SetTable
from gateway.exchange.limits import limits_of, values_of
from gateway.ipc.messages import Done, Reply, Request, Status
from gateway.state.last_good import last_plan
from gateway.state.plan import read_plan
from gateway.status.axis import AxisStatus, TableStatus
from gateway.status.model import RelayModel
from gateway.supervisor.debounce import FileStamp
from gateway.supervisor.file_stamps import ignore_broken_leases, scan
from gateway.supervisor.table_files import TableFiles
from gateway.supervisor.tables import Reloader
from gateway.supervisor.watching import Watch
from tests.support.config import RAMP, STEEPER, axis, one_axis, section, written
from tests.support.lesser import nobody


@pytest.fixture
def config(tmp_path: Path) -> Path:
    return written(tmp_path, one_axis(drives=1, port=2))


@pytest.fixture
def reloader(config: Path) -> Reloader:
    reloader = Reloader(config)
    assert reloader.reload().problems == ()
    assert largest(config) == 0.1
    return reloader


@pytest.fixture
def pair(config: Path) -> Path:
    """Two axes of a group, each with its table."""
    second = axis("y", unit_id=2, compensation="on", table="y.tab")
    config.write_text(config.read_text() + second + section("[group.beam]", {"axes": ["x", "y"]}))
    table(config, "y").write_text(RAMP.replace("AXIS X", "AXIS Y"))
    return config


def largest(config: Path) -> float | None:
    """Return the largest correction of the table that a relay would start with."""
    found = last_plan(config.parent / "state")
    assert found is not None
    table = found.plan.lines[0].axes[0].table
    return None if table is None else table.max_correction()


def stamp(config: Path) -> FileStamp:
    return scan(config.parent / "tables", ["x.tab"])["x.tab"]


def table(config: Path, axis: str = "x") -> Path:
    return config.parent / "tables" / f"{axis}.tab"


def test_a_file_that_changed_since_it_was_seen_to_stand_still_waits(config: Path, reloader: Reloader) -> None:
    before = stamp(config)
    table(config).write_text(STEEPER)
    outcome = reloader.refresh({"x.tab": before})
    assert outcome.waiting == {"x"}
    assert not outcome.stamps
    assert largest(config) == 0.1
    now = stamp(config)
    assert reloader.refresh({"x.tab": now}).stamps == {"x.tab": now}
    assert largest(config) == 0.2


def test_a_file_that_moves_waits_however_good_it_is(config: Path, reloader: Reloader) -> None:
    table(config).write_text(STEEPER)
    assert reloader.refresh({"x.tab": None}).waiting == {"x"}
    assert reloader.reload({"x.tab": None}).waiting == {"x"}
    assert largest(config) == 0.1


def hang_up(listening: socket.socket) -> None:
    listening.accept()[0].close()


def test_a_file_that_moves_is_no_mistake_where_the_relay_is_not_understood(
    config: Path, reloader: Reloader
) -> None:
    table(config).write_text(STEEPER)
    with socket.socket(socket.AF_UNIX) as relay:
        relay.bind(str(config.parent / "state" / "relay.sock"))
        relay.listen()
        threading.Thread(target=hang_up, args=(relay,), daemon=True).start()
        outcome = reloader.refresh({"x.tab": None})
    assert outcome.is_owed
    assert len(outcome.problems) == 1
    assert not outcome.stamps
    assert largest(config) == 0.1


def test_a_table_waits_for_a_relay_whose_socket_is_missing(config: Path, reloader: Reloader) -> None:
    table(config).write_text(STEEPER)
    is_up = True
    supervised = Reloader(config, lambda: is_up)
    outcome = supervised.reload()
    assert outcome.is_owed
    [problem] = outcome.problems
    assert f"{config.parent}/state/relay.sock is missing, although the relay runs" in problem
    assert largest(config) == 0.1
    is_up = False
    outcome = supervised.reload()
    assert (outcome.problems, outcome.is_running) == ((), False)
    assert largest(config) == 0.2


def test_who_asks_gets_what_is_there(config: Path, reloader: Reloader) -> None:
    table(config).write_text(STEEPER)
    assert reloader.reload().waiting == frozenset()
    assert largest(config) == 0.2


def test_who_asks_is_told_which_file_a_program_has_open(config: Path, reloader: Reloader) -> None:
    ignore_broken_leases()
    table(config).write_text(STEEPER)
    with table(config).open("a"):
        outcome = reloader.reload()
    said = "axis.x.table: not taken yet: a program has it open for writing; close it there"
    assert outcome.problems == ()
    (problem,) = outcome.all_problems
    assert problem == f"{table(config)}: {said}, and it is taken when it is complete"
    assert largest(config) == 0.1
    assert reloader.reload().all_problems == ()
    assert largest(config) == 0.2


@pytest.fixture
def unseen(monkeypatch: pytest.MonkeyPatch) -> None:
    """The tables belong to another user: the system does not tell who writes them."""
    monkeypatch.setattr("gateway.supervisor.file_stamps._is_being_written", lambda _path: None)


@pytest.mark.usefixtures("unseen")
def test_a_file_that_has_just_changed_waits_if_the_system_does_not_tell_who_writes_it(
    config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table(config).write_text(RAMP)
    changed_s = stamp(config).changed_ns / 1_000_000_000
    monkeypatch.setattr("gateway.supervisor.tables.wall_s", lambda: changed_s + 9.9)
    starting = Reloader(config)
    outcome = starting.reload({})  # a supervisor starts
    assert (outcome.is_refused, outcome.is_owed) == (True, True)
    table(config).chmod(0o640)  # a new owner, mode or name is no writing
    monkeypatch.setattr("gateway.supervisor.tables.wall_s", lambda: changed_s + 10.1)
    assert starting.reload({}).problems == ()
    assert largest(config) == 0.1


@pytest.mark.usefixtures("unseen")
def test_a_user_who_asks_for_a_reload_says_with_that_that_the_file_is_complete(config: Path) -> None:
    reloader = Reloader(config)
    for text, most in ((RAMP, 0.1), (STEEPER, 0.2)):
        table(config).write_text(text)
        assert reloader.reload().problems == ()
        assert largest(config) == most


def test_a_supervisor_that_starts_while_the_file_is_away_takes_nothing_away(config: Path) -> None:
    assert Reloader(config).reload().problems == ()
    table(config).unlink()
    later = Reloader(config)
    outcome = later.reload({})
    assert outcome.waiting == {"x"}
    assert outcome.problems == ()
    assert largest(config) == 0.1
    assert later.refresh({"x.tab": FileStamp(is_there=False)}).absent == {"x"}
    assert largest(config) is None


def test_a_supervisor_that_starts_while_a_share_is_not_mounted_takes_nothing_away(config: Path) -> None:
    assert Reloader(config).reload().problems == ()
    folder, elsewhere = table(config).parent, config.parent / "elsewhere"
    folder.rename(elsewhere)
    folder.mkdir()
    gone = {"x.tab": FileStamp(is_there=False)}
    said = f"mount the share, or put the tables into {folder}: it is not the folder that had them"
    for later in (Reloader(config), Reloader(config)):  # the second finds what the first has written
        for _ in range(2):
            (problem,) = later.reload(gone).problems
            assert problem.startswith(said)
            assert largest(config) == 0.1
    folder.rmdir()
    elsewhere.rename(folder)
    table(config).unlink()  # from the folder itself it counts
    outcome = later.reload(gone)
    assert (outcome.problems, outcome.absent) == ((), frozenset({"x"}))
    assert largest(config) is None


def test_a_share_that_goes_while_its_tables_are_read_is_known_to_be_another_folder(
    config: Path, reloader: Reloader, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, elsewhere = table(config).parent, config.parent / "elsewhere"

    def reread_and_unmounted(loaded: Loaded) -> Loaded:
        """Between the reading and the next line there is nothing to wait for."""
        found = reread_tables(loaded)
        folder.rename(elsewhere)
        folder.mkdir()
        return found

    with monkeypatch.context() as moment:
        moment.setattr("gateway.supervisor.tables.reread_tables", reread_and_unmounted)
        assert reloader.reload().waiting == {"x"}
    for later in (reloader, Reloader(config)):
        (problem,) = later.reload({"x.tab": FileStamp(is_there=False)}).problems
        assert problem.startswith(
            f"mount the share, or put the tables into {folder}: it is not the folder that had them"
        )
        assert largest(config) == 0.1


def test_a_first_file_that_moves_is_not_compiled_and_is_tried_again(config: Path) -> None:
    reloader = Reloader(config)
    outcome = reloader.reload({"x.tab": None})
    assert (outcome.is_refused, outcome.is_owed) == (True, True)
    assert "x.tab: the file is being saved" in outcome.problems[0]
    assert last_plan(config.parent / "state") is None
    assert reloader.retry({"x.tab": stamp(config)}).problems == ()
    assert largest(config) == 0.1


@pytest.fixture
def running(monkeypatch: pytest.MonkeyPatch) -> None:
    """A relay runs this plan and takes all that it is given."""
    monkeypatch.setattr("gateway.supervisor.tables._check_same", lambda *_: True)
    monkeypatch.setattr("gateway.supervisor.tables._hand_over", lambda *given: given[-1])


@pytest.mark.usefixtures("running")
@pytest.mark.parametrize(
    ("right", "wrong"),
    [('table = "x.tab"', 'table = "xx.tab"'), ('name = "trial"', 'name = "trial"\ntables = "tbles"')],
    ids=["table", "tables"],
)
def test_a_slip_in_the_name_of_a_table_or_its_folder_takes_no_correction_away(
    config: Path, reloader: Reloader, right: str, wrong: str
) -> None:
    (config.parent / "tbles").mkdir()
    text = config.read_text()
    config.write_text(text.replace(right, wrong))
    outcome = reloader.reload()
    assert (outcome.is_refused, outcome.is_owed, outcome.gone) == (True, False, ())
    (problem,) = outcome.problems
    assert f"{config}:" in problem
    assert "axis.x.table: there is no x" in problem
    assert reloader.loaded is not None
    assert reloader.loaded.document.text == text
    assert largest(config) == 0.1
    table(config).unlink()  # what is removed on purpose goes, as before
    config.write_text(text)
    assert reloader.reload().absent == {"x"}
    assert largest(config) is None


@pytest.mark.usefixtures("running")
@pytest.mark.parametrize(
    ("folder", "name", "said"),
    [
        ("tables", "new.tab", "new.tab:9: axis.x.table: 1 fields in 'x'"),
        ("others", "x.tab", "others/x.tab:9: axis.x.table: 1 fields in 'x'"),
        ("none", "x.tab", "none: No such file or directory"),
    ],
    ids=["another name", "another folder", "no folder"],
)
def test_no_reload_takes_a_configuration_with_which_no_gateway_starts(
    config: Path, reloader: Reloader, folder: str, name: str, said: str
) -> None:
    if folder != "none":
        (config.parent / folder).mkdir(exist_ok=True)
        (config.parent / folder / name).write_text(f"{RAMP}x\n")
    text = config.read_text()
    changed = text.replace('name = "trial"', f'name = "trial"\ntables = "{folder}"')
    config.write_text(changed.replace('table = "x.tab"', f'table = "{name}"'))
    outcome = reloader.reload()
    assert (outcome.is_refused, outcome.is_owed, outcome.changed) == (True, False, ())
    assert said in outcome.problems[0]
    plan = last_plan(config.parent / "state")
    assert plan is not None
    assert (plan.configuration, plan.plan.lines[0].axes[0].table_name) == (text, "x.tab")


@pytest.mark.usefixtures("running")
def test_a_file_of_another_name_that_moves_is_waited_for_with_all_of_its_configuration(
    config: Path, reloader: Reloader
) -> None:
    (config.parent / "tables" / "new.tab").write_text(STEEPER)
    text = config.read_text()
    config.write_text(text.replace('table = "x.tab"', 'table = "new.tab"'))
    moving = {"x.tab": stamp(config), "new.tab": None}
    outcome = reloader.reload(moving)
    assert (outcome.is_refused, outcome.is_owed, outcome.changed) == (True, True, ())
    assert "new.tab: the file is being saved" in outcome.problems[0]
    assert largest(config) == 0.1
    seen = scan(config.parent / "tables", ["new.tab"])
    assert reloader.retry(seen).changed == ("axis.x.table",)
    assert largest(config) == 0.2


def test_the_same_corrections_in_another_file_are_handed_over_with_its_sum(
    config: Path, reloader: Reloader, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = last_plan(config.parent / "state")
    assert plan is not None
    has = TableStatus(
        file="x.tab",
        format="centroid-3",
        sha256=hashlib.sha256(table(config).read_bytes()).hexdigest(),
        compiled=plan.tables["x"],
        points=3,
    )
    limits = values_of(limits_of(plan.plan.lines[0].axes[0]))
    configured = {"compensation": "on", "gain": {"forward": 1.0, "backward": 1.0}, **limits}
    status = RelayModel(axes={"x": AxisStatus(table=has, configured=configured)})
    given: list[SetTable] = []

    def answer(_path: Path, request: Request, **_more: object) -> Reply:
        if isinstance(request, SetTable):
            given.append(request)
            return Done(changed=("x",), comes={"x": "next-target"})
        return Status(status=status)

    monkeypatch.setattr("gateway.supervisor.tables._check_same", lambda *_: True)
    monkeypatch.setattr("gateway.supervisor.tables.ask", answer)
    assert (reloader.reload().given, given) == ((), [])  # it has that file
    table(config).write_text(f"{RAMP}\n")
    outcome = reloader.reload()
    assert [each.tables[0].sha256 for each in given] == [hashlib.sha256(f"{RAMP}\n".encode()).hexdigest()]
    assert outcome.given == ((given[0], ("x",)),)  # the journal notes it
    assert outcome.comes == {}  # and no correction changes


def test_a_refused_configuration_says_all_and_tells_nothing_of_files(
    config: Path, reloader: Reloader
) -> None:
    config.write_text(config.read_text().replace('table = "x.tab"', 'table = "x.tab"\nmax_correction = 0.05'))
    outcome = reloader.reload()
    assert (outcome.is_refused, outcome.has_read, outcome.is_owed) == (True, False, False)
    assert "max_correction" in outcome.problems[0]
    assert outcome.all_problems == outcome.problems


def test_what_the_disk_refused_is_owed_as_it_was_asked_for(config: Path, reloader: Reloader) -> None:
    text = config.read_text()
    config.write_text(text.replace('table = "x.tab"', 'table = "x.tab"\ngain = 0.5'))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, hard))
    try:
        outcome = reloader.reload()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert (outcome.is_refused, outcome.is_owed) == (True, True)
    config.write_text("half edited")
    outcome = reloader.retry({"x.tab": stamp(config)})
    assert (outcome.problems, outcome.changed) == ((), ("axis.x.gain",))


def test_a_relay_that_comes_back_makes_nobody_read_the_configuration(
    config: Path, reloader: Reloader
) -> None:
    text = config.read_text()
    config.write_text(text.replace('table = "x.tab"', 'table = "x.tab"\ngain = 0.5'))
    outcome = reloader.refresh({"x.tab": stamp(config)})
    assert (outcome.problems, outcome.changed) == ((), ())
    assert reloader.loaded is not None
    assert reloader.loaded.document.text == text


def test_a_relay_that_comes_with_another_configuration_is_followed(config: Path, reloader: Reloader) -> None:
    text = config.read_text().replace('table = "x.tab"', 'table = "x.tab"\ngain = 0.5')
    config.write_text(text)
    assert Reloader(config).reload().changed == ("axis.x.gain",)  # as check --compile would
    config.write_text("half edited")
    assert reloader.refresh({"x.tab": stamp(config)}).problems == ()
    assert reloader.loaded is not None
    assert reloader.loaded.document.text == text


def test_what_somebody_else_compiled_is_not_overwritten_with_what_was_taken_before(
    config: Path, reloader: Reloader
) -> None:
    text = config.read_text().replace("unit_id = 1", "unit_id = 2")
    config.write_text(text)
    compile_into_state(load(config))
    table(config).write_text(STEEPER)
    assert reloader.refresh({"x.tab": stamp(config)}).changed == ()
    compiled = read_plan(config.parent / "state", config)
    assert (compiled.configuration, largest(config)) == (text, 0.2)
    assert reloader.loaded is not None
    assert reloader.loaded.document.text == text


def test_what_somebody_else_compiles_while_the_tables_are_read_stays(
    config: Path, reloader: Reloader, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = config.read_text()

    def compile_meanwhile(loaded: Loaded) -> Loaded:
        read = reread_tables(loaded)
        config.write_text(text.replace("unit_id = 1", "unit_id = 2"))
        compile_into_state(load(config))
        return read

    monkeypatch.setattr("gateway.supervisor.tables.reread_tables", compile_meanwhile)
    (problem,) = reloader.refresh({"x.tab": stamp(config)}).problems
    assert problem.endswith("state/plan.msgpack: another configuration was compiled meanwhile")
    assert read_plan(config.parent / "state", config).configuration == config.read_text()


def shown(reloader: Reloader, config: Path) -> dict[str, tuple[str, str | None]]:
    """Return state and error of each file after a reload that a relay takes, as the status has them."""
    table_files, outcome = TableFiles(), reloader.reload()
    table_files.enter(reloader.names, outcome)
    plan = last_plan(config.parent / "state")
    assert plan is not None
    relay = {
        axis.name: TableStatus(
            sha256=axis.table_digest, points=0 if axis.table is None else len(axis.table.positions)
        )
        for axis in plan.plan.lines[0].axes
    }
    tables = {axis: entry.over(relay[axis]) for axis, entry in table_files.entries(frozenset()).items()}
    return {axis: (found.status, found.error) for axis, found in tables.items()}


def test_a_good_file_that_its_group_holds_back_is_not_called_active(pair: Path) -> None:
    reloader = Reloader(pair)
    assert shown(reloader, pair) == {"x": ("active", None), "y": ("active", None)}
    table(pair, "y").write_text("bad")
    status = shown(reloader, pair)
    assert (status["x"], status["y"][0]) == (("active", None), "rejected")  # what x has is what its file says
    table(pair).write_text(STEEPER)
    status = shown(reloader, pair)
    why = "axis.x.table: not used, because of its group y.tab is missing or faulty; "
    why += "correct y.tab or put it back: axes of a group are corrected together or not at all"
    assert status["x"] == ("rejected", f"{table(pair)}: {why}")
    assert largest(pair) == 0.1
    table(pair, "y").unlink()
    assert shown(reloader, pair) == {"x": ("removed", f"{table(pair)}: {why}"), "y": ("removed", None)}
    assert largest(pair) is None
    table(pair, "y").write_text(RAMP.replace("AXIS X", "AXIS Y"))
    assert shown(reloader, pair) == {"x": ("active", None), "y": ("active", None)}
    assert largest(pair) == 0.2


# What is seen of table files from outside, on a real folder.


NAME = "x.tab"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / NAME).write_text("one")
    return tmp_path


def seen(folder: Path) -> FileStamp:
    return scan(folder, [NAME])[NAME]


def test_the_same_file_looks_the_same(folder: Path) -> None:
    assert seen(folder) == seen(folder)


def test_a_save_in_place_of_the_same_length_is_seen(folder: Path) -> None:
    before = seen(folder)
    times = (folder / NAME).stat()
    (folder / NAME).write_text("two")
    os.utime(folder / NAME, ns=(times.st_atime_ns, times.st_mtime_ns))  # as tools that keep times do
    assert seen(folder) != before


def test_a_file_renamed_over_it_is_seen(folder: Path) -> None:
    before = seen(folder)
    (folder / "new").write_text("two")
    (folder / "new").replace(folder / NAME)
    assert seen(folder) != before


def test_a_swapped_symlink_is_seen_as_kubernetes_does_it(tmp_path: Path) -> None:
    for version in ("..1", "..2"):
        (tmp_path / version).mkdir()
        (tmp_path / version / NAME).write_text(f"table {version}")
    (tmp_path / "..data").symlink_to("..1")
    (tmp_path / NAME).symlink_to(f"..data/{NAME}")
    before = seen(tmp_path)
    (tmp_path / "..data_tmp").symlink_to("..2")
    (tmp_path / "..data_tmp").replace(tmp_path / "..data")
    assert before.is_there
    assert seen(tmp_path).is_there
    assert seen(tmp_path) != before


def test_a_file_that_is_missing_or_renamed_to_bak_is_not_there(folder: Path) -> None:
    (folder / NAME).rename(folder / "x.bak")
    assert not seen(folder).is_there
    (folder / "x.bak").unlink()
    assert not seen(folder).is_there


def test_in_a_folder_that_vanished_nothing_is_gone(folder: Path) -> None:
    before = seen(folder)
    shutil.rmtree(folder)
    assert seen(folder).is_there
    assert seen(folder) != before


def test_a_symlink_loop_is_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / NAME).symlink_to(NAME)
    assert seen(tmp_path).is_there
    assert seen(tmp_path) == seen(tmp_path)


def test_a_file_that_a_program_has_open_for_writing_is_being_written(folder: Path) -> None:
    ignore_broken_leases()
    assert not seen(folder).is_being_written
    with (folder / NAME).open("a"):
        assert seen(folder).is_being_written
    with (folder / NAME).open():
        assert not seen(folder).is_being_written
    assert not seen(folder).is_being_written


def test_who_writes_a_file_of_another_user_is_not_known() -> None:
    with nobody():  # as the service, whose tables root or another user owns
        assert scan(Path("/etc"), ["passwd"])["passwd"].is_being_written is None


@pytest.mark.parametrize(("kind", "is_known"), [("ext4", True), ("nfs4", False), ("cifs", False)])
def test_a_lease_that_a_server_refuses_proves_no_writer(
    folder: Path, monkeypatch: pytest.MonkeyPatch, kind: str, *, is_known: bool
) -> None:
    ignore_broken_leases()
    device = (folder / NAME).stat().st_dev
    mounts = folder / "mountinfo"
    number = f"{os.major(device)}:{os.minor(device)}"
    mounts.write_text(
        f"22 1 254:0 / / rw - ext4 /dev/vda rw\n36 22 {number} / /mnt rw,noatime shared:1 - {kind} a:/b rw\n"
    )
    monkeypatch.setattr("gateway.supervisor.file_stamps.MOUNTS", mounts)
    with (folder / NAME).open("a"):
        assert seen(folder).is_being_written is (True if is_known else None)
    assert seen(folder).is_being_written is False


def test_nothing_but_a_file_is_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / NAME)
    descriptor = os.open(tmp_path / NAME, os.O_RDWR | os.O_NONBLOCK)
    try:
        assert not seen(tmp_path).is_being_written
    finally:
        os.close(descriptor)


# The watch over the tables folder: what it lets be read, and when it looks again.


NAMES = {"x": "x.tab"}


async def test_following_the_same_files_again_does_not_cut_the_rest_short(tmp_path: Path) -> None:
    watch = Watch()
    watch.follow(tmp_path, NAMES)
    await watch.rest()  # woken once, by the files that are new
    watch.follow(tmp_path, NAMES)
    resting = asyncio.create_task(watch.rest())
    for _ in range(5):
        await asyncio.sleep(0)
    is_resting = not resting.done()
    resting.cancel()
    assert is_resting


@pytest.mark.parametrize("turns", range(6))
async def test_a_rest_that_is_woken_and_ended_at_once_ends(turns: int) -> None:
    """``asyncio.wait_for`` of Python 3.11 loses a cancellation that comes with what it waits for."""
    watch = Watch()

    async def go_on() -> None:
        while True:
            await watch.rest()

    resting = asyncio.create_task(go_on())
    for _ in range(5):
        await asyncio.sleep(0)
    watch.wake()
    for _ in range(turns):
        await asyncio.sleep(0)
    resting.cancel()
    for _ in range(10):
        await asyncio.sleep(0)
    assert resting.done()


async def test_a_file_counts_as_it_was_seen_once_it_was_taken(tmp_path: Path) -> None:
    (tmp_path / "x.tab").write_text("one")
    watch = Watch()
    watch.follow(tmp_path, NAMES)
    assert watch.still == {}
    await watch.scan()
    assert watch.still == {"x.tab": None}
    began_s = time.monotonic()
    seen = scan(tmp_path, ["x.tab"])
    watch.take(seen, began_s=began_s)
    assert watch.still == seen
    watch.take({}, waiting={"x"}, began_s=began_s)
    assert watch.moving == {"x"}


async def test_a_file_that_a_program_holds_open_is_overdue_after_half_a_minute(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ignore_broken_leases()
    watch = Watch()
    watch.follow(tmp_path, NAMES)
    with (tmp_path / "x.tab").open("w"):
        await watch.scan()
        assert watch.moving == {"x"}
        assert watch.overdue == frozenset()
        began_s = time.monotonic()
        monkeypatch.setattr("gateway.supervisor.watching.time.monotonic", lambda: began_s + 30.0)
        assert watch.overdue == {"x"}


async def test_a_file_is_unread_until_it_was_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "x.tab").write_text("one")
    watch = Watch()
    watch.follow(tmp_path, NAMES)
    await watch.scan()
    began_s = time.monotonic()
    monkeypatch.setattr("gateway.supervisor.watching.time.monotonic", lambda: began_s + 100.0)
    assert await watch.scan()  # it may be read, and that may fail again and again
    assert watch.moving == frozenset()
    assert watch.unread == {"x"}
    seen = scan(tmp_path, ["x.tab"])
    watch.take(seen, began_s=began_s + 100.0)
    assert watch.unread == frozenset()
    (tmp_path / "x.tab").write_text("another")
    await watch.scan()
    watch.take(scan(tmp_path, ["x.tab"]), began_s=began_s + 100.0)  # as soon as somebody asks
    monkeypatch.setattr("gateway.supervisor.watching.time.monotonic", lambda: began_s + 101.0)
    assert await watch.scan()  # it is read once more
    assert watch.unread == frozenset()


async def test_a_file_that_was_read_since_the_last_look_does_not_move(tmp_path: Path) -> None:
    table = tmp_path / "x.tab"
    table.write_text("one")
    watch = Watch()
    watch.follow(tmp_path, NAMES)
    await watch.scan()
    watch.take(scan(tmp_path, ["x.tab"]), began_s=time.monotonic())
    table.write_text("another")
    began_s = time.monotonic()
    seen = scan(tmp_path, ["x.tab"])  # as a reload that somebody asks for does
    watch.take(seen, began_s=began_s)
    assert watch.moving == frozenset()
    assert watch.still == seen


async def test_a_file_that_changed_while_it_was_read_moves(tmp_path: Path) -> None:
    table = tmp_path / "x.tab"
    table.write_text("one")
    watch = Watch()
    watch.follow(tmp_path, NAMES)
    began_s = time.monotonic()
    seen = scan(tmp_path, ["x.tab"])
    table.write_text("another")
    await watch.scan()
    watch.take(seen, began_s=began_s)
    assert watch.moving == {"x"}


async def test_what_was_seen_in_another_folder_says_nothing(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "x.tab").write_text("one")
    watch = Watch()
    watch.follow(tmp_path, NAMES)
    await watch.scan()
    watch.follow(tmp_path / "other", NAMES)
    assert (dict(watch.still), dict(watch.stamps)) == ({}, {})
