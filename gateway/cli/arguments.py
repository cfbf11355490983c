"""Arguments that several commands take.

All have ``readable=False``: an unreadable file is bad input and ends with exit code 1 and a remedy. Typer's
own check would report wrong usage.
"""

from pathlib import Path
from typing import Annotated

import typer

Config = Annotated[
    Path,
    typer.Argument(metavar="CONFIG", help="Configuration, a TOML file.", show_default=False, readable=False),
]
TableFile = Annotated[
    Path,
    typer.Argument(
        metavar="FILE",
        help="Table file of any format (see 'table formats').",
        show_default=False,
        readable=False,
    ),
]
Line = Annotated[str | None, typer.Option("--line", help="Only this line of the gateway.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
