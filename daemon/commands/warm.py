"""Compile all kernels now, so that the next start is quick."""

import argparse
import sys

EPILOG = """\
Kernels are compiled once for each installation and kept on disk. A start without them takes a
minute or two longer; `make` compiles them beforehand. On a terminal the command shows which kernels
it compiles and how long this will take; existing kernels are not compiled again.

example: dehyst warm
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Configure `dehyst warm`, which takes no arguments."""
    parser.epilog = EPILOG


def run(args: argparse.Namespace) -> int:
    """Briefly run everything that needs compiling on the simulated stage, in two processes."""
    print("dehyst warm: looking for kernels that are not compiled yet", file=sys.stderr, flush=True)
    from dehyst.daemon import clock
    from dehyst.daemon.terminal.compiling import compiling_shown
    from dehyst.drivers import system

    begun_ns = clock.monotonic_ns()

    with compiling_shown("dehyst warm") as compilations:
        if system.LINUX:
            from dehyst.daemon.loop.compiled_apart import compile_in_two, compiling_beside

            compile_in_two()
            with compiling_beside(__name__):
                _compile_loop()
        _compile_offline()  # the other process' kernels are on disk by now
    if compilations.count:
        seconds = (clock.monotonic_ns() - begun_ns) / clock.NS
        done = f"compiled the kernels in {seconds:.0f} s"
    else:
        done = "all kernels are already compiled"
    print(f"dehyst warm: {done}", file=sys.stderr)
    return 0


def _compile_offline() -> None:
    from dehyst.daemon.bench.simulated import simulated_model
    from dehyst.models.mismatch.monitor import compile_monitor
    from dehyst.models.physics import KINDS

    for kind in KINDS.values():
        kind.compile()
    simulated_model()
    compile_monitor()


def _compile_loop() -> None:
    from dehyst.daemon.latency.latency import Setup, compile_step, measure

    compile_step()
    for engine in ("compiled", "python"):
        measure(Setup(rate_hz=200.0, seconds=0.2, engine=engine))


if __name__ == "__main__":
    _compile_offline()
