"""``include``: one configuration from several files, and who wins."""

import shutil
import tomllib
from pathlib import Path

import pytest

from gateway.cli.configuration import state_folder_or_exit
from gateway.cli.looking import _silent_after_s
from gateway.commissioning.evidence.folder import without_secrets
from gateway.commissioning.recordings import plan_of
from gateway.config.compile import compile_into_state
from gateway.config.findings import parse_document
from gateway.config.included import read_configuration
from gateway.config.load import Loaded, load
from gateway.config.problems import ConfigErrors, Problem
from gateway.config.recording_header import header_of
from gateway.config.resolved import settings_in
from gateway.config.toml_text import toml_text
from gateway.ipc.messages import Pong
from gateway.state.folder import StateError, state_folder
from gateway.state.include import merged
from gateway.state.plan import as_started, read_plan
from gateway.supervisor.tables import Reloader
from tests.support.config import axis, gateway_toml, line, section, written

OWN = gateway_toml(line(1, {"cnc": 2}), axis(table="x.tab", compensation="on", gain=0.5))


def site(folder: Path, **files: str) -> Path:
    """Write a configuration that includes conf.d; each file by its name there without ``.toml``."""
    (folder / "conf.d").mkdir()
    for name, text in files.items():
        (folder / "conf.d" / f"{name}.toml").write_text(text)
    return written(folder, 'include = ["conf.d/*.toml"]\n' + OWN)


def refused(path: Path) -> tuple[Problem, ...]:
    with pytest.raises(ConfigErrors) as caught:
        load(path)
    return caught.value.problems


def line_of(path: Path, text: str) -> int:
    return path.read_text().split(text)[0].count("\n") + 1


def gain(loaded: Loaded) -> float:
    return loaded.plan.lines[0].axes[0].settings.gain.forward


# Who wins.


def test_the_file_that_includes_wins_over_all_that_it_includes(tmp_path: Path) -> None:
    path = site(tmp_path, a="[axis.x]\ngain = 0.1\nmax_slope = 0.001\n")
    loaded = load(path)
    assert (gain(loaded), loaded.sections.axes["x"].max_slope) == (0.5, 0.001)


def test_of_included_files_the_later_one_wins_by_name_and_by_the_list(tmp_path: Path) -> None:
    # Sorted by name, "10" comes before "9"; the list comes first.
    path = site(tmp_path, **{"9-site": "[capture]\nkeep = 9\n", "10-plant": "[capture]\nkeep = 10\n"})
    assert load(path).sections.capture.keep == 9
    (tmp_path / "last.toml").write_text("[capture]\nkeep = 11\n")
    text = path.read_text().replace('"conf.d/*.toml"', '"conf.d/*.toml", "last.toml"')
    path.write_text(text)
    assert load(path).sections.capture.keep == 11
    path.write_text(text.replace('"conf.d/*.toml", "last.toml"', '"last.toml", "conf.d/*.toml"'))
    assert load(path).sections.capture.keep == 9


def test_tables_merge_and_lists_replace(tmp_path: Path) -> None:
    panel = section("[[line.xyz.controllers]]", {"name": "panel", "tcp": "127.0.0.1:3"})
    path = site(tmp_path, a=f"[line.xyz]\nquiet_ms = 7\n{panel}[axis.x]\ntravel = [0.0, 50.0]\n")
    (only,) = load(path).plan.lines
    assert [link.plan.name for link in only.controllers] == ["cnc"]
    assert only.timing.quiet_ms == 7.0
    assert only.axes[0].settings.travel == (0.0, 100.0)


@pytest.mark.parametrize(
    ("files", "result"),
    [
        ([{"gain": 0.5}, {"gain": {"forward": 1}}], {"gain": {"forward": 1}}),
        ([{"gain": {"forward": 1}}, {"gain": 0.5}], {"gain": 0.5}),
        ([{"gain": {"forward": 1}}, {"gain": 0.5}, {"gain": {"backward": 2}}], {"gain": {"backward": 2}}),
        ([{"include": ["a"], "http": {}}, {"http": {"listen": ""}}], {"http": {"listen": ""}}),
    ],
)
def test_a_value_and_a_table_replace_each_other(
    files: list[dict[str, object]], result: dict[str, object]
) -> None:
    assert merged(files) == result


