"""Load beside the relay, as a process of its own: a table that changes each second, pages that are loaded.

    python -m bench.background TABLE POINTS PAGES_PER_SECOND PAGE_URL|- [COMMAND...]

Replaces TABLE once a second by another one of as many points (temporary file and rename, as editors do),
loads the page so often, each time over a connection of its own, and starts COMMAND once a second, if there is
one. Says ``begun`` after the first second, and one line of JSON when it is stopped.
"""

import http.client
import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import FrameType
from typing import Final
from urllib.parse import urlsplit

from bench.gateway_setup import table_text

SCALES: Final = (0.9, 1.0)
PERIOD_S: Final = 1.0
LAST_COMMAND_S: Final = 20.0
"""So long a command that was started is waited for at the end."""


class _Background:
    def __init__(self, table: Path, points: int, page: str, command: list[str]) -> None:
        self._table = table
        self._texts = [table_text(points, scale) for scale in SCALES]
        self._page = urlsplit(page)
        self._command = command
        self._started: subprocess.Popen[bytes] | None = None
        self.counts = {"tables": 0, "commands": 0, "pages": 0, "failed_pages": 0}

    def change(self) -> None:
        unfinished = self._table.with_suffix(".unfinished")
        unfinished.write_text(self._texts[self.counts["tables"] % len(SCALES)])
        unfinished.replace(self._table)
        self.counts["tables"] += 1
        if self._command and (self._started is None or self._started.poll() is not None):
            quiet = subprocess.DEVNULL
            self._started = subprocess.Popen(self._command, stdout=quiet, stderr=quiet, stdin=quiet)
            self.counts["commands"] += 1

    def load_page(self) -> None:
        connection = http.client.HTTPConnection(self._page.hostname or "", self._page.port, timeout=1.0)
        try:
            connection.request("GET", self._page.path or "/")
            is_good = connection.getresponse().read() != b""
        except (OSError, http.client.HTTPException):
            is_good = False
        finally:
            connection.close()
        self.counts["pages" if is_good else "failed_pages"] += 1

    def finish(self) -> None:
        if self._started is not None:
            self._started.wait(LAST_COMMAND_S)


def _stop(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def main(table: str, points: str, pages_per_second: str, page: str, *command: str) -> None:
    """Run until it is stopped."""
    signal.signal(signal.SIGTERM, _stop)
    background = _Background(Path(table), int(points), page, list(command))
    rate = 0 if page == "-" else int(pages_per_second)
    start, pages = time.monotonic(), 0
    try:
        background.change()
        while True:
            now = time.monotonic() - start
            if now >= background.counts["tables"] * PERIOD_S:
                if background.counts["tables"] == 1:
                    sys.stdout.write("begun\n")
                    sys.stdout.flush()
                background.change()
            if pages < now * rate:
                background.load_page()
                pages += 1
            else:
                next_table = start + background.counts["tables"] * PERIOD_S
                next_page = start + pages / rate if rate else next_table
                time.sleep(max(0.0, min(next_table, next_page) - time.monotonic()))
    except KeyboardInterrupt:
        background.finish()
        sys.stdout.write(json.dumps(background.counts) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
