"""What a position command touches on its way is compiled, whatever the way."""

from typing import Final

import pytest

from gateway.compiled import is_compiled
from tools.compiled import PLAIN, ROOT, modules
from tools.walks import files_of_positions

NOT_COMPILED: Final = {
    "drives/motion.py": "plans of motion, which msgspec takes apart as those of PLAIN",
    "system.py": "calls of the C library by ctypes; a deadline that moves later needs none",
}


@pytest.mark.skipif(is_compiled(), reason="calls of compiled functions are not seen")
def test_each_file_that_a_position_command_touches_is_compiled() -> None:
    touched = files_of_positions(ROOT)
    assert {"exchange/line.py", "exchange/axis/motion.py", "relay/controller_port.py"} <= touched
    compiled = {name.removeprefix("gateway/") for name in modules(ROOT / "gateway")}
    left = touched - compiled - set(PLAIN) - NOT_COMPILED.keys()
    assert not left, f"PATTERNS in tools/compiled.py has to name {sorted(left)}"