def test_paths_in_an_included_file_are_relative_to_the_file_that_includes_it(tmp_path: Path) -> None:
    path = site(tmp_path, a='[gateway]\ntables = "others"\nstate = "kept"\n')
    (tmp_path / "tables").rename(tmp_path / "others")
    loaded = load(path)
    assert (loaded.tables_folder, loaded.state_folder) == (tmp_path / "others", tmp_path / "kept")
    assert state_folder(path) == tmp_path / "kept"


def test_hidden_files_such_as_those_of_editors_are_not_meant(tmp_path: Path) -> None:
    path = site(tmp_path, a="[capture]\nkeep = 3\n")
    (tmp_path / "conf.d" / ".#a.toml").write_text("not TOML")
    (tmp_path / "conf.d" / "a.toml~").write_text("not TOML")
    assert load(path).sections.capture.keep == 3


def test_without_include_the_text_is_that_of_the_file(tmp_path: Path) -> None:
    path = written(tmp_path, f"# mine\n{OWN}")
    document = read_configuration(path)
    assert (document.text, document.parts) == (f"# mine\n{OWN}", ())


# What is wrong names the file that has it.


def test_an_error_in_an_included_file_names_that_file_and_its_line(tmp_path: Path) -> None:
    path = site(tmp_path, a="\n\n[axis.x]\nmax_slpe = 0.001\n", b="[capture]\nkeep = 0\n")
    first, second = refused(path)
    assert (first.file, first.line, first.key) == (str(tmp_path / "conf.d/a.toml"), 4, "axis.x.max_slpe")
    assert first.remedy == "did you mean max_slope?"
    assert (second.file, second.line, second.key) == (str(tmp_path / "conf.d/b.toml"), 2, "capture.keep")


def test_a_link_that_leads_to_itself_is_named(tmp_path: Path) -> None:
    path = site(tmp_path)
    (tmp_path / "conf.d").mkdir(exist_ok=True)
    link = tmp_path / "conf.d" / "loop.toml"
    link.symlink_to(link.name)
    (problem,) = refused(path)
    assert (problem.file, problem.line, problem.key) == (str(path), 1, "include[1]")
    assert problem.found.startswith(f"{link}: cannot be read (Too many levels of symbolic links)")


def test_a_value_that_is_replaced_is_not_an_error(tmp_path: Path) -> None:
    path = site(tmp_path, a="[axis.x]\ngain = 7\n")
    assert gain(load(path)) == 0.5


def test_a_missing_key_is_named_at_the_last_file_with_its_table(tmp_path: Path) -> None:
    path = site(tmp_path, a="[axis.x]\nmax_slope = 0.001\n")
    path.write_text(path.read_text().replace('units = "mm"\n', ""))
    (problem,) = refused(path)
    assert (problem.file, problem.line) == (str(path), line_of(path, "[axis.x]"))
    assert (problem.key, problem.found) == ("axis.x.units", "missing")


def test_an_error_in_a_list_is_named_where_the_list_in_force_is(tmp_path: Path) -> None:
    other = section("[[line.xyz.controllers]]", {"name": "panel", "tcp": "127.0.0.1:3", "timeout_ms": 900})
    path = site(tmp_path, a=other)
    path.write_text(path.read_text().replace('name = "cnc"\n', 'name = "cnc"\ntimeout = 5\n'))
    (problem,) = refused(path)
    assert (problem.file, problem.line) == (str(path), line_of(path, "timeout = 5"))


def test_an_included_file_that_is_no_toml_is_named_with_its_line(tmp_path: Path) -> None:
    path = site(tmp_path, a="[capture]\nkeep = 1,5\n", b="[capture]\nkeep == 2\n")
    first, second = refused(path)
    assert str(first).startswith(f"{tmp_path}/conf.d/a.toml:2:")
    assert first.remedy == "decimal point, not comma: keep = 1.5"
    assert str(second).startswith(f"{tmp_path}/conf.d/b.toml:2:")


