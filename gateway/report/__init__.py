"""Pictures and reports of measurements, of a table's effect and of the remaining errors: matplotlib."""
