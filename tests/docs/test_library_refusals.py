"""What the library refuses, in a sentence that says what to do: never an assertion or a missing key."""

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest

from gateway.clock import now_utc
from gateway.commissioning import certificates
from gateway.commissioning.first_configuration import AS_WHEN_NEW, Draft
from gateway.commissioning.probe.probing import probe
from gateway.commissioning.sign_test import best_position, judge_readings
from gateway.config.load import load
from gateway.metrology.errors import ReadingsError
from gateway.options import OptionError
from gateway.tabfile import FileContext, explain, read_table
from tests.docs.pages import ROOT

EXAMPLE = ROOT / "deploy" / "gateway.example.toml"


def test_an_axis_without_a_table_has_no_sign_test() -> None:
    axis = replace(load(EXAMPLE).plan.lines[0].axes[0], table=None)
    said = f"axis.{axis.name}.table: missing; name the table to test"
    with pytest.raises(ReadingsError) as caught:
        judge_readings(axis, at=0.0, forward_reading=0.0, backward_reading=0.0)
    assert str(caught.value) == said
    with pytest.raises(ReadingsError) as caught:
        best_position(axis)
    assert str(caught.value) == said


def test_an_axis_that_there_is_not_is_not_probed() -> None:
    plan = load(EXAMPLE).plan
    names = ", ".join(axis.name for line in plan.lines for axis in line.axes)
    with pytest.raises(OptionError) as caught:
        asyncio.run(probe(plan.lines, "q"))
    assert str(caught.value) == f"axis: there is no axis q; there are {names}"


def test_a_draft_names_the_answers_that_its_text_still_needs(tmp_path: Path) -> None:
    draft = Draft(tmp_path / "gateway.toml", AS_WHEN_NEW, AS_WHEN_NEW)
    with pytest.raises(ValueError, match=r"^unit_id: belongs to an axis; name the axis first"):
        draft.take("unit_id", 1)
    with pytest.raises(ValueError, match=r"^table: belongs to an axis"):
        draft.set_table("x.tab")
    with pytest.raises(ValueError, match=r'^there is no answer "colour"; allowed: drives_at, '):
        draft.take("colour", "red")
    with pytest.raises(ValueError, match=r"^answers are missing: drives_at, controller_at, an axis; "):
        draft.text()
    draft.take("drives_at", "127.0.0.1:15020")
    draft.begin_axis("x")
    draft.take("drive", "oriental-az")
    with pytest.raises(ValueError, match="missing") as caught:
        draft.text()
    assert str(caught.value) == (
        "answers are missing: controller_at, axis x: unit_id, axis x: units, axis x: counts_per_unit, "
        "axis x: travel, axis x: referenced; take them before the text"
    )


@pytest.mark.parametrize("name", ["../../evil", "/evil", "ca", "crl", "", "a/b"])
def test_a_certificate_is_written_into_its_folder_only(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "a" / "ca"
    folder.mkdir(parents=True)
    authority = certificates.make_authority("Hall 2", now_utc())
    with pytest.raises(OptionError, match=r"^name: found '.*'; allowed: 1 to 63 letters, digits"):
        certificates.write_signed(folder, name, authority)
    with pytest.raises(OptionError, match=r"^name: "):
        certificates.revoke(folder, name, now_utc())
    assert [path.name for path in tmp_path.rglob("*")] == ["a", "ca"]


def test_a_certificate_has_a_role_and_hosts_that_can_be_read() -> None:
    authority = certificates.make_authority("Hall 2", now_utc())
    with pytest.raises(OptionError, match=r"^role: found ''; allowed: 1 to 64 visible characters"):
        certificates.make_controller(authority, "cnc", "", now_utc())
    with pytest.raises(OptionError, match=r"^host: found 'mill 1'; allowed: a host name or an address"):
        certificates.make_server(authority, "server", ["mill 1"], now_utc())
    with pytest.raises(OptionError, match=r"^name: found ''; "):
        certificates.make_authority("", now_utc())


@pytest.mark.parametrize("at", [float("nan"), float("inf"), 1e300])
def test_only_a_machine_position_is_explained(at: float) -> None:
    loaded = read_table(ROOT / "tables" / "centroid-v3" / "cnc10z.tab", FileContext())
    with pytest.raises(OptionError) as caught:
        explain(loaded, at=at)
    assert str(caught.value) == f"at: found {at}; allowed: a machine position"
