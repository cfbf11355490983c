"""The text that the bench writes."""

import pytest

from bench.figures import Interval, Judged, Round
from bench.places import BENCH
from bench.report import markdown, terminal
from bench.results import Goal, Section, Table, latency_table
from bench.scenarios import hot, regimes, tcp

GOALS = [
    Goal("one thing ÷ another", 1.0, Interval(0.85, 0.8, 0.9), Judged.LOW, "a remark"),
    Goal("memory, MiB", 40.0, Interval(50.8, 50.8, 50.8)),
    Goal("what is not there", 1.3, None, remark="not built"),
]


def section() -> Section:
    table = Table(("", "p50 µs"), (("direct", "5.8"), ("a | b", "12.0")), "A caption.")
    return Section("A title", ["A paragraph."], [table], GOALS)


def test_every_row_of_the_contract_says_limit_figure_and_verdict() -> None:
    lines = markdown([section()], [("kernel", "Linux")], "", "").splitlines()
    assert "| one thing ÷ another | ≤ 1 | 0.85 [0.80, 0.90] | lower end | reached | a remark |" in lines
    assert "| memory, MiB | ≤ 40 | 50.80 |  | **not reached** |  |" in lines
    assert "| what is not there | ≤ 1.3 |  |  | not measured | not built |" in lines
    assert "1 reached, 1 not reached, 1 not measured." in lines


def test_the_report_has_facts_notes_chart_and_tables_in_this_order() -> None:
    text = markdown([section()], [("kernel", "Linux 6")], "Said by a person.\n", "results.svg")
    parts = [
        "- kernel: Linux 6",
        "| memory, MiB",
        "Said by a person.",
        "(results.svg)",
        "## A title",
        "A caption.",
    ]
    places = [text.index(part) for part in parts]
    assert places == sorted(places)


def test_numbers_stand_to_the_right_and_a_bar_in_a_name_breaks_no_table() -> None:
    text = markdown([section()], [], "", "")
    assert "|  | p50 µs |\n| --- | ---: |\n| direct | 5.8 |\n| a \\| b | 12.0 |" in text


def test_the_terminal_gets_columns() -> None:
    assert "        p50 µs\ndirect     5.8\na | b     12.0" in terminal([section()])


def test_latencies_are_medians_over_rounds_but_the_worst_is_the_worst() -> None:
    series = {
        "a": [
            Round(1000, 2000, 3000, 9_000_000),
            Round(3000, 4000, 5000, 8000),
            Round(2000, 2500, 4000, 7000),
        ]
    }
    table = latency_table(series, [("more", ["cell"])])
    assert table.rows == (("a", "2.0", "2.5", "4.0", "9000", "cell"),)


def test_the_goals_over_tcp_are_judged_on_one_processor() -> None:
    def series(**medians: float) -> dict[str, list[Round]]:
        return {name.replace("_", " "): [Round(us, us, us, us)] * 3 for name, us in medians.items()}

    names = {"direct": 10.0, "socat": 30.0, "modbus-proxy": 110.0, "pymodbus forwarder": 210.0}
    compiled = {"gateway compiled": 20.0}
    judged = series(**names, **compiled, gateway=28.0)
    free = series(**names, **compiled, gateway=50.0)
    costs = {
        "relay in C": [Round(4.0, 4.0, 4.0, 4.0)] * 3,
        "gateway compiled": [Round(6.0, 6.0, 6.0, 6.0)] * 3,
    }
    goals = tcp.goals(judged, free, costs)
    found = [goal.found.estimate for goal in goals if goal.found is not None]
    # added: compiled 10, not compiled 18, socat 20, modbus-proxy 100, pymodbus 200; the second is 20 ÷ 30
    assert found == pytest.approx([0.5, 2 / 3, 1.5, 0.1, 0.05, 0.9, 0.18, 0.09])
    assert goals[5].remark == "wherever the system puts them: 2.00 [2.00, 2.00]"


def test_the_goals_of_a_controller_with_a_period_are_judged_on_one_processor() -> None:
    def found(compiled: float, plain: float, used: float) -> regimes.Found:
        medians = {"direct": 10.0, "socat": 30.0, "gateway compiled": compiled, "gateway": plain}
        trips = {name: [Round.same(us)] * 3 for name, us in medians.items()}
        of_each = {"relay in C": 4000.0, "gateway compiled": used, "gateway": 2 * used}
        costs = {name: [Round.same(ns)] * 3 for name, ns in of_each.items()}
        at_each = dict.fromkeys(regimes.REGIMES, trips)
        return regimes.Found(at_each, dict.fromkeys(regimes.REGIMES, costs), {})

    goals = regimes.goals(found(40.0, 60.0, 70_000.0), found(50.0, 70.0, 0.0), "getppid 0.17 µs")
    estimates = [goal.found.estimate for goal in goals if goal.found is not None]
    # Added: socat 20, compiled 30, not compiled 50; the second is 40 ÷ 30.
    assert estimates == pytest.approx([1.5, 4 / 3, 2.5, 1.5, 70.0, 2.5, 140.0])
    assert [goal.limit for goal in goals] == [1.1, 1.5, 3.0, 1.5, 80.0, 3.5, 200.0]
    assert goals[0].remark == "wherever the system puts them: 2.00 [2.00, 2.00]"
    assert goals[4].remark == "the relay's in C: 4.00 [4.00, 4.00]; getppid 0.17 µs"


@pytest.mark.parametrize(
    "name",
    [
        *(hot.EVEN_SMALL, hot.EVEN_LARGE, hot.FREE_SMALL, hot.FREE_LARGE, hot.REWRITING),
        *(hot.EXCHANGE, hot.SETPOINT, *hot.WITH_TERMS),
    ],
)
def test_the_hot_path_still_prints_the_lines_that_are_judged(name: str) -> None:
    assert f'{name}"' in (BENCH / "hot_path.py").read_text()


def test_what_terms_cost_is_a_ratio_within_the_same_runs() -> None:
    runs = ((10.0, 11.0), (20.0, 24.0), (10.0, 13.0))  # a machine that is half as fast for a while
    names = (hot.SETPOINT, hot.WITH_TERMS[0])
    series = {name: [Round(*4 * (run[i],)) for run in runs] for i, name in enumerate(names)}
    assert hot.ratio(series, hot.WITH_TERMS[0], hot.SETPOINT).estimate == pytest.approx(1.2)


def test_a_line_that_the_hot_path_no_longer_prints_is_not_measured() -> None:
    printed = hot.parsed(
        "correction, 1 000 points, even grid    1.00   0.65\nmeasuring an exchange   0.5    0.25\n"
    )
    series = {name: [Round(us, us, us, us)] * 3 for name, us in printed.items()}
    found = {goal.what: goal.found.estimate if goal.found else None for goal in hot.goals(series, "plain")}
    assert found["correction of one position, 1 000 points, µs, plain"] == 0.65
    assert found["measuring, ns per exchange, plain"] == pytest.approx(250.0)
    assert found["… 100 000 points, µs"] is None
