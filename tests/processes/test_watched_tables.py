"""Tables change while the machine runs: every way in which files are saved, taken away and brought back."""

import contextlib
import json
import os

from tests.processes.saving import STYLES, in_place
from tests.support.commands import typed
from tests.support.config import RAMP, STEEPER
from tests.support.gateway import Site, gateway_of
from tests.support.processes import Running, ending, running, typed_apart

BAD = RAMP.replace("50.0 0.05 0.05", "50.0 0.05")
BAD_LINE = 7


def test_a_save_of_whatever_style_comes_into_force_by_itself(site: Site) -> None:
    with gateway_of(site) as (gateway, master):
        assert master.move(50_000) == 50_050
        for save in STYLES:
            save(site.table, STEEPER)
            assert gateway.until("table-handed-over")["axis"] == "x"
            assert master.move(50_000) == 50_050  # the same target again moves nothing
            assert master.move(50_001) == 50_101
            save(site.table, RAMP)
            gateway.until("table-handed-over")
            assert master.move(50_000) == 50_050


def test_a_bad_file_changes_nothing_is_told_once_and_is_good_again_when_it_is_mended(site: Site) -> None:
    with gateway_of(site) as (gateway, master):
        assert master.move(50_000) == 50_050
        in_place(site.table, BAD)
        rejected = gateway.until("table-rejected")
        assert (rejected["axis"], rejected["file"], rejected["line"]) == ("x", str(site.table), BAD_LINE)
        assert rejected["level"] == "error"
        assert master.move(50_001) == 50_051
        in_place(site.table, RAMP)
        assert gateway.until("table-mended")["axis"] == "x"
        assert master.move(50_000) == 50_050
        in_place(site.table, STEEPER)
        gateway.until("table-handed-over")
        assert master.move(50_001) == 50_101
    assert [note["event"] for note in gateway.notes].count("table-rejected") == 1


def test_a_file_that_goes_takes_the_correction_with_it_and_brings_it_back(site: Site) -> None:
    with gateway_of(site) as (gateway, master):
        assert master.move(50_000) == 50_050
        for backup in ("x.bak", "X.BAK", None):
            if backup is None:
                site.table.unlink()
            else:
                put_away = site.table.rename(site.table.with_name(backup))
            gone = gateway.until("table-taken-away")
            assert (gone["axis"], gone["comes"]) == ("x", "next-target")
            assert master.move(50_000) == 50_050  # by itself nothing moves
            assert master.move(50_001) == 50_001
            site.table.write_text(RAMP)
            assert gateway.until("table-handed-over")["axis"] == "x"
            assert master.move(50_000) == 50_050
            put_away.unlink(missing_ok=True)


def test_a_folder_that_vanishes_takes_nothing_with_it(site: Site) -> None:
    elsewhere = site.table.parents[1] / "elsewhere"
    with gateway_of(site) as (gateway, master):
        site.table.parent.rename(elsewhere)
        rejected = gateway.until("table-rejected")
        assert str(site.table.parent) in rejected["problems"][0]
        assert master.move(50_000) == 50_050
        elsewhere.rename(site.table.parent)
        gateway.until("table-mended")
        in_place(site.table, STEEPER)
        gateway.until("table-handed-over")
        assert master.move(50_001) == 50_101


def test_an_empty_folder_in_place_of_the_one_with_the_tables_takes_nothing_with_it(site: Site) -> None:
    elsewhere = site.table.parents[1] / "elsewhere"
    with gateway_of(site) as (gateway, master):
        assert master.move(50_000) == 50_050
        site.table.parent.rename(elsewhere)  # as a share is unmounted: what it was mounted on is left
        site.table.parent.mkdir()
        refused = gateway.until("reload-refused")
        assert str(site.table.parent) in refused["problems"][0]
        assert master.move(50_001) == 50_051
        site.table.parent.rmdir()
        elsewhere.rename(site.table.parent)
        in_place(site.table, STEEPER)
        gateway.until("table-handed-over")
        assert master.move(50_002) == 50_102
        site.table.unlink()  # from the folder itself it counts as before
        gateway.until("table-taken-away")
        assert master.move(50_001) == 50_001


def test_a_symlink_loop_a_device_and_ten_megabytes_are_said_and_change_nothing(site: Site) -> None:
    with gateway_of(site) as (gateway, master):
        for make, said in (
            (lambda: site.table.symlink_to(site.table.name), "symbolic links"),
            (lambda: os.mkfifo(site.table), "not a regular file"),
            (lambda: site.table.write_bytes(b"0.001 0.002\n" * 1_000_000), "1000000 lines"),
            (lambda: site.table.write_text(RAMP.replace("AXIS X", "AXIS Y")), "AXIS Y, read for axis X"),
        ):
            site.table.unlink()
            make()
            rejected = gateway.until("table-rejected")
            assert said in rejected["problems"][0]
            assert master.move(50_000 + len(gateway.notes)) == 50_050 + len(gateway.notes)


def test_a_file_that_somebody_still_writes_is_left_alone(site: Site) -> None:
    with gateway_of(site) as (gateway, master):
        with site.table.open("w") as file:
            file.write(STEEPER)
            file.flush()
            # A second axis-less change in the folder wakes the watch; nothing may be read all the same.
            (site.table.parent / "note.txt").write_text("x")
            done = typed("reload", str(site.config))
            assert done.returncode == 1
            assert "not taken yet: a program has it open for writing" in done.stderr
            assert master.move(50_000) == 50_050
        gateway.until("table-handed-over")
        assert master.move(50_001) == 50_101


def test_with_a_bad_file_the_gateway_starts_from_the_last_good_one_and_says_so(site: Site) -> None:
    with gateway_of(site) as (gateway, master):
        assert master.move(50_000) == 50_050
    site.table.write_text(BAD)
    with running("run", str(site.config)) as gateway:
        first = _warnings(gateway)
        assert any("starts with the last good table" in line for line in first)
        assert any(f"{site.table}:{BAD_LINE}" in line for line in first)
        gateway.until("table-rejected")
        with contextlib.closing(site.master()) as master, ending(gateway):
            assert master.move(50_000) == 50_050


def test_without_a_last_good_one_a_bad_file_starts_nothing(site: Site) -> None:
    site.table.write_text(BAD)
    done = typed_apart("run", str(site.config))
    assert done.returncode == 1
    assert f"{site.table}:{BAD_LINE}" in done.stderr


def _warnings(gateway: Running) -> list[str]:
    """Return what is said of the configuration before the gateway starts."""
    lines: list[str] = []
    while True:
        note = json.loads(gateway.line())
        if note["event"] != "configuration-warning":
            return lines
        lines.append(note["detail"])


def test_a_bad_file_stays_told_of_while_a_wrong_configuration_is_refused(site: Site) -> None:
    text = site.config.read_text()
    with gateway_of(site) as (gateway, master):
        in_place(site.table, BAD)
        gateway.until("table-rejected")
        site.config.write_text(text.replace("[axis.x]", "[axis.x]\ngains = 0.5"))
        assert typed("reload", str(site.config)).returncode == 1
        shown = json.loads(typed("status", str(site.config), "--json").stdout)
        assert shown["axes"]["x"]["table"]["status"] == "rejected"
        assert "axis.x.gains" in shown["supervisor"]["configuration"]["problem"]
        assert master.move(50_000) == 50_050
    assert "table-mended" not in [note["event"] for note in gateway.notes]
