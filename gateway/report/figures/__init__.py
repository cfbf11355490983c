"""The pictures of one axis, one idea each: every file makes one :class:`Panel`, or none without its data."""

from gateway.report.figures.backlash import backlash_panel
from gateway.report.figures.correction import correction_panel
from gateway.report.figures.panel import Panel
from gateway.report.figures.readings import readings_panels
from gateway.report.figures.residue import residue_panel
from gateway.report.figures.slope import slope_panel
from gateway.report.findings import Findings

__all__ = ["Panel", "panels"]


def panels(found: Findings) -> list[Panel]:
    """Return the pictures for which there are data, in the order in which one reads them."""
    made = (
        *readings_panels(found),
        residue_panel(found),
        correction_panel(found),
        backlash_panel(found),
        slope_panel(found),
    )
    return [panel for panel in made if panel is not None]
