"""The compiled plan: everything survives, and nothing old or damaged is ever run."""

import os
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path

import msgspec
import pytest

import gateway
from gateway.compensation.backlash import with_backlash
from gateway.config.compile import compile_into_state
from gateway.config.load import Loaded, load
from gateway.drives import library
from gateway.drives.profile import Transport
from gateway.exchange.plan import OtherUnits
from gateway.relay.gateway import Relay
from gateway.state.folder import PLAN_NAME, StateError, state_folder
from gateway.state.last_good import last_plan
from gateway.state.plan import (
    DamagedError,
    in_force,
    newer_release,
    read_plan,
    refuse_newer,
    sealed,
    shape_of,
    unsealed,
    writer_of,
)
from gateway.state.tables import (
    OTHERS_KEPT,
    WrongTableError,
    checked,
    digest_of,
    find_table,
    table_path,
)
from tests.support.config import RAMP, axis, gateway_toml, line, tcp, written

ROOT = Path(__file__).parents[2]
CONFIG = gateway_toml(
    line(
        502,
        {
            "cnc": {**tcp(1502), "allow": ["127.0.0.0/8", "::1/128"]},
            "plc": {"rtu": "/dev/serial/by-id/usb-A", "role": "operator"},
        },
    ),
    axis(
        registers={
            "command": [{"address": 100, "type": "int32", "words": "low-first"}],
            "bits": {"homed": {"address": 7, "bit": 3}},
        },
        compensation="on",
        table="x.tab",
        backlash={"width": 0.02, "kind": "two-sided"},
        gain={"forward": 1.0, "backward": 0.5},
    ),
)


@pytest.fixture
def config(tmp_path: Path) -> Path:
    return written(tmp_path, CONFIG)


def compiled_and_read(path: Path) -> Loaded:
    loaded = load(path)
    compile_into_state(loaded)
    found = read_plan(state_folder(path), path)
    # Tables compare by their points: those of the file and those in memory are the same doubles.
    assert found.plan == in_force(loaded.plan)
    assert found.shape == shape_of(loaded.plan)
    return loaded


def test_every_field_of_a_plan_survives(config: Path) -> None:
    loaded = compiled_and_read(config)
    (axis,) = read_plan(loaded.state_folder, config).plan.lines[0].axes
    assert axis.table is not None
    # Half of 0.02 mm each way; 0.05 mm in the middle.
    assert list(axis.table.forward) == [0.01, pytest.approx(0.06), pytest.approx(0.11)]
    assert list(axis.table.backward) == [-0.01, pytest.approx(0.04), pytest.approx(0.09)]
    assert (
        axis.table.facts
        == with_backlash(
            loaded.tables["x"].table,
            loaded.plan.lines[0].axes[0].settings.backlash,  # type: ignore[arg-type]
        ).facts
    )


@pytest.mark.parametrize("example", ["gateway.example.toml", "gateway.profile.example.toml"])
def test_the_plans_of_the_examples_survive(tmp_path: Path, example: str) -> None:
    for table in (ROOT / "deploy" / "tables").iterdir():
        (tmp_path / "tables").mkdir(exist_ok=True)
        (tmp_path / "tables" / table.name).write_bytes(table.read_bytes())
    path = tmp_path / example
    path.write_text((ROOT / "deploy" / example).read_text().replace("/var/lib/pitch-gateway", "state"))
    compiled_and_read(path)


@pytest.mark.parametrize("name", library.names())
def test_the_plans_of_all_shipped_drives_survive(config: Path, name: str) -> None:
    text = config.read_text().replace('table = "x.tab"', f'table = "x.tab"\ndrive = "{name}"')
    text = "\n".join(line for line in text.splitlines() if not line.startswith("registers."))
    if Transport.TCP not in library.shipped(name).transports:
        text = text.replace('{ tcp = "127.0.0.1:502" }', '{ rtu_over_tcp = "127.0.0.1:502" }')
    config.write_text(text)
    compiled_and_read(config)


