"""``pitch-gateway table edit``: a table on a page of this computer, to look at and to change."""

import threading
import webbrowser
from dataclasses import dataclass, field
from typing import Annotated

import typer

from gateway.cli.arguments import TableFile
from gateway.cli.options import takes_options
from gateway.cli.output import print_lines
from gateway.cli.table_options import MaxCorrection, MaxSlope
from gateway.cli.table_reading import own_units, problems, with_limits
from gateway.commissioning.table_options import Counts, ReadOptions
from gateway.tabfile import dialect_of


@dataclass(frozen=True, slots=True)
class EditOptions:
    """How the file is read, and whether the browser is opened."""

    source: ReadOptions = field(default_factory=ReadOptions)
    counts_per_unit: Counts = None
    max_slope: MaxSlope = None
    max_correction: MaxCorrection = None
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Print the address of the page, and open no browser.")
    ] = False


@takes_options
def edit(file: TableFile, *, options: EditOptions) -> None:
    """Show a table on a page of this computer, and change its points there.

    Drag a point, type its value, or use the keyboard alone. The page shows the table before and after, and
    each remark of 'table lint' at once. Save writes the format of FILE, and keeps the old file beside it as
    FILE.bak. The command ends when you close the tab, or by Ctrl-C.

    Only this computer reaches the page, at the printed address. Formats that are only read: convert first.

    Examples:
      pitch-gateway table edit cnc10z.tab

      pitch-gateway table edit CNC7X.TAB --file-counts-per-unit 64000 --no-browser
    """
    from gateway.commissioning.editor.editing import Editing
    from gateway.commissioning.editor.serving import EditorServer

    with problems():
        context = with_limits(
            options.source.context(options.counts_per_unit), options.max_slope, options.max_correction
        )
        editing = Editing(file, own_units(dialect_of(file, context.format), context), options.source)
    with EditorServer(editing, lambda said: print_lines([said])) as server:
        print_lines([f"{file}: {server.url}", "close the tab, or press Ctrl-C, to end"])
        if not options.no_browser:  # a browser of the terminal would not come back
            threading.Thread(target=webbrowser.open, args=(server.url,), daemon=True).start()
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            print_lines([""])
    print_lines([editing.conclusion()])
