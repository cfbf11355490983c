"""``pitch-gateway explain``."""

import json

import pytest
from typer.testing import CliRunner, Result

from gateway.catalogue.events import EVENTS
from gateway.catalogue.lookup import look_up
from gateway.catalogue.refusals import REFUSALS
from gateway.catalogue.starts import STARTS
from gateway.cli.explain import _complete
from gateway.cli.main import app


def explain(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["explain", *arguments])


def test_an_event_is_told_with_cause_and_remedy() -> None:
    result = explain("drive-silent")
    assert result.exit_code == 0
    lines = result.stdout.splitlines()
    assert lines[0] == "drive-silent (event, warning)"
    assert [line.split(":")[0].strip() for line in lines[1:]] == ["means", "cause", "remedy"]
    assert "`timeouts`" in lines[3]


def test_what_is_an_event_and_a_trouble_is_told_as_both() -> None:
    result = explain("table-rejected")
    assert result.stdout.count("table-rejected (event, error)") == 1
    assert result.stdout.count("table-rejected (trouble, error)") == 1


@pytest.mark.parametrize("asked", ["4", "0x04", "04", "exception 4"])
def test_an_exception_is_found_by_its_code_as_a_person_writes_it(asked: str) -> None:
    found = json.loads(explain(asked, "--json").stdout)
    assert {entry["name"] for entry in found} == {"exception 0x04"}
    assert len(found) == sum(entry.code == 4 for entry in REFUSALS)


def test_a_sentence_of_the_log_is_found() -> None:
    said = "corrected machine position 301.2 leaves the travel -300 to 300 by more than travel_margin = 1 mm"
    [found] = look_up(said)
    assert (found.kind, found.meaning) == ("exception", "exception 0x04: server device failure")
    said = "gateway.toml: it has not been compiled yet: there is no state/plan.msgpack; run: ..."
    [found] = look_up(said)
    assert found.kind == "start"
    assert "check --compile" in found.remedy


def test_a_piece_of_a_sentence_is_enough() -> None:
    assert "the relay does not" not in explain("has changed since").stdout
    assert "check --compile" in explain("has changed since").stdout


def test_what_is_misspelt_is_said_with_what_was_meant() -> None:
    result = explain("drive-silence")
    assert result.exit_code == 1
    assert result.stderr.startswith('nothing is called "drive-silence"; did you mean drive-silent, ')


def test_what_is_called_nothing_is_said() -> None:
    result = explain("xyzzy")
    assert (result.exit_code, result.stdout) == (1, "")
    assert "pitch-gateway explain lists what there is" in result.stderr


def test_without_a_name_everything_is_listed() -> None:
    told = json.loads(explain("--json").stdout)
    assert [entry["name"] for entry in told["event"]] == list(EVENTS)
    assert {entry["name"] for entry in told["start"]} == {entry.says for entry in STARTS}
    text = explain().stdout
    assert all(name in text for name in EVENTS)


def test_links_of_the_document_are_words_in_the_terminal() -> None:
    assert "](" not in explain().stdout
    assert "](" not in explain("record-not-used").stdout


def test_a_key_of_the_configuration_is_told_with_what_may_stand_there() -> None:
    result = explain("axis.x.travel_margin")
    assert result.stdout.splitlines()[0] == "axis.travel_margin (key)"
    assert "(length ≥ 0; default: `max_correction`)" in result.stdout
    assert [entry["name"] for entry in json.loads(explain("gap_ms", "--json").stdout)] == [
        "line.gap_ms",
        "axis.registers.gap_ms",
    ]


def test_names_are_completed() -> None:
    assert _complete("table-m") == ["table-mended"]
    assert _complete("travel_m") == ["travel_margin"]
    assert "mqtt-lost" in _complete("mqtt")
