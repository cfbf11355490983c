"""A gateway with a controller that works, and somebody who attacks: what he gets, and what it costs."""

import contextlib
import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.attacks.controller import Work
from tests.support.config import one_axis, written
from tests.support.ports import free_port
from tests.support.processes import ROOT, Running, running, started

MOVES = 100
"""Moves of the controller without an attack, and at least during one."""
PAUSE_S = 0.2
"""Between one time and the next, where an attack is tried again and again."""
_HOSTS = (f"127.0.{net}.{host}" for net in range(9, 250) for host in range(100, 250))


def new_host() -> str:
    """Return a host that nobody has been at yet: what a gateway remembers of others is nothing to him.

    None of them begins another one.
    """
    return next(_HOSTS)


class Legitimate:
    """The controller of ``tests.attacks.controller``, from outside."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self._process = process
        self.drives = int(self.read())

    def connect(self, port: int, *files: Path) -> None:
        """Connect to the gateway; with a CA, a certificate and its key over TLS."""
        self.say(" ".join(["connect", str(port), *map(str, files)]))
        self.read()

    def work(self, moves: int = MOVES) -> Work:
        """Have it do so many moves."""
        self.say(f"work {moves}")
        return Work(**json.loads(self.read()))

    @contextlib.contextmanager
    def working(self, into: list[Work]) -> Iterator[None]:
        """Have it work meanwhile, and :data:`MOVES` moves more; what came of both goes ``into`` a list."""
        self.say("carry-on")
        yield
        self.say("")
        into.append(Work(**json.loads(self.read())))
        into.append(self.work())

    def say(self, line: str) -> None:
        """Write a line, or more than one at once, to its commands."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{line}\n")
        self._process.stdin.flush()

    def read(self) -> str:
        """Read a line that it printed."""
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        assert line, "the legitimate controller ended"
        return line


@contextlib.contextmanager
def legitimate() -> Iterator[Legitimate]:
    command = [sys.executable, "-m", "tests.attacks.controller"]
    pipe = subprocess.PIPE
    with started(command, cwd=ROOT, stdin=pipe, stdout=pipe, text=True) as process:
        yield Legitimate(process)


@dataclass
class Ground:
    """Where attacks take place: the folder of a gateway that runs, its ports, its log."""

    folder: Path
    port: int
    """Of the controller ``cnc``, by which the legitimate one works."""
    drives: int
    others: dict[str, int] = field(default_factory=dict)
    """Further ports that the configuration of an attack asked for, by a name of its own."""
    attacker: str = ""
    """The host from which the attack comes."""
    gateway: Running | None = None
    legitimate: Legitimate | None = None

    def free(self, name: str) -> int:
        """Return a port for something else, the same for the same name."""
        return self.others.setdefault(name, free_port())

    @property
    def events(self) -> list[dict[str, Any]]:
        """What the log has said so far; all of it once the gateway has ended."""
        assert self.gateway is not None
        return self.gateway.notes


@dataclass(frozen=True)
class Attack:
    """Something that somebody tries who may not."""

    name: str
    strike: Callable[[Ground], str]
    """Does it once, asserts what it got, and says so in a few words for the table."""
    event: str
    """What the log says of it."""
    configuration: Callable[[Ground, str], str] = lambda _ground, text: text
    """Makes the configuration for it of the usual one."""
    connect: Callable[[Ground, Legitimate], None] = lambda ground, legitimate: legitimate.connect(ground.port)
    secrets: tuple[str, ...] = ()
    """What the log never says."""
    names_attacker: bool = True
    """False where the log has nothing against him: the event is then one that was there before."""

    def is_told(self, note: dict[str, Any], attacker: str) -> bool:
        """Whether a line of the log tells of this attack, and from where it comes."""
        return note["event"] == self.event and (attacker in str(note) or not self.names_attacker)


@dataclass(frozen=True)
class Outcome:
    """What came of an attack."""

    attack: Attack
    got: str
    calm: Work
    meanwhile: Work

    def check(self) -> None:
        """Assert what holds for every attack: the controller noticed nothing."""
        for work in (self.calm, self.meanwhile):
            assert (work.lost, work.wrong) == (0, [])
            assert work.moves >= MOVES


@contextlib.contextmanager
def ground_of(attack: Attack, folder: Path) -> Iterator[Ground]:
    """Run a gateway as an attack wants it, with a controller that is connected; at the end both are well."""
    with legitimate() as controller:
        ground = Ground(folder, free_port(), controller.drives, legitimate=controller)
        config = written(folder, attack.configuration(ground, one_axis(ground.drives, ground.port)))
        with running("run", str(config)) as gateway:
            ground.gateway = gateway
            gateway.until_each("line-up", "relay-reached")
            attack.connect(ground, controller)
            yield ground
            assert gateway.end() == 0, gateway.notes
            said = str(gateway.notes)
            assert all(secret not in said for secret in attack.secrets)


def tried(attack: Attack, ground: Ground, seconds: float = 0.0) -> Outcome:
    """Try an attack once, or again and again for ``seconds``, while the controller works.

    The log has to say it, and what it says of a host has to name the attacker's.
    """
    assert ground.gateway is not None
    assert ground.legitimate is not None
    ground.attacker = new_host()
    calm = ground.legitimate.work(MOVES if not seconds else int(seconds * 100))
    works: list[Work] = []
    ends_s = time.monotonic() + seconds
    with ground.legitimate.working(works):
        got = attack.strike(ground)
        while time.monotonic() < ends_s:
            time.sleep(PAUSE_S)  # else the limit of connections is what an attack meets first
            got = attack.strike(ground)
    while not any(attack.is_told(note, ground.attacker) for note in ground.events):
        ground.gateway.next()
    return Outcome(attack, got, calm, works[0] if seconds else _both(*works))


def _both(one: Work, other: Work) -> Work:
    """Only counts add up; nobody asserts times in a test."""
    return Work(one.moves + other.moves, one.lost + other.lost, one.wrong + other.wrong)
