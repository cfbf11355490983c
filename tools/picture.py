"""Draws docs/demo.svg: the demo's own screen at the end of a round. Run with ``python tools/picture.py``."""

import asyncio
import io
import re
import tempfile
from pathlib import Path

from rich.console import Console

from gateway.cli.demo_screen import Screen
from gateway.commissioning.demo.cycle import run_round

OUTPUT = Path(__file__).parents[1] / "docs" / "demo.svg"
SPEED_UP = 100.0
WIDTH, HEIGHT = 110, 44


async def main() -> None:
    console = Console(record=True, width=WIDTH, height=HEIGHT, force_terminal=True, file=io.StringIO())
    screen = Screen(console)
    with tempfile.TemporaryDirectory() as folder:
        await run_round(1, Path(folder), SPEED_UP, screen)
    console.print(screen.picture())
    svg = console.export_svg(title="pitch-gateway demo")
    # The fonts that rich links to are fetched from elsewhere; any monospaced one will do.
    svg = re.sub(r"@font-face \{.*?\}\s*", "", svg, flags=re.DOTALL)
    OUTPUT.write_text(svg.replace("Fira Code", "DejaVu Sans Mono"))


if __name__ == "__main__":
    asyncio.run(main())
