"""A recording holds all that its configuration was read from, wherever that was."""

from pathlib import Path

import msgspec
import pytest

from gateway.commissioning.recordings import plan_of
from gateway.config.load import load
from gateway.config.recording_header import header_of
from gateway.recording.replay import ReplayError

CONFIG = """
[gateway]
{tables}

[line.xyz]
drives = {{ tcp = "127.0.0.1:1" }}

[[line.xyz.controllers]]
name = "cnc"
tcp = "127.0.0.1:1502"

[axis.x]
line = "xyz"
unit_id = 1
units = "mm"
drive = "{drive}"
counts_per_unit = 1000.0
travel = [0.0, 100.0]
referenced = "absolute"
compensation = "on"
table = "x.tab"
"""
# Line ends and an end of file as DOS has them.
TABLE = (
    b"CNC10 TAB FILE VERSION 3\r\nAXIS X\r\nUNITS MILLIMETER\r\nINTERVAL 50.0\r\nENTRIES 3\r\n"
    b"0.0 0.0 0.0\r\n50.0 0.05 0.05\r\n100.0 0.1 0.1\r\n\x1a"
)
PROFILE = """
title = "A drive that moves when a position is written"
registers.command = [{ address = 100, type = "int32" }]
registers.actual = [{ address = 110, type = "int32" }]
"""


@pytest.mark.parametrize("drive", ["./mine.toml", "mine.toml", "../mine.toml", "{root}/mine.toml"])
@pytest.mark.parametrize("tables", ["", 'tables = "../far/tab"', "tables = '{root}/far'", 'tables = "."'])
def test_the_plan_comes_back_after_every_file_is_gone(tmp_path: Path, drive: str, tables: str) -> None:
    root = tmp_path / "root"
    here = root / "machine"
    for folder in (here / "tables", here, root / "far" / "tab", root / "far"):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "x.tab").write_bytes(TABLE)
    for folder in (here, root):
        (folder / "mine.toml").write_text(PROFILE)
    config = here / "gateway.toml"
    config.write_text(CONFIG.format(drive=drive.format(root=root), tables=tables.format(root=root)))
    loaded = load(config)
    header = header_of(loaded)
    root.rename(tmp_path / "gone")
    assert plan_of(header) == loaded.plan


def test_the_tables_of_other_axes_come_back_too(tmp_path: Path) -> None:
    folder = tmp_path / "machine"
    folder.mkdir()
    (folder / "x.tab").write_bytes(TABLE)
    (folder / "x-over-y.csv").write_text("position_mm,correction_mm\n0,0\n100,0.02\n")
    (folder / "mine.toml").write_text(PROFILE)
    (folder / "broker-password").write_text("hush")
    (folder / "broker-password").chmod(0o600)
    terms = """
thermal = { alpha = 11.5e-6, source = { mqtt = "hall/screw" } }
cross = [{ axis = "y", table = "x-over-y.csv" }]
"""
    broker = """
[mqtt]
host = "127.0.0.1"
username = "gateway"
password_file = "broker-password"
"""
    text = CONFIG.format(drive="./mine.toml", tables='tables = "."')
    other = text[text.index("[axis.x]") :].replace("axis.x", "axis.y").replace("unit_id = 1", "unit_id = 2")
    config = folder / "gateway.toml"
    config.write_text(text + terms + other.replace('table = "x.tab"\n', "") + broker)
    loaded = load(config)
    assert loaded.plan.lines[0].axes[0].cross
    header = header_of(loaded)
    folder.rename(tmp_path / "gone")
    assert plan_of(header) == loaded.plan


def test_a_recording_of_another_format_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.tab").write_bytes(TABLE)
    (tmp_path / "mine.toml").write_text(PROFILE)
    config = tmp_path / "gateway.toml"
    config.write_text(CONFIG.format(drive="./mine.toml", tables='tables = "."'))
    header = msgspec.structs.replace(header_of(load(config)), format=99)
    with pytest.raises(ReplayError, match="a recording of format 99, made by release"):
        plan_of(header)