def test_before_it_was_compiled_the_command_is_said(config: Path) -> None:
    with pytest.raises(StateError) as caught:
        read_plan(state_folder(config), config)
    assert str(caught.value) == (
        f"it has not been compiled yet: there is no {config.parent}/state/plan.msgpack; "
        f"run: pitch-gateway check --compile {config}"
    )


def test_a_configuration_that_changed_since_is_not_run_from_an_old_plan(config: Path) -> None:
    compile_into_state(load(config))
    config.write_text(config.read_text() + "# a remark\n")
    with pytest.raises(
        StateError, match=r"gateway\.toml has changed since it was compiled; run: pitch-gateway"
    ):
        read_plan(state_folder(config), config)


def test_a_profile_that_changed_since_is_noticed_too(config: Path) -> None:
    own = config.parent / "mine.toml"
    own.write_bytes((Path(gateway.__file__).parent / "drives" / "profiles" / "tl-r.toml").read_bytes())
    text = config.read_text().replace('table = "x.tab"', 'table = "x.tab"\ndrive = "./mine.toml"')
    config.write_text("\n".join(line for line in text.splitlines() if not line.startswith("registers.")))
    config.write_text(config.read_text().replace('{ tcp = "127.0.0.1:502" }', '{ rtu = "/dev/ttyS9" }'))
    compiled_and_read(config)
    own.write_text(own.read_text() + "# a remark\n")
    with pytest.raises(StateError, match=r"mine\.toml has changed since it was compiled"):
        read_plan(state_folder(config), config)


def test_the_plan_of_another_configuration_is_refused(config: Path) -> None:
    compile_into_state(load(config))
    other = config.with_name("other.toml")
    other.write_text(config.read_text())
    with pytest.raises(StateError, match=r"was compiled from .*gateway\.toml, not from .*other\.toml"):
        read_plan(state_folder(other), other)


