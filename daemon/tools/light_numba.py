"""numba without what no kernel here needs before it is called.

Where its first kernel is called, numba imports scipy.linalg, to be able to say at once that it is
missing: a seventh of the processor time that the core takes to start, and more of the gateway's.
scipy is a dependency; a kernel that multiplies matrices imports what it needs when it runs.
"""


def leave_out_scipy() -> None:
    """From now on numba takes it for granted that scipy.linalg is there. Before the first kernel is
    called; imports numba."""
    from numba.np import linalg

    linalg.ensure_blas = linalg.ensure_lapack = lambda: None
