"""Fuzz the decoders of all external input with damaged data, and count findings.

Each decoder runs in its own process, so that crashes, hangs and excessive memory are detected from
outside. With atheris installed (pip install atheris), coverage guides the inputs; without it, they
are mutations of valid ones. A finding is anything but the documented refusal: another error, more
than 5 s of processor time, more than 1 GB, or an accepted input that should have been refused. Its
input is kept, and `--again FILE` runs it once more.

example: python -m tests.fuzz --for 600               (all targets, equal shares)
         python -m tests.fuzz --only csv model --for 60
         python -m tests.fuzz --only csv --again out/fuzz/csv-1a2b3c4d
"""

import argparse
import hashlib
import json
import os
import resource
import signal
import subprocess
import sys
import time
import traceback
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
LONGEST_S = 5
MOST_BYTES = 1 << 30
PATIENCE_S = 600.0
"""Extra time for a target's start: it compiles kernels and reads the valid inputs, some in a
separate process, which takes minutes if other work uses the processors."""


class TooLong(BaseException):
    """An input took longer than LONGEST_S of processor time."""


class Case:
    """One target in this process: runs inputs, keeps findings, reports progress."""

    def __init__(self, name: str, kept: Path) -> None:
        from tests.fuzz.files import refusal
        from tests.fuzz.targets import targets

        self.refusal = refusal
        self.name, self.kept, self.target = name, kept, targets()[name]
        self.inputs = self.accepted = 0
        self.findings: dict[str, str] = {}
        self.slowest_s = 0.0
        self.reported_s = 0.0
        signal.signal(signal.SIGPROF, self._alarm)

    def _alarm(self, *_: Any) -> None:
        raise TooLong(f"more than {LONGEST_S} s")

    def once(self, data: bytes) -> str:
        """Run one input and return its outcome."""
        self.inputs += 1
        begun = time.process_time()
        signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
        outcome = "accepted"
        try:
            self.refusal.clear()
            if self.target.run(data):
                self.accepted += 1
            else:
                outcome = "".join(["refused", *self.refusal])
        except (Exception, TooLong) as error:
            outcome = self._found(data, error)
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
        self.slowest_s = max(self.slowest_s, time.process_time() - begun)
        return outcome

    def _found(self, data: bytes, error: BaseException) -> str:
        place = [
            f for f in traceback.extract_tb(error.__traceback__) if "python3" not in f.filename
        ]
        where = f"{Path(place[-1].filename).name}:{place[-1].lineno}"
        what = f"{type(error).__name__} in {where}"
        if what not in self.findings:
            self.kept.mkdir(parents=True, exist_ok=True)
            path = self.kept / f"{self.name}-{hashlib.sha256(data).hexdigest()[:8]}"
            path.write_bytes(data)
            self.findings[what] = f"{str(error)[:160]!r}, input kept as {path}"
        return what

    def tell_now_and_then(self, path: Path) -> None:
        """Write the counts for the parent, once a second."""
        if time.monotonic() >= self.reported_s + 1.0:
            self.reported_s = time.monotonic()
            self.tell(path)

    def tell(self, path: Path) -> None:
        """Write the counts for the parent."""
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        reported = {
            "inputs": self.inputs, "accepted": self.accepted, "findings": self.findings,
            "slowest_s": self.slowest_s, "peak_mb": peak, "engine": self.engine,
        }  # fmt: skip
        part = path.with_suffix(".part")
        part.write_text(json.dumps(reported))
        os.replace(part, path)

    engine = "mutations"


def child(name: str, seconds: float, seed: int, reported: Path, kept: Path, plain: bool) -> None:
    """Run a target: the entry point of its process."""
    from tests.fuzz import targets

    case = Case(name, kept)
    for data in case.target.seeds:  # untimed: kernels may have to be compiled
        case.target.run(data)
    size = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGESIZE")
    resource.setrlimit(resource.RLIMIT_AS, (size + MOST_BYTES, resource.RLIM_INFINITY))
    end = time.monotonic() + seconds
    try:
        import atheris
    except ImportError:
        plain = True
    if plain:
        from tests.fuzz.mutate import Mutator

        mutator = Mutator(case.target, seed)
        while time.monotonic() < end:
            data = mutator.next()
            mutator.saw(data, case.once(data))
            case.tell_now_and_then(reported)
        case.tell(reported)
    else:
        case.engine = "atheris"
        atheris_run(atheris, case, seconds, seed, reported)
    targets.clean_up()


