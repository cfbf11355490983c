"""Pure text: one file per dialect, text <-> correction table; lints; explain."""
