"""Every wrong value is named with its file, its line, its key, what was found and what is allowed."""

from pathlib import Path

import pytest

from tests.config.config_bench import GOOD, edited, line_of, refusal, refused

SPEED = "max_speed = 200.0"
LISTENER = 'tcp = "127.0.0.1:1502"'
COMMAND = 'command = [{ address = 0x0606, type = "int32", words = "low-first" }]'
HMI = "line.xyz.controllers[2]"
CNC = "line.xyz.controllers[1]"
REGISTERS = "axis.x.registers"
RTU = 'rtu = "/dev/serial/by-id/'
TABLE = 'table = "cnc10x.tab"'
TARGETS = 'blend with setpoints = "targets"; allowed: "step"'
TWO_SIDED = '{ width = 0.02, kind = "two-sided" }'
HOMED = '{ width = 0.6, kind = "homed-forward" }'
ONE_WAY = "allowed: exactly one of rtu, tcp, rtu_over_tcp"

WRONG: list[tuple[str, str, str, str | list[str]]] = [
    # old text, new text, key, what must be said: all of it, or words of it
    ('name = "mill-1"', 'name = "mill 1"', "gateway.name", ['found "mill 1"', "letters"]),
    ('name = "mill-1"', "tabels = 1", "gateway.tabels", ["unknown key", "did you mean tables?"]),
    ('name = "mill-1"', "tables = 3", "gateway.tables", ["found 3", "a text in quotes"]),
    ("baudrate = 115200", "baudrate = 0", "line.xyz.drives.baudrate", ["found 0", "at least 50"]),
    ("baudrate = 115200", "baudrate = 9600.0", "line.xyz.drives.baudrate", ["9600.0", "a whole number"]),
    ('parity = "even"', 'parity = "mark"', "line.xyz.drives.parity", ['"none", "even" or "odd"']),
    ('parity = "even"', "data_bits = 7", "line.xyz.drives.data_bits", ["found 7", "at least 8, at most 8"]),
    ('parity = "even"', "stop_bits = 3", "line.xyz.drives.stop_bits", ["at least 1, at most 2"]),
    ('rtu = "/dev/serial/by-id/usb-B"', 'rtu = "ttyUSB0"', "line.xyz.drives.rtu", ["full path"]),
    (
        'rtu = "/dev/serial/by-id/usb-A"\nbaudrate = 38400',
        'tcp = "1:2:3"',
        "line.xyz.controllers[1].tcp",
        ["HOST:PORT", "[::1]"],
    ),
    (LISTENER, 'tcp = "127.0.0.1:0"', f"{HMI}.tcp", ["port from 1 to 65535"]),
    (LISTENER, 'tcp = "127.0.0.256:1"', f"{HMI}.tcp", ["not an IPv4 address"]),
    (LISTENER, 'tcp = "-:1"', f"{HMI}.tcp", ["HOST:PORT", "[::1]"]),
    (LISTENER, 'tcp = "[::g]:1"', f"{HMI}.tcp", ["not an IPv6 address"]),
    ('role = "monitor"', 'role = "boss"', f"{HMI}.role", ['"motion"', '"monitor"']),
    ('role = "monitor"', "timeout_ms = 0", f"{HMI}.timeout_ms", ["greater than 0"]),
    ('role = "monitor"', "timeout_ms = inf", f"{HMI}.timeout_ms", ["finite number"]),
    ('role = "monitor"', 'allow = ["10.0.0.1/8"]', f"{HMI}.allow[1]", ['found "10.0.0.1/8"', "10.0.0.0/8"]),
    ('role = "monitor"', 'allow = ["pc"]', f"{HMI}.allow[1]", ["a network or address"]),
    ("unit_id = 1", "unit_id = 256", "axis.x.unit_id", ["found 256", "at least 0, at most 255"]),
    ("unit_id = 1", "unit_id = true", "axis.x.unit_id", ["found true", "a whole number"]),
    ('units = "mm"', 'units = "metre"', "axis.x.units", ['found "metre"', '"mm", "inch" or "degree"']),
    ("counts_per_unit = 1000.0", "counts_per_unit = 0", "axis.x.counts_per_unit", ["other than 0"]),
    ("counts_per_unit = 1000.0", 'counts_per_unit = "1000"', "axis.x.counts_per_unit", ["a number"]),
    ("counts_per_unit = 1000.0", "counts_per_unit = nan", "axis.x.counts_per_unit", ["finite number"]),
    ("travel = [-300.0, 0.0]", "travel = [0.0, -300.0]", "axis.x.travel", ["the first below the second"]),
    ("travel = [-300.0, 0.0]", "travel = [0.0]", "axis.x.travel", ["found [0.0]", "a list of 2"]),
    ("travel = [-300.0, 0.0]", "travel = [0.0, 1, 2]", "axis.x.travel", ["2 of them"]),
    ("travel = [-300.0, 0.0]", "travel = 300", "axis.x.travel", ["found 300", "a list in [ ]"]),
    (SPEED, "max_speed = -1", "axis.x.max_speed", ["found -1", "at least 0"]),
    (SPEED, "gain = true", "axis.x.gain", ["found true", "from 0 to 1"]),
    (SPEED, "gain = 1.5", "axis.x.gain", ["found 1.5", "from 0 to 1"]),
    (SPEED, "gain = { forward = 1 }", "axis.x.gain", ["found { forward = 1 }", "backward"]),
    (SPEED, "gain = { forward = 1, backward = 2 }", "axis.x.gain", ["0..1"]),
    (SPEED, 'outside = "clamp"', "axis.x.outside", ['found "clamp"', '"hold"', "fade"]),
    (SPEED, "outside = { fade = 0 }", "axis.x.outside", ["above 0"]),
    (SPEED, 'reversal = "slow"', "axis.x.reversal", ['"step"', "time_ms"]),
    (SPEED, "reversal = { cycles = 1.5 }", "axis.x.reversal", ["WHOLE NUMBER"]),
    (SPEED, "hysteresis = -0.1", "axis.x.hysteresis", ["at least 0"]),
    (SPEED, "max_slope = 1.0", "axis.x.max_slope", ["greater than 0, less than 1"]),
    (SPEED, "reload = { distance = 1, distanc = 1 }", "axis.x.reload.distanc", ["did you mean distance?"]),
    (SPEED, 'home_approach = "up"', "axis.x.home_approach", ['"forward"', '"backward"']),
    ('compensation = "on"', 'compensation = "yes"', "axis.x.compensation", ['"on", "shadow" or "off"']),
    (SPEED, 'backlash = { width = 0, kind = "two-sided" }', "axis.x.backlash.width", ["greater than 0"]),
    (SPEED, "max_sped = 200.0", "axis.x.max_sped", ["unknown key", "did you mean max_speed?"]),
    ("address = 0x0606", "address = 65536", f"{REGISTERS}.command[1].address", ["at most 65535"]),
    ("address = 0x0606", 'address = "0x0606"', f"{REGISTERS}.command[1].address", ["a whole number"]),
    ("address = 0x0606", "address = 0xFFFF", f"{REGISTERS}.command[1]", ["0x10000", "0xffff"]),
    ("bit = 6", "bit = 16", "axis.x.registers.bits.homed.bit", ["found 16", "at most 15"]),
    (
        '0x0606, type = "int32"',
        '0x0606, type = "dint"',
        f"{REGISTERS}.command[1].type",
        ['found "dint"', '"int32"', '"float32"'],
    ),
    (COMMAND, "command = []", f"{REGISTERS}.command", ["found []", "at least 1"]),
    (COMMAND, 'command = { address = 0x0606, type = "int32" }', f"{REGISTERS}.command", ["a list in [ ]"]),
    (
        '0x0520, type = "int32"',
        '0x0520, type = "int32", scale = 0',
        f"{REGISTERS}.actual[1].scale",
        ["found 0", "greater than 0"],
    ),
    # ports, names and units that are used twice or are not there; keys that do not go together
    ('line = "xyz"', 'line = "xzy"', "axis.x.line", "there is no [line.xzy]; did you mean xyz?"),
    (f'{RTU}usb-A"\n', f'{RTU}usb-B"\n', f"{CNC}.rtu", ["usb-B is already used by line.xyz.drives.rtu"]),
    ('name = "hmi"\ntcp', 'name = "cnc"\ntcp', f"{HMI}.name", []),
    ("unit_id = 1", "unit_id = 0", "axis.x.unit_id", ["unit_id: unit_id = 0 on a serial line; "]),
    (
        '0x0606, type = "int32"',
        '0x0606, type = "int16"',  # -300 mm × 1000 counts/mm = -300 000 counts: an int16 ends at -32 768
        f"{REGISTERS}.command[1]",
        ["travel ends at -300 mm, that is -300000 counts", "-32768", "counts_per_unit"],
    ),
    (SPEED, "reversal = { distance = 1 }", "axis.x.reversal", [f"reversal: a distance {TARGETS}"]),
    (SPEED, "reversal = { time_ms = 20 }", "axis.x.reversal", [f"reversal: a time_ms {TARGETS}"]),
    (SPEED, "reversal = { cycles = 5 }", "axis.x.reversal", [f"reversal: a cycles {TARGETS}"]),
    (
        TABLE,
        'table_options.v1_layout = "listed"',
        "axis.x.table_options",
        ["options: table_options without a table; "],
    ),
    (SPEED, f"backlash = {TWO_SIDED}", "axis.x.backlash", ["two directions"]),
    (TABLE, f"backlash = {HOMED}", "axis.x.backlash.width", ["0.6", "max_correction = 0.5"]),
    ('parity = "even"', 'tcp = "127.0.0.1:502"', "line.xyz.drives", [ONE_WAY]),
    # times of an axis
    (SPEED, "budget_us = 0", "axis.x.budget_us", "found 0; allowed: greater than 0, at most 3600000000"),
    (
        SPEED,
        "budget_us = -1.0",
        "axis.x.budget_us",
        "found -1.0; allowed: greater than 0, at most 3600000000",
    ),
    (SPEED, "budget_us = inf", "axis.x.budget_us", "found inf; allowed: a finite number"),
    (SPEED, 'budget_us = "500"', "axis.x.budget_us", 'found "500"; allowed: a number'),
    (SPEED, "deadline_ms = 0", "axis.x.deadline_ms", "found 0; allowed: greater than 0, at most 3600000"),
    (SPEED, "deadline_ms = nan", "axis.x.deadline_ms", "found nan; allowed: a finite number"),
    (
        SPEED,
        "deadline_ms = 3600001",
        "axis.x.deadline_ms",
        "found 3600001; allowed: greater than 0, at most 3600000",
    ),
    (SPEED, 'late = "reject"', "axis.x.late", ['late = "reject" without deadline_ms', "give deadline_ms"]),
    (SPEED, 'late = "drop"\ndeadline_ms = 5', "axis.x.late", 'found "drop"; allowed: "forward" or "reject"'),
]