def atheris_run(atheris: Any, case: Case, seconds: float, seed: int, reported: Path) -> None:
    """Run the target guided by coverage; this ends the process."""
    import gc

    count = 0
    for function in [f for f in gc.get_objects() if type(f).__name__ == "function"]:
        module = getattr(function, "__module__", "") or ""
        if module.startswith("dehyst.") or module in ("tomllib._parser", "msgpack"):
            function.__code__ = atheris.instrument_func(function).__code__
            count += 1
    corpus = reported.parent / f"corpus-{case.name}"
    corpus.mkdir(exist_ok=True)
    for i, data in enumerate(case.target.seeds):
        (corpus / f"seed{i}").write_bytes(data)
    words = reported.parent / f"{case.name}.words"
    lines = ["".join(f"\\x{b:02x}" for b in w) for w in case.target.words if len(w) < 60]
    words.write_text("".join(f'"{line}"\n' for line in lines))

    def one(data: bytes) -> None:
        case.once(data)
        case.tell_now_and_then(reported)  # the library ends the process without notice

    options = [
        f"-max_total_time={round(seconds)}",
        f"-seed={seed}",
        "-max_len=16384",
    ]
    options += [f"-dict={words}"] if lines else []
    options += ["-rss_limit_mb=0", "-timeout=0", "-print_final_stats=0", "-verbosity=0"]
    atheris.Setup([sys.argv[0], *options, str(corpus)], one)
    atheris.Fuzz()


def one_target(name: str, seconds: float, o: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Run a target's process and return its report. A crash of the process is a finding too."""
    reported = folder / f"{name}.json"
    command = [sys.executable, "-m", "tests.fuzz", "--child", name, "--for", str(seconds)]
    command += ["--seed", str(o.seed), "--reported", str(reported), "--kept", str(o.kept)]
    command += ["--plain"] if o.plain else []
    process = subprocess.Popen(
        command, cwd=ROOT, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        _, said = process.communicate(timeout=seconds + PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        _, said = process.communicate()
        said += "\nhangs"
    result: dict[str, Any] = (
        json.loads(reported.read_text()) if reported.exists() else {"findings": {}}
    )
    if process.returncode != 0:
        result["findings"][f"process ended with {process.returncode}"] = said[-500:]
    elif not result.get("inputs"):
        result["findings"]["nothing was tried"] = said[-500:]
    return result


def main() -> int:
    """Print a row for each target; return 1 if something was found."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.fuzz", description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--for", dest="seconds", type=float, default=60.0, help="for all targets")
    parser.add_argument("--only", nargs="+", metavar="TARGET")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--plain", action="store_true", help="mutations although atheris is there")
    parser.add_argument("--kept", type=Path, default=ROOT / "out" / "fuzz")
    parser.add_argument("--again", type=Path, help="run this input alone")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    parser.add_argument("--reported", type=Path, help=argparse.SUPPRESS)
    o = parser.parse_args()
    if o.child:
        child(o.child, o.seconds, o.seed, o.reported, o.kept, o.plain)
        return 0
    from tests.fuzz.targets import clean_up, targets

    names = o.only or list(targets())
    if o.again:
        print(targets()[names[0]].run(o.again.read_bytes()))
        clean_up()
        return 0
    import tempfile

    clean_up()
    found = total = 0
    print("decoder        inputs  accepted  slowest ms  peak MB  engine     findings", flush=True)
    with tempfile.TemporaryDirectory(prefix="dehyst-fuzz-") as folder:
        for name in names:
            r = one_target(name, o.seconds / len(names), o, Path(folder))
            found += len(r["findings"])
            total += r.get("inputs", 0)
            print(
                f"{name:10s} {r.get('inputs', 0):10d} {r.get('accepted', 0):9d} "
                f"{1e3 * r.get('slowest_s', 0):11.1f} {r.get('peak_mb', 0):8d}  "
                f"{r.get('engine', '-'):9s}  {len(r['findings'])}",
                flush=True,
            )
            for what, words in r["findings"].items():
                print(f"    {what}: {words}", flush=True)
    print(f"{total} inputs, {found} findings")
    return int(found > 0)


if __name__ == "__main__":
    sys.exit(main())
