"""Troubles, states, refusals and reasons not to start: the catalogue has all of them, and no others."""

import ast
from functools import cache
from string import Formatter

import pytest

from gateway.catalogue import alarms as kinds
from gateway.catalogue import refusals
from gateway.catalogue.alarms import ALARMS
from gateway.catalogue.entry import RefusalEntry, StartEntry
from gateway.catalogue.exceptions import TITLES
from gateway.catalogue.refusals import REFUSALS
from gateway.catalogue.starts import STARTS
from gateway.catalogue.states import COMPENSATION, CROSS, DIRECTION, TABLE_FILE, THERMAL, VERDICT
from gateway.exchange.status_words import COMPENSATION_STATES, DIRECTION_STATES, TERM_STATES
from gateway.modbus.pdu import ExceptionCode
from gateway.supervisor.table_files import FileState
from gateway.supervisor.verdict import Health
from tests.catalogue.sentences import begins, raised, trees

PASSED_ON = {"…: …; …", "…: …", "gateway.state: …", "…: …; it existed a moment ago"}
"""What another part of the gateway or the system has said, with the file in front."""


SHARED = {
    "BROADCAST_POSITION",
    "UNIT_NOT_MAPPED",
    "UNIT_WITHOUT_AXIS",
    "PART_LOST",
    "REST_UNKNOWN",
    "REST_UNCERTAIN",
}
"""Refusals that a function chooses among: who raises them fills in the same for each."""


def _has_a_sentence(entry: object) -> bool:
    return isinstance(entry, RefusalEntry) and bool(entry.begins)


@cache
def refused() -> dict[str, set[str]]:
    """Which refusals the gateway names, and with which fields each is filled in."""
    found: dict[str, set[str]] = {}
    for tree in trees("exchange", "compensation", "modbus"):
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and getattr(node.value, "id", "") == "refusals":
                found.setdefault(node.attr, set())
        for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
            named = [call.func.value] if isinstance(call.func, ast.Attribute) else call.args[:1]
            for name in named:
                if isinstance(name, ast.Attribute) and getattr(name.value, "id", "") == "refusals":
                    found[name.attr] |= {keyword.arg for keyword in call.keywords if keyword.arg}
    return found


@cache
def not_started() -> set[str]:
    return raised(
        trees("ipc", "state", "transport", "relay", "supervisor", "config/compile.py"),
        frozenset({"StateError", "SocketError", "AbsentError", "RefusedError", "FolderProblem"}),
        0,
    ) | {
        "… exists: record into a new file, or remove this one",
        "… cannot be written: …",
    }


def test_states_are_those_of_the_status() -> None:
    assert {state.name for state in COMPENSATION} == set(COMPENSATION_STATES)
    assert [state.name for state in VERDICT] == [state.value for state in Health]
    assert {state.name for state in DIRECTION} == set(DIRECTION_STATES)
    assert {state.name for state in TABLE_FILE} == {"none", *(state.value for state in FileState)}
    for of_term in (THERMAL, CROSS):
        assert [state.name for state in of_term] == list(TERM_STATES)


def test_every_trouble_is_found_somewhere_and_none_is_made_up() -> None:
    [tree] = trees("supervisor/active_alarms.py")
    used = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and getattr(node.value, "id", "") == "kinds"
    }
    groups = {"OF_COMPENSATION": kinds.OF_COMPENSATION, "OF_SUPERVISOR": kinds.OF_SUPERVISOR}
    found = {entry.kind for name in used & groups.keys() for entry in groups[name]}
    found |= {getattr(kinds, name).kind for name in used - groups.keys() - {"ALARMS", "HIDES"}}
    assert found == set(ALARMS)


def test_troubles_of_a_compensation_are_called_as_its_states() -> None:
    assert {entry.kind for entry in kinds.OF_COMPENSATION} <= set(COMPENSATION_STATES)


def test_every_code_that_is_answered_has_a_title_and_a_reason() -> None:
    used = {
        getattr(ExceptionCode, node.attr)
        for tree in trees("exchange")
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and getattr(node.value, "id", "") == "ExceptionCode"
    }
    # Of a drive that says "later", or that got a damaged frame: its own code is passed on.
    understood = {ExceptionCode.ACKNOWLEDGE, ExceptionCode.MEMORY_PARITY_ERROR}
    assert used - understood <= {entry.code for entry in REFUSALS} <= set(TITLES)


def test_a_refusal_is_made_of_an_entry_everywhere() -> None:
    """A sentence of its own has only the refusal of a position, which is one of these already."""
    texts = raised(trees("exchange"), frozenset({"RefusedRequestError"}), 2) | raised(
        trees("exchange", "compensation", "modbus"),
        frozenset({"RefusedPositionError", "OutOfTableError", "OutsideTravelError", "RegisterRangeError"}),
        0,
    )
    assert texts == set()


def test_no_refusal_begins_with_a_figure_whose_sign_explain_would_take_for_an_option() -> None:
    assert not [entry.says for entry in REFUSALS if entry.says.startswith("…")]


@pytest.mark.parametrize("name", [name for name, entry in vars(refusals).items() if _has_a_sentence(entry)])
def test_every_refusal_is_told_of_with_all_that_it_names(name: str) -> None:
    entry: RefusalEntry = getattr(refusals, name)
    fields = {field for _, field, _, _ in Formatter().parse(entry.begins + entry.ends) if field}
    if name in SHARED:
        assert fields <= {"unit_id", "register"}
    else:
        assert refused()[name] == fields


def test_those_that_are_chosen_among_are_named() -> None:
    assert refused().keys() >= SHARED


def test_every_reason_not_to_start_is_explained() -> None:
    unexplained = {
        sentence
        for sentence in not_started() - PASSED_ON
        if not any(begins(sentence, entry.says) for entry in STARTS)
    }
    assert not_started()
    assert not unexplained


@pytest.mark.parametrize("entry", STARTS, ids=lambda entry: entry.says[:50])
def test_every_explained_reason_not_to_start_is_one(entry: StartEntry) -> None:
    assert [sentence for sentence in not_started() if begins(sentence, entry.says)]
