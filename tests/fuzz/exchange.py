"""A whole line: bytes come from controllers and from drives, time passes, and the exchange between them runs.

The first byte chooses who speaks RTU and which drives there are. Then come instructions: a byte, what is done
in its three lowest bits, and what that needs.
"""

from collections.abc import Iterator
from struct import Struct
from typing import Final

from tests.exchange.line_bench import read, write
from tests.fuzz.frames import golden_frames
from tests.fuzz.line import FREE_UNIT, Line, machines
from tests.fuzz.script import Script, said

CNC, OTHER, ANSWER, RAW, REPLY, TIME, CONTROL, GLUED = range(8)
READ: Final = bytes.fromhex("03 02 00 00 02")


def traffic(data: bytes) -> None:
    """Nothing is sent twice, two at a time or changed where it is not mapped, and the line always goes on.

    Each reply has a request that waited for it. However the bytes came, in the end nothing waits any more,
    and the next request goes out and comes back as it is.
    """
    script = Script(data)
    world = Line(script.byte())
    while not script.is_over:
        does = script.byte()
        match does & 7:
            case 0 | 7:
                world.request(0, script, is_glued=does & 7 == GLUED)
            case 1:
                world.request(1 + (does >> 3) % 3, script, is_glued=False)
            case 2:
                world.drives.hear(world.drives.framed(world.drives.answer()), world.now_ns)
            case 3:
                if does & 8:
                    world.drives.hear(script.text(), world.now_ns)
                else:
                    world.controllers[(does >> 4) & 3].hear(script.text(), world.now_ns)
            case 4:
                world.drives.hear(world.drives.framed(script.text(), does >> 6), world.now_ns)
            case 5:
                world.wait(1.4 ** (does >> 3))
            case 6:
                world.control(does >> 3, script)
    world.settle()
    cnc = world.controllers[0]
    cnc.begin_anew()
    cnc.waits_for.clear()
    cnc.replies.clear()
    cnc.hear(cnc.framed(FREE_UNIT, READ, 7), world.now_ns)
    assert world.drives.asked is not None, "the line does not go on"
    assert world.drives.asked[1:] == (FREE_UNIT, READ)
    reply = bytes.fromhex("03 04 00 B1 1F 40")
    world.drives.hear(world.drives.framed(reply), world.now_ns)
    assert cnc.replies == [reply], "a reply that does not come back"


def asked(unit: int, *pdus: bytes) -> bytes:
    """Write requests of the motion controller to the unit of a number, each answered as it should be."""
    return b"".join(
        bytes((CNC, unit)) + said(pdu) + bytes((ANSWER, ANSWER, ANSWER, TIME | 4 << 3)) for pdu in pdus
    )


def seeds() -> Iterator[bytes]:
    """Yield moves, reads and triggers of each axis in all ways of wiring, and the manuals' frames."""
    for number, plans in enumerate(machines()):
        units = sorted({plan.unit_id for plan in plans})
        for plan in plans:
            unit = units.index(plan.unit_id)
            place, pdus = plan.command[0], []
            for counts in (1000, 500):
                pdus.append(write(place, counts))
                for trigger in plan.motion.triggers:
                    values = (value & 0xFFFF for value in list(trigger.deeds)[:4])
                    pdus += [Struct(">BHH").pack(6, trigger.address, value) for value in values]
                pdus += [read(each) for each in plan.actual[:1]]
            moves = b"".join(asked(unit, pdu) + bytes((CONTROL | 15 << 3,)) for pdu in pdus)
            half = b"\x06" + place.address.to_bytes(2, "big") + b"\x01\x02"
            late = (
                bytes((CNC, unit)) + said(half) + bytes((TIME | 24 << 3, ANSWER, OTHER, unit)) + said(pdus[0])
            )
            glued = b"".join(bytes((CNC, unit)) + said(pdu) for pdu in pdus[:4]) + bytes((ANSWER,)) * 8
            for wiring in range(4):
                yield bytes((number << 2 | wiring,)) + moves
                yield bytes((number << 2 | wiring,)) + glued
            yield (
                bytes((number << 2 | 1,))
                + late
                + bytes((CONTROL, TIME | 9 << 3, CONTROL | 1 << 3))
                + moves[:300]
            )
    for request, reply in golden_frames():
        if request and reply:
            exchanged = bytes((CNC, 0)) + said(request[1:-2]) + bytes((REPLY,)) + said(reply[1:-2])
            yield bytes((3,)) + exchanged + bytes((RAW | 8,)) + said(reply + reply)
            yield bytes((0,)) + exchanged + bytes((GLUED, 3)) + said(request[1:-2]) + said(request)
