"""``tests/costs.py`` tells what a test uses itself, what its programs use, and what it waits."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BUSY = "import time\nwhile time.process_time() < 0.5: pass"
USES = {
    "itself": "import time\ndef test_it():\n    end = time.process_time() + 0.5\n"
    "    while time.process_time() < end: pass\n",
    "programs": "import subprocess, sys\ndef test_it():\n"
    f"    subprocess.run([sys.executable, '-c', {BUSY!r}])\n",
    "waits": "import threading\ndef test_it():\n    threading.Event().wait(0.5)\n",
}


@pytest.mark.parametrize("workers", [(), ("-n", "1")], ids=["alone", "in a worker"])
def test_each_kind_of_time_has_its_column(tmp_path: Path, workers: tuple[str, ...]) -> None:
    for name, text in USES.items():
        (tmp_path / f"test_{name}.py").write_text(text)
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-p", "tests.costs", *workers]
    said = subprocess.run(
        [*command, "--rootdir", str(tmp_path), str(tmp_path)],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    ).stdout
    lines = re.findall(r"^ +([\d.]+) +([\d.]+) +([\d.]+) +1  \S*test_(\w+)\.py$", said, re.MULTILINE)
    found = {name: [float(each) for each in (own, programs, wall)] for own, programs, wall, name in lines}
    assert found.keys() == USES.keys()
    # Each of them half a second, and no other beside that of the programs does anything to speak of.
    assert found["itself"][0] >= 0.4
    assert found["programs"][1] >= 0.4
    assert max(found["itself"][1], found["programs"][0], *found["waits"][:2]) < 0.4
    assert all(wall >= 0.4 for _, _, wall in found.values())
    assert re.search(r" 3  all 3 files$", said, re.MULTILINE)
