"""A stop of one drive, broadcast in a frame that another drive takes for a target."""

from dataclasses import replace

from gateway.drives.motion import MotionPlan, TriggerPlan
from gateway.modbus.registers import PositionField, RegisterType, WordOrder
from tests.exchange.line_bench import ACTUAL, COMMAND, Bench, axis_plan
from tests.exchange.staged_bench import DEEDS, STOP
from tests.exchange.test_writers import controller

OTHER = PositionField(0x0700, RegisterType.INT32, WordOrder.LOW_FIRST)
OTHER_ACTUAL = PositionField(0x0710, RegisterType.INT32, WordOrder.LOW_FIRST)
TRIGGER = 0x0608


def test_m3_a_drive_without_triggers_that_takes_it_for_a_target_keeps_its_writer_and_its_words() -> None:
    """Low word first: 4000 is 0FA0 0000, 9000 is 2328 0000; 9216 + 10 counts of correction is 240A 0000."""
    motion = MotionPlan(is_staged=True, triggers=(TriggerPlan(TRIGGER, deeds=DEEDS),))
    staged = replace(axis_plan(name="y", unit_id=2, command=(OTHER,), actual=(OTHER_ACTUAL,)), motion=motion)
    bench = Bench(axis_plan(name="x", unit_id=1), staged)
    cnc, panel = controller("cnc"), controller("panel")

    def ask(port: object, pdu: str, unit_id: int = 1) -> None:
        bench.send(bytes.fromhex(pdu), port, unit_id)  # type: ignore[arg-type]
        bench.serve()
        bench.wait(1000)
        bench.memory.put(ACTUAL, bench.memory.get(COMMAND))

    ask(cnc, "10 0606 0002 04 0FA0 0000")
    ask(cnc, "03 0520 0002")
    ask(panel, f"10 0606 0003 06 2328 0000 {STOP:04X}", 0)
    cnc.replies.clear()
    ask(cnc, "06 0606 2400")
    assert [pdu.hex(" ") for _, _, pdu in cnc.replies] == ["06 06 06 24 00"]
    assert bench.seen[-1] == bytes.fromhex("10 0606 0002 04 240A 0000")
    assert bench.line.axes[0].hold.writer == "cnc"