@pytest.mark.parametrize(("old", "new", "key", "said"), WRONG, ids=[f"{w[2]}-{w[1]}" for w in WRONG])
def test_a_wrong_value_is_named_with_line_and_key(
    tmp_path: Path, old: str, new: str, key: str, said: str | list[str]
) -> None:
    text = edited((old, new))
    problem = refusal(tmp_path, text, key)
    assert problem.file == str(tmp_path / "gateway.toml")
    assert problem.line == line_of(text, new)
    begin = f"{problem.file}:{problem.line}: {key}: "
    if isinstance(said, str):
        assert str(problem) == begin + said
        return
    assert str(problem).startswith(begin)
    for words in said:
        assert words in str(problem)


MISSING = [
    ('line = "xyz"\n', "axis.x.line", "[axis.x]"),
    ("unit_id = 1\n", "axis.x.unit_id", "[axis.x]"),
    ('units = "mm"\n', "axis.x.units", "[axis.x]"),
    ("counts_per_unit = 1000.0\n", "axis.x.counts_per_unit", "[axis.x]"),
    ('referenced = "drive-bit"\n', "axis.x.referenced", "[axis.x]"),
    ('name = "cnc"\n', "line.xyz.controllers[1].name", "[[line.xyz.controllers]]"),
    (f"{COMMAND}\n", f"{REGISTERS}.command", "[axis.x.reg"),
    (
        'drives = { rtu = "/dev/serial/by-id/usb-B", baudrate = 115200, parity = "even" }\n',
        "line.xyz.drives",
        "[line.xyz]",
    ),
]


