"""`dehyst setup`: from two plugged-in units to a validated model, step by step.

A sequence over what is there already: drivers, `acquire`, the drive's design, `identify`,
`validate`, `invert`. steps.py is the table of steps; journal.py keeps what was done, so that each
can be repeated and all can be resumed.
"""
