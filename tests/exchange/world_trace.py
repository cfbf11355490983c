"""Traces through the small worlds of ``tests.verify``, as text: what happens, and the bytes that it causes.

A line is a request with its results. ``to 1: 10 …`` is the controller's write of the world's second target.
``ack: 03 … -> …`` is the frame that the drive got, and its reply; ``y`` is the second axis. Bytes may be
omitted. ``has: …`` is the frame that the drive has not answered, ``told: …`` the last reply to the
controller. ``flagged`` or ``not-flagged`` says whether the direction is unknown, ``forward`` or ``backward``
which one is used. A comment begins with ``#``. A drive counts 1000 per mm on ``tests.verify.screw.WORN``.
"""

from tests.verify.designs import BY_NAME
from tests.verify.explore import listen, play
from tests.verify.world import Design, Happening, World


def played(design: str | Design, trace: str) -> World:
    """Play a trace. Raises BrokenRuleError for a broken rule, AssertionError for other bytes than it says."""
    world, heard = play(BY_NAME[design] if isinstance(design, str) else design), list[str]()
    listen(world, heard.append)
    for line in trace.splitlines():
        for item in filter(str.strip, line.partition("#")[0].split(",")):
            _step(world, heard, *item.partition(":")[::2])
    return world


def _step(world: World, heard: list[str], what: str, said: str) -> None:
    if (word := what.strip()) in ("forward", "backward"):
        assert world.said(0).direction == word
        return
    if word in ("flagged", "not-flagged"):
        assert world.is_sending_unsure() is (word == "flagged")
        return
    pdu, data = (bytes.fromhex(part) for part in said.partition("->")[::2])
    event, wire = _event(world, *what.split()), world.state.wire
    if event == ("told",):
        answers = [each.split(maxsplit=2)[2] for each in heard if each.split()[0] == "answered"]
        assert answers[-1] == pdu.hex(" ")
        return
    if event[0] == "ask":
        assert pdu in (b"", world.pdu(event[2], *event[4:])), what
    elif event[0] in ("drive", "has"):
        assert wire is not None, what
        assert pdu in (b"", wire.pdu), f"{what}: {wire.pdu.hex(' ')}"
        assert data in (b"", world.reply_to(wire)[2:]), f"{what}: {world.reply_to(wire).hex(' ')}"
    if event != ("has",):
        assert event in world.happenings(), (event, world.happenings())
        world.happen(event)


def _event(world: World, name: str, *rest: str) -> Happening:
    axis, numbers = int("y" in rest), [int(each) for each in rest if each != "y"]
    if name in world.design.menu:
        return ("ask", 0, name, axis, *numbers)
    if name in ("ack", "obey", "refuse"):
        return ("drive", name)
    return (name, axis) if (name, axis) in world.happenings() else (name,)
