"""The corrections of the table: what is added to a command, moving forward and moving backward."""

from typing import TYPE_CHECKING

from gateway.report.envelope import thinning_note
from gateway.report.figures.panel import Panel, curve, dress, legend
from gateway.report.findings import Findings
from gateway.report.ink import BACKWARD_STYLE, BOTH_STYLE, FORWARD_STYLE

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def correction_panel(found: Findings) -> Panel | None:
    """Return the correction curves, if there is a table."""
    table = found.story.table
    if table is None:
        return None
    show = found.scale.of

    def draw(axes: "Axes") -> None:
        dress(axes, found, "correction")
        if table.is_unidirectional:
            one = [show(c) for c in table.forward]
            curve(axes, table.positions, one, "both", label="both directions", **BOTH_STYLE)
        else:
            for name, values, style in (
                ("forward", table.forward, FORWARD_STYLE),
                ("backward", table.backward, BACKWARD_STYLE),
            ):
                shown = [show(c) for c in values]
                curve(axes, table.positions, shown, name, label=f"moving {name}", **style)
        legend(axes)

    largest = found.scale.rounded(table.max_correction())
    about = (
        f"What the gateway adds to a commanded position, at {len(table.positions)} points; between them it "
        f"is a straight line. The largest correction is {largest}."
    )
    if table.is_unidirectional:
        about += " The table is the same for both directions."
    about += thinning_note(len(table.positions))
    return Panel("correction", "Correction table", about, draw)
