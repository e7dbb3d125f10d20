"""Run and judge one case; the result is a row of plain data, whatever happens."""

import time
import traceback
from typing import Any

import numpy as np
from tests.benchmarks.models.proof import limits
from tests.benchmarks.models.proof.families import HARDWARE, parse, plan
from tests.benchmarks.models.proof.hardware import judge_hardware
from tests.benchmarks.models.proof.score import figures, score, truth_of
from tests.benchmarks.models.proof.stages import Case, make_case
from tests.rigs.hardware_stages import make_rig
from tests.rigs.plants.effects import Effect

Row = dict[str, Any]


def run_case(seed: int, name: str, checks: int) -> Row:
    """Make, diagnose and judge one case; `checks` of its limits are tested."""
    return run_and_keep(seed, name, checks)[0]


def run_and_keep(seed: int, name: str, checks: int) -> tuple[Row, Case | None, Any]:
    """Return the same, with the case (None for hardware) and its Diagnosis as far as they exist."""
    from dehyst.models.diagnosis import diagnose

    start = time.perf_counter()
    row: Row = {"case": name, "family": parse(name)[0], "seed": seed}
    case = diagnosis = None
    try:
        if row["family"] == HARDWARE:
            rig = make_rig(seed, parse(name)[1])
            begun = time.perf_counter()
            diagnosis = diagnose(rig.given)
            row |= {"seconds": time.perf_counter() - begun} | judge_hardware(rig, diagnosis)
            return row | {"total_s": time.perf_counter() - start}, None, diagnosis
        case = make_case(plan(seed, *parse(name)))
        row |= {
            "hysteresis": case.plan.hysteresis, "fault": case.plan.fault,
            "truth": truth_of(case).to_dict(), "rows": sum(r.size for r in case.given()),
        }  # fmt: skip
        begun = time.perf_counter()
        diagnosis = diagnose(case.given())
        row["seconds"] = time.perf_counter() - begun
        row |= judge(case, diagnosis, checks, np.random.default_rng([seed, case.plan.seed]))
    except Exception:  # a crash must appear in the table, not end the run
        row["failed"] = traceback.format_exc()
    return row | {"total_s": time.perf_counter() - start}, case, diagnosis


def judge(case: Case, diagnosis: Any, checks: int, rng: np.random.Generator) -> Row:
    """Return answer and figures of a case."""
    said = diagnosis.to_dict()
    row = {
        "answer": said,
        "score": score(truth_of(case), said, case.plan.rig),
        "figures": figures(case, diagnosis),
    }
    could = limits.checkable(said.get("would_have_seen") or [])
    picked = rng.permutation(len(could))[:checks]
    row["limits"] = [limits.holds(case, could[k], ask, rng) for k in picked]
    return row


def ask(case: Case, more: tuple[Effect, float]) -> dict[str, Any]:
    """Return diagnosis.json of a case with one more effect in it."""
    from dehyst.models.diagnosis import diagnose

    return diagnose(case.given(more)).to_dict()


def one_line(row: Row) -> str:
    """Format a row as text."""
    if "failed" in row:
        return f"{row['case']:12s} FAILED: {row['failed'].strip().splitlines()[-1]}"
    hidden = ", ".join(
        f"{h['name']} {h['left']:.1f}" + ("" if h["separable"] else " (hidden in the loop)")
        for h in row["truth"]["hidden"]
    )
    said = row["answer"]["effects"]
    named = ", ".join(
        e["name"] + (f" (or {'/'.join(e['ambiguous_with'])})" if e["ambiguous_with"] else "")
        for e in said
    )
    f = row["figures"]
    limits_said = "; ".join(
        f"{one['limit']}: {'true' if one['true'] else 'FALSE'}" for one in row["limits"]
    )
    return (
        f"{row['case']:12s} {row['hysteresis']:12s} {hidden or 'nothing'} | "
        f"{row['answer']['verdict']}: {named or '-'} | leaves {f['model']:.1f}, held out "
        f"{f['held_model']:.1f} -> {f['held_augmented']:.1f} noises | {limits_said or '-'} | "
        f"{row['seconds']:.1f} s"
    )
