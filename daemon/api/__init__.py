"""Functions that `import dehyst` provides: the functions of the command line, on arrays and
recordings.

inputs.py turns arguments into recordings, functions.py calls models/, and results.py defines the
result classes, which render themselves in a notebook. Nothing here prints, and no state is kept
between calls.
"""
