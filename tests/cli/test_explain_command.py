"""``pitch-gateway explain``."""

import json
import re
from collections.abc import Iterator

import pytest
from typer.testing import CliRunner, Result

from gateway.catalogue.alarms import ALARMS
from gateway.catalogue.entry import AlarmEntry
from gateway.catalogue.events import EVENTS
from gateway.catalogue.lookup import counter, look_up
from gateway.catalogue.refusals import REFUSALS
from gateway.catalogue.starts import STARTS
from gateway.cli.app import app
from gateway.cli.explain import _complete
from gateway.supervisor.verdict import AWAITED, Health
from tests.supervisor.http.exposition import families
from tests.supervisor.http.http_bench import SICK, model, snapshot
from tests.supervisor.page.stage import FOLDER

SECONDS = {"line_wire_seconds", "line_added_frames_seconds"}
"""They grow, and count nothing."""


def metric_counters() -> list[str]:
    """Names of all counters of /metrics."""
    found = [family for family in families(model(snapshot(line=SICK))) if family.type == "counter"]
    return [name for family in found if (name := family.name.removeprefix("pitch_gateway_")) not in SECONDS]


def explain(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["explain", *arguments])


def test_an_event_is_told_with_cause_and_remedy() -> None:
    result = explain("drive-silent")
    assert result.exit_code == 0
    lines = result.stdout.splitlines()
    assert lines[0] == "drive-silent (event, warning)"
    assert [line.split(":")[0].strip() for line in lines[1:4]] == ["means", "cause", "remedy"]
    assert "`timeouts`" in lines[3]


def test_what_is_an_event_and_a_trouble_is_told_as_both() -> None:
    result = explain("table-rejected")
    assert result.stdout.count("table-rejected (event, error)") == 1
    assert result.stdout.count("table-rejected (trouble, error)") == 1


@pytest.mark.parametrize(
    "asked",
    [
        *("4", "04", "0x04", "0X4", "04h", "$04", "&H04", "16#04", "x04", r"\x04", "0x0004"),
        *("exception 4", "Exception code: 4", "error 0x04", "Modbus exception 04", "code=4", "ex 4"),
        *("83 04", "0x83 0x04", "8304", "0x8304", "90 04", "83-04", r"\x83\x04"),
        *("SLAVE_DEVICE_FAILURE", "Server device failure", "SlaveDeviceFailure", "112345682"),
    ],
)
def test_an_exception_is_found_by_its_code_in_any_notation(asked: str) -> None:
    found = json.loads(explain(asked, "--json").stdout)
    assert {entry["name"] for entry in found} == {"exception 0x04"}
    assert len(found) == 1 + sum(entry.code == 4 for entry in REFUSALS)
    assert found[0]["meaning"].startswith("server device failure: the drive could not")


@pytest.mark.parametrize(
    ("asked", "name"), [("11", "0x0B"), ("10", "0x0A"), ("b", "0x0B"), ("0a", "0x0A"), ("8", "0x08")]
)
def test_a_number_that_no_code_has_in_hex_is_decimal(asked: str, name: str) -> None:
    assert {entry.name for entry in look_up(asked)} == {f"exception {name}"}


@pytest.mark.parametrize("asked", ["9", "0x09", "12", "0x10", "255", "0", "84", "03 04"])
def test_what_is_no_code_is_none(asked: str) -> None:
    assert explain(asked).exit_code == 1


@pytest.mark.parametrize(
    "asked", ["crc_errors", "CRC errors", "line_crc_errors", "pitch_gateway_line_crc_errors_total"]
)
def test_a_counter_is_found_by_its_key_its_words_and_its_metric(asked: str) -> None:
    [found] = look_up(asked)
    assert (found.kind, found.name) == ("counter", "crc_errors")
    assert found.remedy.startswith("check cable")


