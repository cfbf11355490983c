"""A whole gateway with a contact on a line of gpio-sim, the kernel's own GPIO chip without a chip.

Kernel documentation, admin-guide/gpio/gpio-sim: a bank is made in configfs, and ``value`` of a line in sysfs
has the level that its user drives; a line that nobody has falls back to its pull, down at first.
"""

import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.support.gateway import Site, relay_of
from tests.support.processes import ending, eventually, running

SIM = Path("/sys/kernel/config/gpio-sim")
LINE, LINES = 17, 32
pytestmark = pytest.mark.skipif(
    not os.access(SIM, os.W_OK), reason=f"no {SIM}: modprobe gpio-sim, with configfs mounted, as root"
)


@dataclass
class Chip:
    """A chip whose levels can be read from outside."""

    device: str
    lines: Path

    def wait_for(self, level: int) -> None:
        value = self.lines / f"sim_gpio{LINE}" / "value"
        eventually(lambda: int(value.read_text()), lambda found: found == level)


@pytest.fixture(name="chip")
def _chip() -> Iterator[Chip]:
    made = SIM / f"pitch-gateway-{os.getpid()}"
    bank = made / "bank0"
    made.mkdir()
    try:
        bank.mkdir()
        (bank / "num_lines").write_text(str(LINES))
        (made / "live").write_text("1")
        name = (bank / "chip_name").read_text().strip()
        yield Chip(
            f"/dev/{name}", Path("/sys/devices/platform") / (made / "dev_name").read_text().strip() / name
        )
    finally:
        if (made / "live").read_text().strip() == "1":
            (made / "live").write_text("0")
        if bank.exists():
            bank.rmdir()
        made.rmdir()


@pytest.mark.parametrize("is_active_low", [False, True])
def test_it_opens_with_a_killed_relay_and_falls_to_its_pull_with_a_killed_supervisor(
    site: Site, chip: Chip, is_active_low: bool
) -> None:
    low = str(is_active_low).lower()
    gpio = f'{{ chip = "{chip.device}", line = {LINE}, active_low = {low} }}'
    site.config.write_text(f"[alarm_output]\ngpio = {gpio}\nevery_s = 0.2\n{site.config.read_text()}")
    site.compile()
    is_closed, is_open = (0, 1) if is_active_low else (1, 0)
    with running("supervise", str(site.config)) as supervisor:
        with relay_of(site) as (relay, master):
            assert master.move(50_000) == 50_050
            chip.wait_for(is_closed)
            relay.process.kill()
            chip.wait_for(is_open)
            relay.rest()
        with relay_of(site), ending(supervisor):
            chip.wait_for(is_closed)
        chip.wait_for(0)  # nobody has it: the pull of the chip
    with relay_of(site), running("supervise", str(site.config)) as another:
        chip.wait_for(is_closed)
        os.kill(another.process.pid, signal.SIGKILL)
        chip.wait_for(0)
        another.rest()
