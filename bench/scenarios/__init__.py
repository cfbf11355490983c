"""The scenarios: each file measures one thing and hands over a section of the report."""
