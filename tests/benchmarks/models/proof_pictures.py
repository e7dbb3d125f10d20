"""Pictures of the proof, into a folder."""

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from tests.benchmarks.models.proof_tables import BINS, Row, first, first_right, right_or_tied

STYLE: Any = {
    "font.size": 11, "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True,
    "grid.alpha": 0.3,
}  # fmt: skip
BLUE, GREY, GREEN, RED = "#1f5fbf", "#9a9a9a", "#2e8b57", "#c0392b"


def draw(
    rows: list[Row], closed: list[dict[str, Any]], floor_nm: float, folder: Path
) -> list[Path]:
    """All pictures; the paths written."""
    folder.mkdir(parents=True, exist_ok=True)
    good = [r for r in rows if "failed" not in r]
    out = []
    with plt.rc_context(STYLE):
        single = [r for r in good if r["kind"] in ("single", "own")]
        if single:
            out.append(_detection(single, folder / "detection.png"))
            out.append(_improvement(single, folder / "improvement.png"))
        if good:
            out.append(_confusion(good, folder / "confusion.png"))
        if closed:
            out.append(_loop(closed, floor_nm, folder / "loop-closed.png"))
    return out


def _save(figure: Any, path: Path) -> Path:
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path


def _interval(hits: int, n: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share."""
    z = 1.96
    p, d = hits / n, 1 + z * z / n
    centre = (p + z * z / (2 * n)) / d
    half = z * float(np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))) / d
    return centre - half, centre + half


def _detection(single: list[Row], path: Path) -> Path:
    figure, ax = plt.subplots(figsize=(7.5, 4.5), layout="constrained")
    labels, x = [], 0
    for low, high in BINS:
        group = [r for r in single if low <= r["ratio"] < high]
        if not group:
            continue
        for test, color, shift, label in (
            (first_right, BLUE, -0.18, "named first"),
            (right_or_tied, GREEN, 0.18, "or among the stated near-ties"),
        ):
            hits, n = sum(map(test, group)), len(group)
            a, b = _interval(hits, n)
            p = hits / n
            ax.bar(x + shift, 100 * p, 0.34, color=color, label=label if x == 0 else None)
            ax.errorbar(
                x + shift, 100 * p, [[100 * max(p - a, 0)], [100 * max(b - p, 0)]], color="black",
                lw=1, capsize=3,
            )  # fmt: skip
        span = f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} and more"
        labels.append(f"{span}\n({len(group)} cases)")
        x += 1
    ax.set_xticks(range(x), labels)
    ax.set_ylim(0, 108)
    ax.set_xlabel("what the effect leaves after the best refit of the rich base / noise")
    ax.set_ylabel("cases / %")
    ax.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    return _save(figure, path)


def _confusion(good: list[Row], path: Path) -> Path:
    rows = [r for r in good if r["kind"] != "pair" and (not r["hidden"] or r["ratio"] >= 0.35)]
    hidden = [r["hidden"][0]["name"] if r["hidden"] else "clean" for r in rows]
    said = [first(r) for r in rows]
    names = sorted(set(hidden) | set(said))
    counts = np.zeros((len(names), len(names)))
    for h, s in zip(hidden, said, strict=True):
        counts[names.index(h), names.index(s)] += 1
    keep = counts.sum(axis=1) > 0
    share = counts[keep] / counts[keep].sum(axis=1, keepdims=True)
    figure, ax = plt.subplots(figsize=(9, 0.8 + 0.5 * keep.sum()), layout="constrained")
    ax.grid(False)
    ax.imshow(share, cmap="Blues", vmin=0, vmax=1.2, aspect="auto")
    for i, row in enumerate(counts[keep]):
        for j, count in enumerate(row):
            if count:
                color = "white" if share[i, j] > 0.6 else "black"
                ax.text(j, i, f"{count:.0f}", ha="center", va="center", color=color)
    ax.set_xticks(range(len(names)), names, rotation=40, ha="right")
    kept = [n for n, k in zip(names, keep, strict=True) if k]
    ax.set_yticks(range(len(kept)), kept)
    ax.set_xlabel("named first")
    ax.set_ylabel("hidden")
    return _save(figure, path)


def _improvement(single: list[Row], path: Path) -> Path:
    figure, ax = plt.subplots(figsize=(6.5, 5.5), layout="constrained")
    for right, color, label in ((True, BLUE, "named right"), (False, RED, "not")):
        group = [r for r in single if first_right(r) == right and r["ratio"] >= 0.35]
        ax.loglog(
            [r["base_um"] / r["noise_um"] for r in group],
            [max(r["model_um"] / r["noise_um"], 1e-2) for r in group],
            "o", color=color, ms=5, alpha=0.8, label=label,
        )  # fmt: skip
    ends = np.array(ax.get_xlim())
    ax.plot(ends, ends, color=GREY, label="no better")
    ax.plot(ends, ends * np.sqrt(0.15), "--", color=GREY, label="85 % of the power removed")
    ax.set_xlabel("held-out misfit of the hysteresis model alone / noise")
    ax.set_ylabel("held-out misfit of the augmented model / noise")
    ax.legend(frameon=False)
    return _save(figure, path)


def _loop(closed: list[dict[str, Any]], floor_nm: float, path: Path) -> Path:
    figure, ax = plt.subplots(figsize=(8.5, 4.2), layout="constrained")
    x = np.arange(len(closed))
    for name, color, shift in (("before", GREY, -0.2), ("after", BLUE, 0.2)):
        values = [r[name]["rms_nm"] for r in closed]
        bars = ax.bar(x + shift, values, 0.38, color=color, label=f"{name} the diagnosis")
        ax.bar_label(bars, [f"{v:.0f}" for v in values], fontsize=9)
    ax.axhline(floor_nm, color=GREEN, lw=1.5, label="undisturbed stage, hysteresis model alone")
    ax.set_yscale("log")
    ax.set_xticks(x, [r["effect"].replace(" of the ", "\nof the ") for r in closed])
    ax.set_ylabel("rms tracking error / nm")
    ax.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, fontsize=9)
    return _save(figure, path)
