"""A relay that is held: it loads while the configuration is read, and never outlives a start that failed."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from gateway.cli.processes import command_of, held_relay
from gateway.ipc.children import GO
from gateway.ipc.notes import LogFormat

SECONDS = 60.0


def test_a_start_that_fails_leaves_no_relay(tmp_path: Path) -> None:
    begun = []

    def start() -> None:
        with held_relay(command_of("gateway.relay", tmp_path / "gateway.toml", LogFormat.JSON)) as relay:
            begun.append(relay)
            raise ValueError("it is bad")

    with pytest.raises(ValueError, match="it is bad"):
        start()
    assert [relay.returncode for relay in begun] == [-signal.SIGKILL]


@pytest.mark.parametrize(("word", "said"), [(b"", ""), (GO, "{config}: ")])
def test_it_begins_at_the_word_and_ends_without_one(tmp_path: Path, word: bytes, said: str) -> None:
    config = tmp_path / "gateway.toml"
    command = [sys.executable, "-m", "gateway.relay", str(config), "--parent", str(os.getpid()), "--held"]
    done = subprocess.run(command, input=word, capture_output=True, timeout=SECONDS, check=False)
    assert done.returncode == 1
    # At the word it finds that there is no configuration.
    assert done.stderr.decode().startswith(said.format(config=config))
    assert bool(done.stderr) == bool(word)