@pytest.mark.parametrize(
    ("include", "key", "said"),
    [
        ('["none.toml"]', "include[1]", "none.toml: no such file; give the path of a configuration file"),
        ('["conf.d"]', "include[1]", "conf.d: a folder; give the path of a configuration file in it"),
        ('["nowhere/*.toml"]', "include[1]", "nowhere: No such file or directory; name a folder that can be"),
        ('["*.d/a.toml"]', "include[1]", "*.d/a.toml: no such file; give the path of a configuration file"),
        ('["conf.d/a.toml", "*.toml"]', "include[2]", "gateway.toml would include itself; give the included"),
        ('["conf.d/a.toml", "conf.d/*"]', "include[2]", "conf.d/a.toml is also in include[1]; include each"),
        (
            '"conf.d/a.toml"',
            "include",
            'found no list; allowed: a list of file names, as in include = ["conf.',
        ),
        (
            '["conf.d/a.toml", 5]',
            "include[2]",
            "found no file name; allowed: a list of file names, as in inc",
        ),
    ],
)
def test_a_list_that_cannot_be_followed_says_why(tmp_path: Path, include: str, key: str, said: str) -> None:
    path = site(tmp_path, a="")
    path.write_text(path.read_text().replace('["conf.d/*.toml"]', include))
    (problem,) = refused(path)
    assert (problem.file, problem.line, problem.key) == (str(path), 1, key)
    assert said in f"{problem.found}; {problem.remedy}"
    with pytest.raises(StateError):  # nor does a relay start from it
        state_folder(path)


def test_an_included_file_includes_no_others(tmp_path: Path) -> None:
    path = site(tmp_path, a='\ninclude = ["../gateway.toml"]\n')
    (problem,) = refused(path)
    assert str(problem) == (
        f"{tmp_path}/conf.d/a.toml:2: include: an included file includes no others; remove it, and list its "
        f"files in {path}"
    )


def test_include_below_a_table_is_told_its_place(tmp_path: Path) -> None:
    path = written(tmp_path, OWN.replace('name = "trial"', 'name = "trial"\ninclude = ["a.toml"]'))
    (problem,) = refused(path)
    assert (problem.key, problem.found) == ("gateway.include", "unknown key")
    assert problem.remedy == "write it at the top of the file, before the first table in [ ]"


def test_a_pattern_without_a_file_is_warned_of(tmp_path: Path) -> None:
    path = site(tmp_path)
    (warning,) = load(path).warnings
    assert str(warning) == (
        f"{path}:1: include[1]: conf.d/*.toml matches no file; put a file there, or remove the pattern"
    )


def test_an_included_file_that_everybody_may_write_is_warned_of(tmp_path: Path) -> None:
    path = site(tmp_path, a="[capture]\nkeep = 3\n")
    (tmp_path / "conf.d" / "a.toml").chmod(0o666)
    (warning,) = load(path).warnings
    assert (warning.key, "conf.d/a.toml" in warning.found) == ("include", True)
    assert warning.remedy == f"who can write there can command axes: chmod o-w {tmp_path}/conf.d/a.toml"


def test_an_address_in_hexadecimal_counts_as_meant_in_an_included_file_too(tmp_path: Path) -> None:
    text = OWN.replace('"address": 100', "") + 'registers.actual = [{ address = 0x9C41, type = "int32" }]\n'
    path = site(tmp_path, a=text[text.index("[axis.x]") :])
    path.write_text(path.read_text()[: path.read_text().index("[axis.x]")])
    assert load(path).warnings == ()
    part = tmp_path / "conf.d" / "a.toml"
    part.write_text(part.read_text().replace("0x9C41", "40001"))
    (warning,) = load(path).warnings
    assert (warning.file, warning.line) == (str(part), line_of(part, "registers.actual"))


# The merged text, which a plan and a recording keep.


def test_the_merged_text_reads_as_the_same_tables() -> None:
    text = """
    date = 2026-12-01
    at = 07:32:00.5
    moment = 2026-12-01T07:32:00+01:00
    "a.b" = { "" = "\\u007f \\" \\\\ \\n ü 🜁", c.d = [] }
    mixed = [1, [2.5, -1e-7], { x = [{ y = inf }] }, {}]
    flag = true
    [empty]
    [[list]]
    n = 1
    [list.inside]
    m = 2
    [[list.inside.more]]
    [[list]]
    """
    tables = tomllib.loads(text)
    assert tomllib.loads(toml_text(tables)) == tables


def test_what_was_merged_is_read_again_without_its_files(tmp_path: Path) -> None:
    path = site(tmp_path, a="[capture]\nkeep = 3\n")
    document = read_configuration(path)
    assert document.text.startswith("# Merged from 'conf.d/a.toml', 'gateway.toml'\n")
    assert parse_document(path, document.text).tables == document.tables == load(path).document.tables


