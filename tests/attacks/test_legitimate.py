"""The controller beside the attacks stops when told, however soon that comes."""

from tests.attacks.controller import Work
from tests.attacks.legitimate import legitimate


def test_the_end_of_the_work_may_come_together_with_its_beginning() -> None:
    # Without a gateway between: here it is not what the drive is told that counts.
    with legitimate() as controller:
        controller.connect(controller.drives)
        works: list[Work] = []
        for _ in range(4):
            with controller.working(works):
                pass  # an attack that is over at once: both lines wait together more often than not
    assert [work.lost for work in works] == [0] * 8