def test_every_counter_that_the_page_shows_is_known() -> None:
    text = (FOLDER / "line_cards.js").read_text()
    labels = re.findall(r'^  \["\w+", t\("([^"]+)"\)\],$', text, re.MULTILINE)
    assert labels == ["Time-outs", "CRC errors", "Exceptions", "Refused", "Late"]
    assert all(counter(label) is not None for label in [*labels, "Exchanges/s", "over"])


@pytest.mark.parametrize("name", metric_counters())
def test_every_counter_of_the_metrics_is_known(name: str) -> None:
    assert any(found.kind == "counter" for found in look_up(f"pitch_gateway_{name}_total")), name


def words_of_the_page() -> Iterator[tuple[str, str]]:
    """Yield the names in words.js, each with its English text."""
    text = (FOLDER / "words.js").read_text()
    for block in ("COMPENSATION", "VERDICT", "TABLE", "DIRECTION", "OTHER_AXES", "EVENTS"):
        found = re.search(rf"const {block} = \{{(.*?)\n\}};", text, re.DOTALL)
        assert found is not None, block
        yield from re.findall(r'^  "?([\w-]+)"?: (?:\{ words: )?t\("([^"]+)"\)', found[1], re.MULTILINE)


def test_what_the_page_calls_an_event_or_a_state_is_known() -> None:
    words = list(words_of_the_page())
    assert len(words) > 70
    unknown = [(name, text) for name, text in words if name not in {each.name for each in look_up(text)}]
    assert unknown == []


@pytest.mark.parametrize(
    "alarm", [alarm for alarm in ALARMS.values() if alarm.title], ids=lambda each: each.kind
)
def test_the_title_of_an_alarm_is_known(alarm: AlarmEntry) -> None:
    for asked in (alarm.title, alarm.title.upper()):
        assert ("trouble", alarm.kind) in [(each.kind, each.name) for each in look_up(asked)], asked
    assert any(each.name == "waiting" for each in look_up(AWAITED))


def test_a_title_is_known_in_german() -> None:
    result = explain("Leitung unterbrochen")
    assert (result.exit_code, result.stdout.count("line-down (")) == (0, 2)
    assert explain("Tabelle abgelehnt").stdout.count("table-rejected (") == 2


def test_a_part_of_a_title_is_enough_where_no_other_has_it() -> None:
    assert "group-skewed (trouble, error)" in explain("Beam").stdout
    result = explain("silent")
    assert (result.exit_code, result.stdout) == (1, "")
    assert '"drive silent", "controller silent"' in result.stderr


@pytest.mark.parametrize("key", ["deadline_ms", "function", "relative", "line", "late"])
def test_a_key_is_told_also_where_something_else_has_its_name(key: str) -> None:
    assert any(found["kind"] == "key" for found in json.loads(explain(key, "--json").stdout))


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


@pytest.mark.parametrize("word", [state.value for state in Health])
def test_the_large_word_of_the_page_is_told(word: str) -> None:
    result = explain(word)
    assert result.exit_code == 0
    assert f"{word} (state)\n  means:  verdict.state: " in result.stdout


def test_what_is_misspelt_is_said_with_what_was_meant() -> None:
    result = explain("drive-silence")
    assert result.exit_code == 1
    assert result.stderr.startswith('"drive-silence" is unknown; did you mean drive-silent, ')


def test_what_is_called_nothing_is_said() -> None:
    result = explain("xyzzy")
    assert (result.exit_code, result.stdout) == (1, "")
    assert "list all names with: pitch-gateway explain" in result.stderr


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


@pytest.mark.parametrize(
    ("asked", "trouble"), [("axis-blocked", "blocked"), ("group-skewed", "group-skewed")]
)
def test_an_event_that_refers_to_a_trouble_explains_that_too(asked: str, trouble: str) -> None:
    found = [(entry.kind, entry.name) for entry in look_up(asked)]
    assert found == [("event", asked), ("trouble", trouble)]
