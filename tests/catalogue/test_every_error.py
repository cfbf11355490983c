"""Troubles, states, refusals and reasons not to start: the catalogue has all of them, and no others."""

import ast
from functools import cache

import pytest

from gateway.catalogue import troubles as kinds
from gateway.catalogue.entry import RefusalEntry, StartEntry
from gateway.catalogue.exceptions import TITLES
from gateway.catalogue.refusals import REFUSALS
from gateway.catalogue.starts import STARTS
from gateway.catalogue.states import COMPENSATION, CROSS, DIRECTION, TABLE_FILE, THERMAL, VERDICT
from gateway.catalogue.troubles import TROUBLES
from gateway.exchange.status_words import COMPENSATION_STATES, DIRECTION_STATES, TERM_STATES
from gateway.modbus.pdu import ExceptionCode
from gateway.supervisor.book import FileState
from gateway.supervisor.verdict import State
from tests.catalogue.sentences import begins, raised, trees

PASSED_ON = {"…: …; …", "…: …", "gateway.state: …", "…: …; it was there a moment ago"}
"""What another part of the gateway or the system has said, with the file in front."""


@cache
def refused() -> set[str]:
    """What is said where a request is refused; found when asked, for every run imports this file."""
    return raised(trees("exchange"), frozenset({"RefusedRequestError"}), 2) | raised(
        trees("exchange", "compensation", "modbus"),
        frozenset({"RefusedPositionError", "OutOfTableError", "OutsideTravelError", "RegisterRangeError"}),
        0,
    )


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
    assert [state.name for state in VERDICT] == [state.value for state in State]
    assert {state.name for state in DIRECTION} == set(DIRECTION_STATES)
    assert {state.name for state in TABLE_FILE} == {"none", *(state.value for state in FileState)}
    for of_term in (THERMAL, CROSS):
        assert [state.name for state in of_term] == list(TERM_STATES)


def test_every_trouble_is_found_somewhere_and_none_is_made_up() -> None:
    [tree] = trees("supervisor/trouble.py")
    used = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and getattr(node.value, "id", "") == "kinds"
    }
    groups = {"OF_COMPENSATION": kinds.OF_COMPENSATION, "OF_SUPERVISOR": kinds.OF_SUPERVISOR}
    found = {entry.kind for name in used & groups.keys() for entry in groups[name]}
    found |= {getattr(kinds, name).kind for name in used - groups.keys() - {"TROUBLES", "HIDES"}}
    assert found == set(TROUBLES)


def test_troubles_of_a_compensation_are_called_as_its_states() -> None:
    assert {entry.kind for entry in kinds.OF_COMPENSATION} <= set(COMPENSATION_STATES)


def test_every_code_that_is_answered_has_a_title_and_a_reason() -> None:
    used = {
        getattr(ExceptionCode, node.attr)
        for tree in trees("exchange")
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and getattr(node.value, "id", "") == "ExceptionCode"
    }
    understood = {ExceptionCode.ACKNOWLEDGE}  # of a drive that says "later"; never answered
    assert used - understood == {entry.code for entry in REFUSALS} <= set(TITLES)


def test_every_refusal_is_explained() -> None:
    unexplained = {
        sentence
        for sentence in refused()
        if not any(entry.says and begins(sentence, entry.says) for entry in REFUSALS)
    }
    assert refused()
    assert not unexplained


def test_no_refusal_begins_with_a_figure_whose_sign_explain_would_take_for_an_option() -> None:
    assert not [sentence for sentence in refused() if sentence.startswith("…")]


@pytest.mark.parametrize("entry", [e for e in REFUSALS if e.says], ids=lambda entry: entry.says[:50])
def test_every_explained_refusal_is_one(entry: RefusalEntry) -> None:
    assert [sentence for sentence in refused() if begins(sentence, entry.says)]


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
