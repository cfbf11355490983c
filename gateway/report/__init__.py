"""Pictures and reports of what was measured, what a table does about it and what is left: matplotlib."""
