"""``run``: it looks after both processes, and ends with its relay."""

import os
import signal

import pytest

from tests.support.commands import typed
from tests.support.gateway import Site, gateway_of
from tests.support.processes import SECONDS, children, is_alive, wait_until_dead


def test_a_supervisor_that_is_killed_costs_no_exchange_and_is_started_again(site: Site) -> None:
    with gateway_of(site) as (gateway, master):
        first = children(gateway.process)
        for round_ in range(2):
            os.kill(children(gateway.process)["gateway.supervisor"], signal.SIGKILL)
            for number in range(300):
                # 0.1 % of the position: 50 000 becomes 50 050.
                assert master.move(50_000 + 1000 * (number % 2)) == 50_050 + 1001 * (number % 2)
            ended = gateway.until("supervisor-ended")
            assert ended["status"] == "SIGKILL"
            assert (
                ended["detail"] == f"the relay goes on; the supervisor is restarted in {0.2 * 2**round_:g} s"
            )
            gateway.until("supervisor-started")
            gateway.until("relay-reached")
        again = children(gateway.process)
        assert again["gateway.relay"] == first["gateway.relay"]
        assert again["gateway.supervisor"] != first["gateway.supervisor"]
        assert len(site.drive.told) == 600
        assert gateway.end() == 0


def test_a_supervisor_that_hangs_costs_no_exchange(site: Site) -> None:
    with gateway_of(site) as (gateway, master):
        supervisor = children(gateway.process)["gateway.supervisor"]
        os.kill(supervisor, signal.SIGSTOP)
        for number in range(2000):
            assert master.move(50_000 + 1000 * (number % 2)) == 50_050 + 1001 * (number % 2)
        assert typed("disable", str(site.config)).returncode == 0  # and commands get through
        os.kill(supervisor, signal.SIGCONT)
        assert master.move(60_000) == 60_000
        assert len(site.drive.told) == 2001
        assert gateway.end() == 0


def test_a_hung_supervisor_does_not_keep_the_gateway_from_stopping(site: Site) -> None:
    with gateway_of(site) as (gateway, _):
        supervisor = children(gateway.process)["gateway.supervisor"]
        os.kill(supervisor, signal.SIGSTOP)
        assert gateway.end() == 0
        assert not is_alive(supervisor)


def test_without_its_relay_the_gateway_ends_with_an_error_and_leaves_nobody(site: Site) -> None:
    with gateway_of(site) as (gateway, _):
        pids = children(gateway.process)
        os.kill(pids["gateway.relay"], signal.SIGKILL)
        assert gateway.until("relay-ended")["status"] == "SIGKILL"
        gateway.rest()
        assert gateway.process.wait(SECONDS) == 1
        assert not any(map(is_alive, pids.values()))


def test_a_gateway_that_is_killed_leaves_nobody(site: Site) -> None:
    with gateway_of(site) as (gateway, _):
        pids = children(gateway.process)
        gateway.process.kill()
        for pid in pids.values():
            wait_until_dead(pid)
        # The relay stopped as it does on SIGTERM: its socket is gone.
        gateway.rest()
        assert gateway.notes[-1]["event"] == "stopped"
        assert not site.socket.exists()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_stop_stops_both(site: Site, number: signal.Signals) -> None:
    with gateway_of(site) as (gateway, _):
        pids = children(gateway.process)
        assert set(pids) == {"gateway.relay", "gateway.supervisor"}
        assert gateway.end(number) == 0
        assert not any(map(is_alive, pids.values()))
        assert [note["event"] for note in gateway.notes].count("stopped") == 1
        assert not {"relay-ended", "supervisor-ended"} & {note["event"] for note in gateway.notes}
