"""Drives of known makes, as their manuals describe them: one file for a register map, and one table of all.

They do not use the gateway's register maps, so that tests against them show errors in those.
"""
