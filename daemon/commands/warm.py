"""compile all kernels now, so that the next start is quick"""

import argparse
import sys

from dehyst.daemon.terminal.progress import progress_bar

EPILOG = """\
Kernels are compiled once and kept on disk. A start without them takes a minute longer; the
installation and `make` do it beforehand.

example: dehyst warm
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """The command takes no arguments."""
    parser.epilog = EPILOG


def run(args: argparse.Namespace) -> int:
    """Run everything that is compiled, briefly, on the simulated stage."""
    from dehyst.daemon.tools.bench_config import simulated_model
    from dehyst.daemon.tools.latency import Setup, measure
    from dehyst.models.mismatch.monitor import compile_monitor
    from dehyst.models.physics import KINDS

    if not sys.stderr.isatty():
        print("dehyst warm: compiling kernels, once; about a minute", file=sys.stderr)
    with progress_bar("compiling kernels, once") as progress:
        for kind in KINDS.values():
            kind.compile()
        simulated_model()
        compile_monitor()
        progress(0.3)
        for i, engine in enumerate(("compiled", "python")):
            measure(Setup(rate_hz=200.0, seconds=0.2, engine=engine))
            progress(0.6 + 0.4 * i)
    return 0