def test_a_recording_has_what_was_merged(tmp_path: Path) -> None:
    path = site(tmp_path, a="[axis.x]\nmax_slope = 0.005\n")
    loaded = load(path)
    header = header_of(loaded)
    shutil.rmtree(tmp_path / "conf.d")
    # The relay of a recording has no state folder and no name of a file that was moved.
    assert as_started(plan_of(header)).lines == as_started(loaded.plan).lines


def test_what_an_auditor_gets_is_merged_and_has_no_secret(tmp_path: Path) -> None:
    secret = "correct-horse-battery-staple"
    broker = section("[mqtt]", {"host": "localhost", "username": "mill", "password_file": secret})
    path = site(tmp_path, a=broker)
    text = without_secrets(read_configuration(path))
    assert secret not in text
    assert tomllib.loads(text)["mqtt"]["host"] == "localhost"


# Where each value comes from.


def shown(path: Path) -> list[tuple[str, str, int | None, str]]:
    """Return each value of the axis with its place, and that of the file that replaces it."""
    return [
        (
            f"{data['key'].removeprefix('axis.x.')} = {data['value']}",
            Path(data["file"]).name,
            data["line"],
            "" if data["replaced_by"] is None else Path(data["replaced_by"]["file"]).name,
        )
        for data in (each.as_data() for each in settings_in(read_configuration(path)))
        if data["key"].startswith("axis.x.")
    ]


def test_each_value_has_its_place_and_what_it_replaced(tmp_path: Path) -> None:
    path = site(
        tmp_path,
        a="[axis.x]\ngain.forward = 0.1\nmax_slope = 0.001\ntravel = [0, 1]\n",
        b="[axis.x]\nmax_slope = 0.002\n",
    )
    found = shown(path)
    assert found[:5] == [
        ("gain = 0.5", "gateway.toml", line_of(path, "gain"), ""),  # where gain comes first, as a table
        ("max_slope = 0.002", "b.toml", 2, ""),
        ("max_slope = 0.001", "a.toml", 3, "b.toml"),
        ("travel = [0.0, 100.0]", "gateway.toml", line_of(path, "travel"), ""),
        ("travel = [0, 1]", "a.toml", 4, "gateway.toml"),
    ]
    # A value in place of the table around it replaces all of that.
    assert found[-1] == ("gain.forward = 0.1", "a.toml", 2, "gateway.toml")


def test_a_list_that_replaces_a_longer_one_replaces_all_of_its_elements(tmp_path: Path) -> None:
    two = [
        section("[[line.xyz.controllers]]", {"name": name, "tcp": f"127.0.0.1:{n}"})
        for n, name in ((8, "one"), (9, "two"))
    ]
    path = site(tmp_path, a="".join(two))
    found = [each for each in settings_in(read_configuration(path)) if "controllers" in each.key]
    assert [(each.key[-2:], each.value, each.replaced_by is None) for each in found] == [
        ((0, "name"), "cnc", True),
        ((0, "name"), "one", False),
        ((0, "tcp"), "127.0.0.1:2", True),
        ((0, "tcp"), "127.0.0.1:8", False),
        ((1, "name"), "two", False),
        ((1, "tcp"), "127.0.0.1:9", False),
    ]


# A relay starts only from the files that were compiled.


@pytest.fixture
def compiled(tmp_path: Path) -> Path:
    path = site(tmp_path, a="[axis.x]\nmax_slope = 0.005\n")
    compile_into_state(load(path))
    assert read_plan(state_folder(path), path).plan.lines[0].axes[0].settings.max_slope == 0.005
    return path


def why_not(path: Path) -> str:
    with pytest.raises(StateError) as caught:
        read_plan(state_folder(path), path)
    return str(caught.value)


def test_an_included_file_that_changed_since_is_noticed(compiled: Path) -> None:
    part = compiled.parent / "conf.d" / "a.toml"
    part.write_text(f"{part.read_text()}# a remark\n")
    assert why_not(compiled).startswith(f"{part} has changed since it was compiled; run: pitch-gateway check")


def test_an_included_file_that_came_since_is_noticed(compiled: Path) -> None:
    part = compiled.parent / "conf.d" / "b.toml"
    part.write_text("")
    assert why_not(compiled) == (
        f"{part} is included, and was not when it was compiled; run: pitch-gateway check --compile {compiled}"
    )


