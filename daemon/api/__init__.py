"""What `import dehyst` offers: the functions behind the command line, on arrays and recordings.

inputs.py makes recordings of what is given, functions.py calls models/, results.py are the answers,
which show themselves in a notebook. Nothing here prints, and nothing is kept between two calls.
"""
