"""compile all kernels now, so that the next start is quick"""

import argparse
import sys

EPILOG = """\
Kernels are compiled once for each installation and kept on disk. A start without them takes a
minute or two longer; `make` compiles them beforehand. On a terminal the command shows which kernels
it compiles and how long this will take; existing kernels are not compiled again.

example: dehyst warm
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """The command takes no arguments."""
    parser.epilog = EPILOG


def run(args: argparse.Namespace) -> int:
    """Run everything that is compiled, briefly, on the simulated stage."""
    print("dehyst warm: looking for kernels that are not compiled yet", file=sys.stderr, flush=True)
    from dehyst.daemon.bench.simulated import simulated_model
    from dehyst.daemon.terminal.compiling import compiling_shown
    from dehyst.drivers import system
    from dehyst.models.mismatch.monitor import compile_monitor
    from dehyst.models.physics import KINDS

    with compiling_shown("dehyst warm") as compilations:
        for kind in KINDS.values():
            kind.compile()
        simulated_model()
        compile_monitor()
        if system.LINUX:
            _compile_loop()
    if compilations.count:
        done = f"compiled {compilations.count} kernels in {compilations.seconds:.0f} s"
    else:
        done = "all kernels are already compiled"
    print(f"dehyst warm: {done}", file=sys.stderr)
    return 0


def _compile_loop() -> None:
    from dehyst.daemon.latency.latency import Setup, compile_step, measure

    compile_step()
    for engine in ("compiled", "python"):
        measure(Setup(rate_hz=200.0, seconds=0.2, engine=engine))
