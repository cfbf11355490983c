"""A report as a file: whole or not at all, and the same bytes everywhere."""

import errno
import functools
import hashlib
import json
import os
import stat
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from gateway.report.axis_data import Report
from gateway.report.errors import ReportError
from gateway.report.writing import MOST_SHEETS, put_file, render, write_report
from tests.report.stories import axis_data, report

ROOT = Path(__file__).parents[2]


@functools.cache
def rendered(suffix: str) -> bytes:
    """The report that most tests here write, drawn once."""
    return render(report(), suffix)


def names_in(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


@pytest.mark.parametrize("suffix", [".html", ".png", ".svg", ".HTML"])
def test_the_suffix_decides(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"report{suffix}"
    write_report(report(), path)
    assert path.read_bytes() == rendered(suffix.lower())
    assert names_in(tmp_path) == [path.name]


@pytest.mark.parametrize("name", ["report.pdf", "report", "report.htm", ".html"])
def test_another_suffix_names_those_that_can_be_written(tmp_path: Path, name: str) -> None:
    with pytest.raises(ReportError, match=r"end the name with \.html, \.png, \.svg"):
        write_report(report(), tmp_path / name)
    assert names_in(tmp_path) == []


def test_an_existing_file_is_replaced_only_by_force_and_keeps_its_mode(tmp_path: Path) -> None:
    path = tmp_path / "report.svg"
    path.write_text("mine")
    path.chmod(0o600)
    with pytest.raises(ReportError, match="a file of this name exists; give a new name, or --force"):
        write_report(report(), path)
    assert path.read_text() == "mine"
    link = tmp_path / "link.svg"
    link.symlink_to(path)
    write_report(report(), link, force=True)
    assert path.read_bytes() == rendered(".svg")
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert link.is_symlink()


@pytest.mark.parametrize("force", [False, True])
def test_a_disk_that_is_full_leaves_what_was_there(tmp_path: Path, force: bool) -> None:
    path = tmp_path / "report.svg"
    if force:
        path.write_text("mine")
    # Reaching the limit of the size of a file is an error of write(), like a full disk.
    code = (
        "import resource, signal, sys; from pathlib import Path\n"
        "from gateway.report.errors import ReportError\n"
        "from gateway.report.writing import put_file\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        "try:\n"
        "    put_file(Path(sys.argv[1]), b'x' * 100_000, force=sys.argv[2] == 'True')\n"
        "except ReportError as error:\n"
        "    print(error)\n"
    )
    said = subprocess.run(
        [sys.executable, "-c", code, str(path), str(force)],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
        timeout=60,
    ).stdout
    assert said == f"{path}: File too large; give a path that can be written\n"
    assert names_in(tmp_path) == (["report.svg"] if force else [])
    assert not force or path.read_text() == "mine"


def no_links(self: Path, target: Path) -> None:
    raise PermissionError(errno.EPERM, os.strerror(errno.EPERM))


def test_a_stick_that_knows_no_links_takes_a_report_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Path, "hardlink_to", no_links)
    path = tmp_path / "report.svg"
    put_file(path, b"first", force=False)
    with pytest.raises(ReportError, match="a file of this name"):
        put_file(path, b"second", force=False)
    assert path.read_bytes() == b"first"
    assert names_in(tmp_path) == ["report.svg"]


def test_places_that_are_none_are_named(tmp_path: Path) -> None:
    with pytest.raises(ReportError, match=r"make the folder .*nowhere first: it does not exist"):
        write_report(report(), tmp_path / "nowhere" / "report.html")
    os.mkfifo(tmp_path / "fifo.html")
    with pytest.raises(ReportError, match="a FIFO"):
        write_report(report(), tmp_path / "fifo.html", force=True)
    (tmp_path / "folder.html").mkdir()
    with pytest.raises(ReportError, match="a folder"):
        write_report(report(), tmp_path / "folder.html", force=True)


def test_a_report_of_nothing_is_none(tmp_path: Path) -> None:
    with pytest.raises(ReportError, match="nothing to show"):
        write_report(Report("empty", (), ""), tmp_path / "report.html")
    assert names_in(tmp_path) == []


def test_more_axes_than_a_picture_can_show_are_for_a_page() -> None:
    many = report(*[axis_data(axis=f"a{index}") for index in range(MOST_SHEETS + 1)])
    with pytest.raises(ReportError, match=r"25 axes: write \.html, because one picture shows at most 24"):
        render(many, ".png")


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What another process makes of the report: its sums by suffix, and whether it thought of a window."""
    folder = tmp_path_factory.mktemp("settings")
    (folder / "matplotlibrc").write_text("font.size: 30\naxes.facecolor: red\nsvg.fonttype: none\n")
    code = (
        "import hashlib, json, sys\n"
        "from tests.report.stories import report; from gateway.report.writing import render\n"
        "sums = {s: hashlib.sha256(render(report(), s)).hexdigest() for s in ('.html', '.png', '.svg')}\n"
        "print(json.dumps({'sums': sums, 'pyplot': 'matplotlib.pyplot' in sys.modules}))\n"
    )
    environment = {**os.environ, "PYTHONHASHSEED": "7", "MATPLOTLIBRC": str(folder), "TZ": "Asia/Tokyo"}
    said = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
        env=environment,
        timeout=60,
    ).stdout
    found: dict[str, Any] = json.loads(said)
    return found


def test_the_same_report_is_the_same_bytes_whoever_makes_it(elsewhere: dict[str, Any]) -> None:
    here = {suffix: hashlib.sha256(rendered(suffix)).hexdigest() for suffix in (".html", ".png", ".svg")}
    assert elsewhere["sums"] == here


def test_matplotlib_is_not_touched_before_something_is_drawn() -> None:
    code = (
        "import sys, gateway.report.writing, gateway.cli.app\n"
        "print('matplotlib' in sys.modules, 'numpy' in sys.modules)\n"
    )
    said = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT, timeout=60
    ).stdout
    assert said == "False False\n"


def test_the_settings_of_others_are_left_as_they_were() -> None:
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    render(report(), ".svg")
    assert dict(mpl.rcParams) == before


def test_no_window_is_ever_thought_of(elsewhere: dict[str, Any]) -> None:
    assert elsewhere["pyplot"] is False