def test_an_included_file_that_went_since_is_noticed(compiled: Path) -> None:
    part = compiled.parent / "conf.d" / "a.toml"
    part.unlink()
    assert why_not(compiled).startswith(f"{part}: no such file; run: pitch-gateway check --compile")


def test_an_included_file_that_is_no_toml_is_named_at_a_start(compiled: Path) -> None:
    part = compiled.parent / "conf.d" / "a.toml"
    part.write_text("half edi")
    with pytest.raises(StateError, match=r"conf\.d/a\.toml: not TOML: .*; pitch-gateway check .* says where"):
        state_folder(compiled)


def test_a_gateway_can_be_commanded_while_an_included_file_is_edited(tmp_path: Path) -> None:
    path = site(tmp_path, a="half edi")
    with pytest.raises(StateError):
        state_folder(path)  # which may be named there
    path.write_text(path.read_text().replace('name = "trial"', 'name = "trial"\nstate = "kept"'))
    assert state_folder(path) == state_folder_or_exit(path) == tmp_path / "kept"
    (tmp_path / "conf.d" / "a.toml").write_text('[gateway]\nstate = "another"\n')
    assert load(path).state_folder == tmp_path / "kept"


def test_a_status_without_a_supervisor_knows_the_keys_of_included_files(tmp_path: Path) -> None:
    path = written(tmp_path, 'include = ["line.toml"]\n' + gateway_toml())
    (tmp_path / "line.toml").write_text(line(1, {"cnc": {"tcp": "127.0.0.1:2", "silent_after_s": 90.0}}))
    assert _silent_after_s(path) == {("xyz", "cnc"): 90.0}


# What a running gateway takes from it.


def test_a_reload_takes_a_key_of_an_included_file(compiled: Path) -> None:
    reloader = Reloader(compiled)
    assert reloader.reload().all_problems == ()
    (compiled.parent / "conf.d" / "a.toml").write_text("[axis.x]\nmax_slope = 0.006\n")
    assert not reloader.is_file_unchanged()
    outcome = reloader.reload()
    assert (outcome.problems, outcome.changed) == ((), ("axis.x.max_slope",))
    assert reloader.is_file_unchanged()
    assert read_plan(state_folder(compiled), compiled).plan.lines[0].axes[0].settings.max_slope == 0.006


def test_what_needs_a_restart_is_named_by_its_keys(compiled: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reloader = Reloader(compiled)
    reloader.reload()
    (compiled.parent / "conf.d" / "a.toml").write_text("[line.xyz]\nquiet_ms = 8\n")
    relay = Pong(name="trial", gateway_version="1", pid=1, shape="another")
    monkeypatch.setattr("gateway.supervisor.tables.ask", lambda *_given: relay)
    (problem,) = reloader.reload().problems
    assert problem.endswith(": line.xyz.quiet_ms")


def test_a_table_that_changes_later_leaves_a_plan_that_starts(compiled: Path) -> None:
    reloader = Reloader(compiled)
    assert reloader.reload().all_problems == ()
    compile_into_state(load(compiled))
    part = compiled.parent / "conf.d" / "a.toml"
    part.write_text("[axis.x]\nmax_slope = 0.007\n")
    compile_into_state(load(compiled))  # as check --compile does
    assert reloader.refresh({}).problems == ()
    found = read_plan(state_folder(compiled), compiled)
    assert found.plan.lines[0].axes[0].settings.max_slope == 0.007
    assert {Path(name).name for name in found.sources} == {"a.toml", "gateway.toml"}


def test_a_supervisor_that_finds_a_broken_file_goes_on_with_what_was_merged(compiled: Path) -> None:
    (compiled.parent / "conf.d" / "a.toml").write_text("half edi")
    compiled.write_text(compiled.read_text().replace('name = "trial"', 'name = "trial"\nstate = "state"'))
    reloader = Reloader(compiled)
    (problem,) = reloader.reload({}).problems
    assert problem.startswith(f"{compiled.parent}/conf.d/a.toml:1:")
    assert reloader.loaded is not None
    assert reloader.loaded.sections.axes["x"].max_slope == 0.005
    # The merged text has lines of its own, which are those of no file.
    assert reloader.loaded.document.place_of(("axis", "x", "max_slope")) == (compiled, None)
