"""``listen``: what passes on a line, heard without saying a word."""
