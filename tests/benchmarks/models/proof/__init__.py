"""The diagnosis judged: own stages in other equations than the library's, by seed.

base.py      what a rich base cannot absorb: whether an effect can be reported at all
stages.py    from a plan to recordings and their truth
families.py  the families of cases
score.py     one answer against one truth
limits.py    exclusion limits asked again, with the effect put in
tables.py    the bars of the proof and tables beside them
pictures.py  one case for the eye
real.py      the real recordings
run.py       one case from plan to row
__main__.py  the command
"""