@pytest.mark.parametrize(("old", "key", "table"), MISSING, ids=[m[1] for m in MISSING])
def test_a_missing_key_is_named_at_its_table_with_what_it_is_for(
    tmp_path: Path, old: str, key: str, table: str
) -> None:
    problem = refusal(tmp_path, edited((old, "")), key, at=table)
    assert problem.found == "missing"
    assert problem.remedy.startswith("needed: ")
    assert len(problem.remedy) > len("needed: ")


def test_serial_settings_beside_tcp_are_refused(tmp_path: Path) -> None:
    problem = refusal(tmp_path, edited(('role = "monitor"', "baudrate = 9600")), "line.xyz.controllers[2]")
    assert "baudrate belong to a serial port (rtu): leave out beside tcp" in problem.remedy


def test_allow_beside_rtu_is_refused(tmp_path: Path) -> None:
    text = edited(("baudrate = 38400", 'allow = ["10.0.0.0/8"]'))
    assert "allow belongs to tcp" in refusal(tmp_path, text, "line.xyz.controllers[1]").remedy


def test_an_unknown_section_gets_a_suggestion(tmp_path: Path) -> None:
    text = GOOD + "\n[lines.b]\n"
    problem = refusal(tmp_path, text, "lines")
    assert (problem.line, problem.remedy) == (line_of(text, "[lines.b]"), "did you mean line?")


