"""What the relay does without: nothing of it is in its process."""

import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
UNWANTED = (
    *("pydantic", "pymodbus", "paho", "starlette", "uvicorn", "prometheus_client", "matplotlib"),
    *("rich", "typer", "structlog", "cryptography", "gateway.cli", "gateway.config", "gateway.tabfile"),
    *("gateway.supervisor", "gateway.simulator", "argparse", "random", "tempfile"),
)
PROGRAM = """
import asyncio, json, sys
from pathlib import Path
import gateway.relay.__main__, gateway.relay.run
from gateway.ipc.log import json_writer
from gateway.state.plan import GatewayPlan
from gateway.relay.gateway import Relay

async def live():
    relay = Relay(GatewayPlan("bench", ()), json_writer("bench"), state=Path(sys.argv[1]))
    await relay.start()
    relay.status()
    await relay.stop()

asyncio.run(live())
print(json.dumps(sorted(sys.modules)))
"""


def test_a_relay_that_ran_has_loaded_nothing_that_it_does_not_need(tmp_path: Path) -> None:
    result = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(tmp_path / "state")],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
        cwd=ROOT,
    )
    loaded = json.loads(result.stdout)
    assert "gateway.relay.run" in loaded
    found = [name for name in loaded if name.startswith(tuple(f"{unwanted}." for unwanted in UNWANTED))]
    assert found + [name for name in loaded if name in UNWANTED] == []
