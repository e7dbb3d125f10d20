"""Recordings of other programs: interpret their columns, and report the interpretation."""
