"""``reload``: what changed is handed over, and what is wrong is said."""

import json

from tests.support.commands import typed
from tests.support.config import STEEPER
from tests.support.gateway import Site, gateway_of

NOTHING = "nothing has changed\n"
"""Also where the supervisor, which watches the files, has been quicker than the command."""


def test_reload_hands_over_what_changed_and_says_what_is_wrong(site: Site) -> None:
    config = str(site.config)
    with gateway_of(site) as (gateway, master):
        assert master.move(50_000) == 50_050
        same = typed("reload", config)
        assert (same.returncode, same.stdout) == (0, NOTHING)
        site.table.write_text(STEEPER)
        new = typed("reload", config)
        assert (new.returncode, new.stderr) == (0, "")
        assert new.stdout in {
            "x: its new correction is applied at the next different target\n",
            NOTHING,
        }
        assert master.move(50_001) == 50_101
        text = site.config.read_text()
        site.config.write_text(text.replace('table = "x.tab"', ""))
        gone = typed("reload", config)
        assert (gone.returncode, gone.stderr) == (0, "")
        assert gone.stdout.splitlines() == [
            "x: it has no table now; the old correction is removed at the next different target",
            "applied now: axis.x.table",
        ]
        assert master.move(50_000) == 50_000
        site.config.write_text(text)
        assert typed("reload", config).returncode == 0
        assert master.move(50_001) == 50_101
        site.table.write_text("no table")
        bad = typed("reload", config, "--json")
        assert bad.returncode == 1
        assert bad.stderr.startswith(f"{site.table}")
        result = json.loads(bad.stdout)
        assert (result["changed"], result["running"]) == ([], True)
        assert result["problems"] == bad.stderr.splitlines()
        assert master.move(50_000) == 50_100
        site.table.write_text(STEEPER)
        site.config.write_text(site.config.read_text().replace("= 1000.0", "= 2000.0"))
        other = typed("reload", config)
        assert other.returncode == 1
        assert other.stderr == (
            f"{config}: restart the gateway: these keys changed since its start: axis.x.counts_per_unit\n"
        )
        assert master.move(50_001) == 50_101
        assert gateway.end() == 0


def test_without_a_gateway_reload_compiles_for_its_start(site: Site) -> None:
    done = typed("reload", str(site.config))
    assert (done.returncode, done.stdout) == (0, "no gateway runs: all is compiled for its next start\n")
    assert (site.config.parent / "state" / "plan.msgpack").exists()
