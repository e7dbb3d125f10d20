"""`dehyst setup`: lead from two plugged-in units to a validated model, step by step.

The steps use existing parts: drivers, `acquire`, drive design, `identify`, `validate`, `invert`.
steps.py holds the table of steps; journal.py records what was done, so that each step can be
repeated and an interrupted set-up resumed.
"""
