"""dehyst diagnose on files: what it writes, its exit status, its refusals."""

import base64
import contextlib
import io
import json
import re
from html import escape

import numpy as np
import pytest

from dehyst.daemon.files.models import load_model
from dehyst.daemon.files.recordings import write_recording
from dehyst.daemon.main import main
from dehyst.models.cascade.simulate import simulate

NOISE_UM = 0.02


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Write two short recordings of a rate-independent stage whose reading carries 50 Hz hum
    of the same phase in both, so that the written model contains it."""
    rng = np.random.default_rng(5)
    folder = tmp_path_factory.mktemp("stage")
    t = np.arange(4000) * 1e-3
    for name, tones in (("a.csv", (0.7, 2.3, 6.1)), ("b.csv", (1.1, 3.7, 8.3))):
        u = sum(np.sin(2 * np.pi * (f * t + rng.random())) for f in tones)
        u = (5 + 4.5 * u / np.max(np.abs(u))) * np.minimum(t / 0.3, 1)
        y = np.zeros(t.size)
        for r, w in ((0.0, 0.7), (0.5, 0.15), (1.5, 0.15)):
            p = 0.0
            for i, v in enumerate(u):
                p = max(v - r, min(v + r, p))
                y[i] += w * p
        y += 0.08 * np.sin(2 * np.pi * 50 * t + 0.6) + NOISE_UM * rng.standard_normal(t.size)
        write_recording(folder / name, t, {"u_v": u, "y_um": y})
    return folder


@pytest.fixture(scope="module")
def written(recordings, tmp_path_factory):
    """Diagnose both recordings; return (exit status, folder, stdout), reported as JSON."""
    out, shown = tmp_path_factory.mktemp("out") / "findings", io.StringIO()
    given = [str(recordings / name) for name in ("a.csv", "b.csv")]
    with contextlib.redirect_stdout(shown):
        status = main(["diagnose", *given, "-o", str(out), "--json"])
    return status, out, shown.getvalue()


def test_finding_exits_with_1_and_writes_three_files(written):
    status, out, _ = written
    assert status == 1
    assert sorted(p.name for p in out.iterdir()) == ["diagnosis.json", "model.toml", "report.html"]
    said = json.loads((out / "diagnosis.json").read_text())
    assert said["format"] == 2
    assert said["verdict"] == "explained"
    assert said["data"]["rows"] == 8000
    assert said["effects"][0]["name"] == "hum"
    assert said["noise"]["rms"] == pytest.approx(NOISE_UM, rel=0.15)
    assert all(np.isfinite([p["value"] for e in said["effects"] for p in e["parameters"].values()]))


def test_model_runs_on_new_input_and_names_its_recordings(written):
    _, out, _ = written
    model = load_model(out / "model.toml")
    assert [name for name, _ in model.provenance.recordings] == ["a.csv", "b.csv"]
    assert all(len(digest) == 64 for _, digest in model.provenance.recordings)
    t = np.arange(1000) * 1e-3
    y = simulate(model, t, 4 - 4 * np.cos(2 * np.pi * 2 * t), {})
    assert np.all(np.isfinite(y))
    assert 6.0 < np.ptp(y) < 9.0


def test_report_is_self_contained(written):
    _, out, _ = written
    text = (out / "report.html").read_text()
    pictures = re.findall(r'<img alt="([^"]*)" src="([^"]*)"', text)
    assert len(pictures) == text.count("<img") == 13
    seen = [said for said, _ in pictures]
    for name in ("a.csv", "b.csv"):
        assert any(
            re.fullmatch(rf"Error of {name} over time: .* before, .* after\.", s) for s in seen
        )
        assert any(s.startswith("Measured and both models") and name in s for s in seen)
    assert any("rising and falling, and its centre line" in s for s in seen)
    for place in ("time", "drive, moving up", "drive, moving down", "rate",
                  "since the last reversal", "in a hold"):  # fmt: skip
        assert any(s.startswith("Rms error by") and place in s for s in seen)
    assert any(s.startswith("Spectrum") for s in seen)
    for _, source in pictures:
        head, data = source.split(",", 1)
        assert head == "data:image/png;base64"
        assert base64.b64decode(data).startswith(b"\x89PNG")
    assert "http://" not in text
    assert "https://" not in text
    assert "50" in text
    assert not re.search(r"\bnan\b", text)


def test_report_says_things_in_the_order_in_which_they_are_needed(written):
    """The report follows the reader's needs: the data, the verdict in a sentence with its pair of
    figures, findings with their pictures, excluded effects, what to record next."""
    _, out, _ = written
    text = (out / "report.html").read_text()
    parts = (
        "Recordings: a.csv, b.csv (8000 rows); no reading is missing",
        "where the noise is",
        "error, augmented model",
        "What the model lacks",
        "Before and after",
        "The loop",
        "Excluded effects",
        "Next experiment",
    )
    places = [text.index(part) for part in parts]
    assert places == sorted(places)
    assert "hum explains it, and the augmented model leaves" in text


def test_report_gives_the_figures_of_the_diagnosis(written):
    _, out, _ = written
    said, text = json.loads((out / "diagnosis.json").read_text()), (out / "report.html").read_text()
    # both recordings have equally many samples, so the pair of figures pools them
    pair = [
        np.sqrt(np.mean(np.square(list(said["rms"][k].values())))) for k in ("model", "augmented")
    ]
    for value in (said["noise"]["rms"], *pair):
        assert f"<b>{1e3 * value:.3g} nm</b>" in text
    for effect in said["effects"]:
        assert escape(effect["says"]) in text
        for one in effect["parameters"].values():
            assert f"{one['low']:.4g} to {one['high']:.4g}" in text
    # a recording's row covers the same samples as the cards
    cells = re.findall(r"<tr><td>[ab]\.csv</td><td>(\S+) nm</td><td>(\S+) nm</td>", text)
    assert len(cells) == 2
    both = np.sqrt(np.mean(np.square(np.array(cells, float)), axis=0))
    assert both == pytest.approx(1e3 * np.array(pair), rel=0.02)


def test_console_gives_the_same_pair_of_figures(recordings, tmp_path, capsys):
    main(["diagnose", str(recordings / "a.csv"), "-o", str(tmp_path)])
    shown = capsys.readouterr().out
    rms = json.loads((tmp_path / "diagnosis.json").read_text())["rms"]
    before, after = (1e3 * rms[k]["a.csv"] for k in ("model", "augmented"))
    assert f"leaves {before:.3g} nm rms, the augmented model {after:.3g} " in shown


def test_json_on_stdout_is_the_file(written):
    status, out, shown = written
    assert json.loads(shown) == json.loads((out / "diagnosis.json").read_text())
    assert status == (0 if json.loads(shown)["verdict"] == "clean" else 1)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["missing.csv", "-o", "x"], "missing.csv"),
        (["{a}", "{a}", "-o", "x"], "twice"),
        (["{a}", "-o", "{a}"], "a.csv"),
        (["{a}", "--model", "none.toml", "-o", "x"], "none.toml"),
    ],
)
def test_bad_usage_is_one_line(arguments, words, recordings, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    filled = [a.format(a=recordings / "a.csv") for a in arguments]
    assert main(["diagnose", *filled]) == 2
    shown = capsys.readouterr().err
    assert words in shown
    assert shown.count("\n") == 1
