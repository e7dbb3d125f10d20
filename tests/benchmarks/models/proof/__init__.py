"""The proof of the diagnosis, on its own stages in equations other than the library's, by seed.

base.py      what a rich base cannot absorb: whether an effect can be reported at all
stages.py    from a plan to recordings and their truth
families.py  the families of cases
score.py     one answer against one truth
limits.py    tests of exclusion limits, with the effect added
tables.py    the bars of the proof and further tables
pictures.py  a picture of one case
real.py      the real recordings
run.py       one case from plan to row
__main__.py  the command
"""
