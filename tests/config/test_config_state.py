"""The state folder as ``check`` sees it: what no gateway can start with, and what others may write to."""

import os
import pwd
from pathlib import Path

import pytest

from gateway.config.compile import compile_into_state
from gateway.config.load import load
from gateway.config.problems import ConfigErrors, Problem
from gateway.ipc.address import socket_path
from gateway.state.folder import StateError
from tests.config.config_bench import edited, line_of, written


def text_with(state: Path | str) -> str:
    return edited(('name = "mill-1"', f'name = "mill-1"\nstate = "{state}"'))


def refused(folder: Path, state: Path | str) -> Problem:
    """Return the only problem of a configuration with this state folder; it is that of its key."""
    text = text_with(state)
    with pytest.raises(ConfigErrors) as caught:
        load(written(folder, text))
    [problem] = caught.value.problems
    assert (problem.file, problem.key) == (str(folder / "gateway.toml"), "gateway.state")
    assert problem.line == line_of(text, "state =")
    return problem


def test_a_folder_too_long_for_its_socket_is_refused_and_one_byte_less_is_not(tmp_path: Path) -> None:
    # "/relay.sock" takes 11 of the 107 bytes.
    fits = tmp_path / ("s" * (107 - 11 - len(str(tmp_path)) - 1))
    assert len(str(socket_path(fits))) == 107
    load(written(tmp_path, text_with(fits)))
    problem = refused(tmp_path, f"{fits}s")
    assert problem.found == f"{fits}s/relay.sock has 108 bytes, and the path of a socket has 107 at most"
    assert problem.remedy == "give [gateway] state a shorter folder, for example /run/pitch-gateway"


def test_the_length_counts_in_bytes_and_from_the_root(tmp_path: Path) -> None:
    # Relative to the configuration; each ä is two bytes.
    name = "ä" * ((107 - 11 - len(str(tmp_path)) - 1) // 2 + 1)
    assert "bytes, and the path of a socket has 107 at most" in refused(tmp_path, name).found


def test_a_file_where_the_folder_should_be_is_refused(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    problem = refused(tmp_path, "taken")
    assert problem.found == f"{tmp_path}/taken is a file, not a folder"
    assert problem.remedy == "move it away, or choose another folder with [gateway] state"
    above = refused(tmp_path, "taken/state")
    assert above.found == f"{tmp_path}/taken is a file, not a folder"


def test_a_link_that_leads_nowhere_is_refused_and_one_to_a_folder_is_not(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("gone")
    problem = refused(tmp_path, "link")
    assert problem.found == f"{tmp_path}/link is a link to gone, which does not exist"
    assert problem.remedy.startswith("make the folder that it leads to, or ")
    assert refused(tmp_path, "link/state").found == problem.found
    (tmp_path / "gone").mkdir()
    assert load(written(tmp_path, text_with("link"))).warnings == ()
    (tmp_path / "round").symlink_to("round")
    assert "Too many levels of symbolic links" in refused(tmp_path, "round").found


def test_a_fifo_is_named_as_what_it_is(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo")
    assert refused(tmp_path, "fifo").found == f"{tmp_path}/fifo is a FIFO, not a folder"


def test_a_folder_that_every_user_may_write_to_is_a_warning(tmp_path: Path) -> None:
    state = tmp_path / "state"
    state.mkdir()
    state.chmod(0o770)
    assert load(written(tmp_path)).warnings == ()
    state.chmod(0o1777)
    [warning] = load(written(tmp_path)).warnings
    assert (warning.key, warning.found) == ("gateway.state", f"every user may write to {state} (mode 1777)")
    assert warning.remedy == f"who can write there can command axes: chmod o-w {state}"


def test_a_place_that_is_taken_after_the_check_is_no_matter_of_permission(tmp_path: Path) -> None:
    loaded = load(written(tmp_path))
    (tmp_path / "state").write_text("")
    with pytest.raises(StateError) as caught:
        compile_into_state(loaded)
    assert str(caught.value) == (
        f"gateway.state: {tmp_path}/state: File exists; a file is where a folder should be: move it "
        "away, or choose another folder with [gateway] state"
    )


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can write where another user's state is")
def test_root_writes_nothing_where_the_service_of_another_user_has_its_state(tmp_path: Path) -> None:
    state = tmp_path / "state"
    state.mkdir()
    loaded = load(written(tmp_path, text_with(state)))
    os.chown(state, 65534, -1)
    with pytest.raises(StateError) as caught:
        compile_into_state(loaded)
    name = pwd.getpwuid(65534).pw_name
    assert str(caught.value) == (
        f"gateway.state: {state} belongs to user {name}, who could not use what root writes there; "
        f"do it as that user (sudo -u {name} …), or choose another folder with [gateway] state"
    )
    assert list(state.iterdir()) == []
    os.chown(state, 4_000_000_000, -1)  # nobody's: to a shell a bare # begins a comment
    with pytest.raises(StateError, match=r"\(sudo -u '#4000000000' …\)"):
        compile_into_state(loaded)
    os.chown(state, 0, -1)
    compile_into_state(loaded)
