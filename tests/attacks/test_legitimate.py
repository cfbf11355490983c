"""The controller beside the attacks stops when told, however soon that comes."""

import json

from tests.attacks.controller import Work
from tests.attacks.legitimate import legitimate


def test_the_end_of_the_work_may_come_together_with_its_beginning() -> None:
    with legitimate() as controller:
        controller.connect(controller.drives)  # its own drive, without a gateway between
        controller.say("carry-on\n")
        work = Work(**json.loads(controller.read()))
    assert (work.moves, work.lost) == (0, 0)