def test_a_section_that_is_no_table_is_refused(tmp_path: Path) -> None:
    problem = refusal(tmp_path, "gateway = 3\n" + edited(('[gateway]\nname = "mill-1"\n', "")), "gateway")
    assert (problem.line, problem.remedy) == (1, "allowed: a table [gateway]")


@pytest.mark.parametrize("kind", ["line", "axis"])
def test_lines_and_axes_are_tables_with_names(tmp_path: Path, kind: str) -> None:
    problems = refused(tmp_path, f"{kind} = [1]\n")
    assert (kind, f"allowed: tables [{kind}.NAME]") in [(p.key, p.remedy) for p in problems]


def test_a_name_that_cannot_be_a_topic_or_a_file_is_refused(tmp_path: Path) -> None:
    refusal(tmp_path, GOOD.replace("[axis.x", '[axis."a/b"'), 'axis."a/b"', at='[axis."a/b"]')


def test_at_least_one_line_is_needed(tmp_path: Path) -> None:
    assert "at least one [line.NAME]" in refusal(tmp_path, "", "line").remedy


def test_two_ways_at_once_are_reported_beside_the_other_faults_of_their_table(tmp_path: Path) -> None:
    text = edited(
        ("baudrate = 38400", 'tcp = "127.0.0.1:1504"\ntimeout_ms = -1'),
        ("baudrate = 115200, ", 'tcp = "10.0.0.1:502", baudrate = 1, '),
    )
    said = [(problem.key, problem.remedy) for problem in refused(tmp_path, text)]
    assert said == [
        ("line.xyz.drives.baudrate", "allowed: at least 50, at most 12000000"),
        ("line.xyz.drives", "allowed: exactly one of rtu, tcp, rtu_over_tcp"),
        ("line.xyz.controllers[1]", "allowed: exactly one of rtu, tcp, rtu_over_tcp"),
        ("line.xyz.controllers[1].timeout_ms", "allowed: greater than 0, at most 3600000"),
    ]


def test_two_ways_at_once_are_one_problem_where_nothing_else_is_wrong(tmp_path: Path) -> None:
    text = edited(("baudrate = 38400", 'tcp = "127.0.0.1:1504"'))
    problem = refusal(tmp_path, text, "line.xyz.controllers[1]")
    assert problem.remedy == "allowed: exactly one of rtu, tcp, rtu_over_tcp"


def test_everything_is_said_at_once(tmp_path: Path) -> None:
    text = edited(
        ("unit_id = 1", "unit_id = 999"),
        ("counts_per_unit = 1000.0", "counts_per_units = 1000.0"),
        ('line = "xyz"', 'line = "xzy"'),
        ('table = "cnc10x.tab"', 'table = "cnc10y.tab"'),
        ('role = "monitor"', "timeout_ms = -5"),
        ("baudrate = 38400", 'role = "operatr"'),
        ("address = 0x0520", "address = 0x0607"),
    )
    assert [problem.key for problem in refused(tmp_path, text)] == [
        "line.xyz.controllers[1].role",
        "line.xyz.controllers[2].timeout_ms",
        "axis.x.counts_per_unit",
        "axis.x.line",
        "axis.x.unit_id",
        "axis.x.counts_per_units",
        "axis.x.table",
        "axis.x.registers.actual[1]",
    ]


@pytest.mark.parametrize(
    ("text", "key", "said"),
    [
        ("fifo = 100", "relay.fifo", ["found 100", "at least 0, at most 99"]),
        ("fifo = -1", "relay.fifo", ["found -1", "at least 0, at most 99"]),
        ("fifo = true", "relay.fifo", ["found true", "a whole number"]),
        ("fifo = 50.0", "relay.fifo", ["found 50.0", "a whole number"]),
        ("cpus = 3", "relay.cpus", ["found 3", "a list in [ ]"]),
        ("cpus = [0, -1]", "relay.cpus[2]", ["found -1", "at least 0, at most 8191"]),
        ("cpus = [1, 1]", "relay.cpus", ["found [1, 1]", "each CPU once"]),
        ("lock_memory = 1", "relay.lock_memory", ["found 1", "true or false"]),
        ("fifi = 1", "relay.fifi", ["unknown key", "did you mean fifo?"]),
    ],
)
def test_scheduling_that_cannot_be(tmp_path: Path, text: str, key: str, said: list[str]) -> None:
    problem = refusal(tmp_path, f"{GOOD}\n[relay]\n{text}\n", key, at=text)
    assert all(words in f"{problem.found}; {problem.remedy}" for words in said)
