"""What a supervisor does without: it moves no frames, and has no broker and no sensor here."""

import json
import sys
from pathlib import Path

from tests.support.config import RAMP, one_axis
from tests.support.programs import ran

ROOT = Path(__file__).parents[2]
UNWANTED = (
    *("gateway.exchange.line", "gateway.exchange.axis", "gateway.exchange.fast_path", "gateway.relay"),
    *("gateway.transport.master", "gateway.transport.serial", "gateway.simulator", "gateway.cli", "serial"),
    *("gateway.supervisor.mqtt.publisher", "paho", "gateway.report", "gateway.metrology"),
    *("matplotlib", "numpy", "typer", "rich", "structlog", "cryptography", "pymodbus"),
)
PROGRAM = """
import json, sys
from pathlib import Path
import gateway.supervisor.__main__
import gateway.supervisor.process
from gateway.supervisor.tables import Reloader

outcome = Reloader(Path(sys.argv[1])).reload()
assert not outcome.problems, outcome.problems
print(json.dumps(sorted(sys.modules)))
"""


def test_a_supervisor_without_broker_and_sensor_has_loaded_nothing_of_them(tmp_path: Path) -> None:
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "x.tab").write_text(RAMP)
    (tmp_path / "state").mkdir(mode=0o700)
    config = tmp_path / "gateway.toml"
    config.write_text(one_axis(drives=1, port=2))
    result = ran(sys.executable, "-c", PROGRAM, str(config), timeout=60, cwd=ROOT)
    assert result.returncode == 0, result.stderr
    loaded = json.loads(result.stdout)
    assert {"gateway.supervisor.supervisor", "gateway.config.load"} <= set(loaded)
    found = [name for name in loaded if name.startswith(tuple(f"{unwanted}." for unwanted in UNWANTED))]
    assert found + [name for name in loaded if name in UNWANTED] == []