def test_the_plan_of_another_release_is_refused(config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(gateway, "__version__", "0.0.9")
        compile_into_state(load(config))
    with pytest.raises(StateError, match=r"was made by release 0\.0\.9, and this is release"):
        read_plan(state_folder(config), config)


def damaged(good: bytes) -> Iterator[bytes]:
    """A file with each of its bytes changed, the file cut behind it, and the byte doubled."""
    for n, byte in enumerate(good):
        yield from (good[:n] + bytes((byte ^ bit,)) + good[n + 1 :] for bit in (1, 0x20, 0x80))
        yield good[:n]
        yield good[: n + 1] + good[n:]


def test_a_plan_is_known_to_be_damaged_wherever_a_byte_is_wrong(config: Path) -> None:
    compile_into_state(load(config))
    good = (state_folder(config) / PLAN_NAME).read_bytes()
    for content in damaged(good):
        with pytest.raises(DamagedError):
            unsealed(content)


def test_a_damaged_plan_is_refused_and_made_anew(config: Path) -> None:
    loaded = load(config)
    compile_into_state(loaded)
    state = state_folder(config)
    path = state / PLAN_NAME
    good = path.read_bytes()
    for content in islice(damaged(good), 0, None, 101):  # of five for each byte: all kinds, all over the file
        path.write_bytes(content)
        with pytest.raises(StateError, match="check --compile"):
            read_plan(state, config)
        assert last_plan(state) is None
        assert newer_release(state) == ""
        refuse_newer(state, writer_of(state))  # which `check --compile` asks first
    compile_into_state(loaded)
    assert path.read_bytes() == good


def test_a_table_is_known_to_be_damaged_wherever_a_byte_is_wrong_and_made_anew(config: Path) -> None:
    loaded = load(config)
    good = compile_into_state(loaded)["x"]
    for content in damaged(good):
        with pytest.raises(WrongTableError):
            checked(content)
    path = table_path(state_folder(config), digest_of(good))
    path.write_bytes(good[:-1])
    with pytest.raises(StateError, match="check --compile"):
        read_plan(state_folder(config), config)
    compile_into_state(loaded)
    assert path.read_bytes() == good


def test_a_plan_that_holds_something_else_is_refused(config: Path) -> None:
    compile_into_state(load(config))
    path = state_folder(config) / PLAN_NAME
    file = msgspec.msgpack.decode(unsealed(path.read_bytes()))
    file["plan"]["lines"][0]["drives"]["type"] = "PigeonEndpoint"
    path.write_bytes(sealed(msgspec.msgpack.encode(file)))
    with pytest.raises(StateError, match=r"is not understood: .*PigeonEndpoint"):
        read_plan(state_folder(config), config)


def test_a_damaged_table_file_is_refused(config: Path) -> None:
    data = compile_into_state(load(config))["x"]
    path = table_path(state_folder(config), digest_of(data))
    path.write_bytes(data[:-1] + b"\xff")
    with pytest.raises(StateError, match="the points of the compiled table are damaged"):
        read_plan(state_folder(config), config)
    path.unlink()
    with pytest.raises(StateError, match="no such file"):
        read_plan(state_folder(config), config)


def test_of_tables_that_no_axis_has_any_more_only_the_newest_stay(config: Path) -> None:
    state = state_folder(config)
    digests = []
    for number in range(OTHERS_KEPT + 3):
        (config.parent / "tables" / "x.tab").write_text(RAMP.replace("0.05", f"0.0{number + 1}"))
        digests.append(digest_of(compile_into_state(load(config))["x"]))
        os.utime(state / "tables" / f"{digests[-1]}.doubles", (number, number))
    assert len(set(digests)) == OTHERS_KEPT + 3
    left = {path.name for path in (state / "tables").iterdir()}
    assert left == {f"{digest}.doubles" for digest in digests[-OTHERS_KEPT - 1 :]}
    table = find_table(state, bytes.fromhex(digests[-2])[:16])
    assert table is not None
    assert table.digest == digests[-2]
    assert find_table(state, bytes.fromhex(digests[0])[:16]) is None
    assert sorted(path.name for path in state.iterdir()) == ["plan.msgpack", "tables"]


def test_a_file_where_the_state_folder_should_be_is_said(config: Path) -> None:
    loaded = load(config)
    (config.parent / "state").write_text("")
    with pytest.raises(StateError, match=r"gateway\.state: .*state.*: File exists"):
        compile_into_state(loaded)


def test_the_shape_of_a_plan_does_not_hang_on_its_tables(config: Path) -> None:
    plan = load(config).plan
    (line,) = plan.lines
    (axis,) = line.axes
    bare = replace(axis, table=None, table_name="", table_digest="")
    assert shape_of(replace(plan, lines=(replace(line, axes=(bare,)),))) == shape_of(plan)
    moved = replace(axis, unit_id=2)
    assert shape_of(replace(plan, lines=(replace(line, axes=(moved,)),))) != shape_of(plan)


def test_the_shape_does_not_hang_on_the_order_of_a_set(config: Path) -> None:
    plan = load(config).plan
    (line,) = plan.lines
    shapes = set()
    for unit_ids in ([8, 16], [16, 8]):  # of one place in a hash table of 8: the first one comes first
        others = OtherUnits(frozenset(unit_ids))
        assert list(others.unit_ids) == unit_ids
        shapes.add(shape_of(replace(plan, lines=(replace(line, other_units=others),))))
    assert len(shapes) == 1


def test_a_relay_names_the_shape_that_was_compiled(config: Path) -> None:
    loaded = load(config)
    (line,) = loaded.plan.lines
    # A whole number where a float belongs is a float when it is read back, and has another digest.
    plan = replace(loaded.plan, lines=(replace(line, timing=replace(line.timing, retry_ms=2500)),))
    compile_into_state(loaded, plan)
    found = read_plan(loaded.state_folder, config)
    assert found.plan == in_force(plan)
    assert Relay(found.plan, shape=found.shape).shape == shape_of(plan) != shape_of(found.plan)
