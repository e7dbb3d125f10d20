"""`import dehyst` as in a notebook: arrays, columns, files and recordings give the same result."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dehyst
from dehyst.daemon.api.results import Diagnosed
from dehyst.daemon.files.recordings import write_recording
from dehyst.models.diagnosis import diagnose
from dehyst.models.hysteresis import forward
from dehyst.models.modelfile import shipped

T, NOISE = 1e-3, 0.045


@pytest.fixture(scope="module")
def run() -> dict[str, np.ndarray]:
    """Return a run of two sines on the paper's stage, with 45 nm of noise."""
    t = np.arange(4000) * T
    u = 4.5 - 3.0 * np.cos(2 * np.pi * 1 * t) - 1.5 * np.cos(2 * np.pi * 5 * t)
    y = forward.simulate_hysteresis(shipped("paper-eq12").hysteresis, u, T)
    return {"t_s": t, "u_v": u, "y_um": y + NOISE * np.random.default_rng(1).normal(size=t.size)}


@pytest.fixture(scope="module")
def found(run: dict[str, np.ndarray]) -> Any:
    return dehyst.identify(run, saturation=3)


def test_arrays_columns_files_and_recordings_give_the_same(
    run: dict[str, np.ndarray], tmp_path: Path
) -> None:
    path = tmp_path / "run.csv"
    write_recording(path, run["t_s"], {k: v for k, v in run.items() if k != "t_s"})
    recording = dehyst.load_recording(path)
    options: dict[str, Any] = {"rate": False, "order": 6, "saturation": 1}
    ways: list[tuple[Any, ...]] = [
        (run["t_s"], run["u_v"], run["y_um"]),
        tuple(list(run[key]) for key in ("t_s", "u_v", "y_um")),
        (run,),
        (str(path),),
        (path,),
        (recording,),
        ([recording],),
    ]
    slopes = [dehyst.identify(*way, **options).model.hysteresis.b for way in ways]
    for other in slopes[1:]:
        assert np.array_equal(other, slopes[0])


def test_what_is_identified_predicts_and_inverts(found: Any, tmp_path: Path) -> None:
    assert found.rms == pytest.approx(NOISE, rel=0.15)
    up = np.linspace(0.0, 9.0, 900)
    slowly = forward.simulate_hysteresis(
        shipped("paper-eq12").hysteresis, np.concatenate([up, up[::-1], up]), 1e3
    )
    stroke = np.ptp(slowly[1800:])  # after an exercise cycle
    assert found.figures.stroke == pytest.approx(stroke, rel=0.03)
    t = np.arange(1500) * T
    u = 4.0 - 3.0 * np.cos(2 * np.pi * 2 * t)
    truth = forward.simulate_hysteresis(shipped("paper-eq12").hysteresis, u, T)
    simulated = dehyst.simulate(found, t, u)
    assert np.std(np.asarray(simulated) - truth) < NOISE
    path = found.save(tmp_path / "stage.toml")
    again = dehyst.simulate(path, {"t_s": t, "u_v": u, "y_um": truth})
    assert np.array_equal(again, simulated)
    assert again.rms == pytest.approx(np.sqrt(np.mean((np.asarray(simulated) - truth) ** 2)))
    from scipy.interpolate import CubicSpline  # at the top, every worker would wait for it

    target = CubicSpline([0.0, 0.5, 1.5], [1.0, 7.0, 4.0])(t)
    drive = dehyst.invert(path, t, target)
    reached = forward.simulate_hysteresis(
        found.model.hysteresis, np.concatenate([[0.0], drive]), T
    )[1:]
    assert np.sqrt(np.mean((reached - target)[200:] ** 2)) < 0.002
    streamed = dehyst.invert(found, t, target, preview=0.05, slew=200.0)
    assert streamed.mode == "preview"
    assert np.max(np.abs(np.diff(streamed.drive))) <= 200.0 * T * (1 + 1e-9)
    known = dehyst.validate([found, path], {"t_s": t, "u_v": u, "y_um": truth})
    assert len(known) == 2
    assert known[0].rms == known[1].rms < NOISE
    assert not known.worse


def test_a_diagnosis_from_arrays(run: dict[str, np.ndarray], found: Any, tmp_path: Path) -> None:
    heard: list[float] = []
    out = dehyst.diagnose(run, model=found, progress=lambda _text, share: heard.append(share))
    recording = dehyst.Recording(run["t_s"], run["u_v"], run["y_um"], name="recording 1")
    assert out.to_dict() == diagnose([recording], found.model).to_dict()
    assert heard
    assert min(heard) >= 0.0
    assert max(heard) <= 1.0
    report = out.save(tmp_path / "findings")
    assert report.read_text("utf-8").startswith("<!DOCTYPE html>")
    assert (tmp_path / "findings" / "diagnosis.json").exists()
    written = dehyst.load_model(tmp_path / "findings" / "model.toml")
    assert written.hysteresis.n > 0
    # nothing predicts better: the model in use stays, with the recordings that it was identified of
    assert out.details.model == out.details.base_model
    assert written.provenance == found.model.provenance
    assert out.verdict in str(out)
    assert out._repr_html_().startswith('<div class="dehyst">')


def test_a_model_in_another_length_takes_the_recording(
    run: dict[str, np.ndarray], found: Any
) -> None:
    small = {"t_s": run["t_s"], "u_v": run["u_v"], "y_nm": 1e3 * run["y_um"]}
    done = [dehyst.diagnose(one, model=found) for one in (run, small)]
    assert done[1].verdict == done[0].verdict
    assert done[1].details.unit == "um"
    (rms, same), (other, key) = [next(iter(one.details.rms["model"].items())) for one in done]
    assert (other, key) == (rms, pytest.approx(same, rel=1e-6))


def test_results_show_themselves(run: dict[str, np.ndarray], found: Any) -> None:
    t, u = run["t_s"], run["u_v"]
    shown = {
        "um/V": found,
        "rms over all": dehyst.simulate(found, run),
        "predicted error": dehyst.invert(found, t[:500], np.full(500, 4.0)),
        "of the span": dehyst.validate(found, run),
    }
    for words, result in shown.items():
        html = result._repr_html_()
        assert words in html
        assert 'src="data:image/png;base64,' in html
        assert "<html" not in html  # a part of the notebook's page
        assert html.count("<div") == html.count("</div>")
    alone = dehyst.simulate(found, t, u)
    assert alone.error is None
    assert alone.rms is None
    assert "<img" in alone._repr_html_()


def test_nothing_is_printed_and_what_is_given_stays_as_it_is(
    run: dict[str, np.ndarray], capsys: pytest.CaptureFixture[str]
) -> None:
    before = {name: values.copy() for name, values in run.items()}
    said: list[str] = []
    dehyst.identify(run, order=4, rate=False, saturation=1, progress=said.append)
    assert said
    assert capsys.readouterr() == ("", "")
    for name, values in run.items():
        assert np.array_equal(values, before[name])
        assert values.flags.writeable


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: dehyst.identify(), "no recording was given"),
        (lambda: dehyst.identify(5), "int is not a recording"),
        (lambda: dehyst.identify([1.0, 2.0]), "t_s, drive, displacement"),
        (lambda: dehyst.identify({"t_s": [0, 1], "u_v": [0, 1]}), "no displacement column"),
        (lambda: dehyst.identify({"u_v": [0, 1], "y_um": [0, 1]}), "no column of times"),
        (lambda: dehyst.simulate("paper-eq12", {"t_s": [0, 1], "u_nm": [0, 1]}), "drive is in nm"),
        (lambda: dehyst.simulate("paper-eq12", [0, 1], [0, 1, 2]), "unequal length"),
        (lambda: dehyst.simulate("paper-eq12", [0, 0], [0, 1]), "the time is 0 in every row"),
        (lambda: dehyst.simulate(3, [0, 1], [0, 1]), "int is not a model"),
        (lambda: dehyst.simulate("nowhere.toml", [0, 1], [0, 1]), "nowhere.toml: cannot be read"),
        (lambda: dehyst.invert("paper-eq12", [0, 1]), "one trajectory"),
        (lambda: dehyst.invert("paper-eq12", [0, 1e-3], [1, np.nan]), "target_um is missing"),
        (lambda: dehyst.invert("paper-eq12", [0, 1, 3], [1, 2, 2]), "period"),
        (lambda: dehyst.invert("paper-eq12", [0, 1], [1, 2], mode="causal"), "preview"),
        (lambda: dehyst.invert("paper-eq12", [0, 1], [1, 2], start=np.nan), "start=nan"),
        (lambda: dehyst.invert("paper-eq12", [0, 1], [1, 2], start=np.inf), "start=inf: not a fin"),
        (lambda: dehyst.invert("paper-eq12", [0, 1], [1, 2], low=-np.inf), "low=-inf: not a fin"),
        (lambda: dehyst.invert("paper-eq12", [0, 1], [1, 2], slew=0.0), "slew=0: must be greater"),
        (lambda: dehyst.invert("paper-eq12", [0, 1, 3], [1, 2, 2]), "give period to resample"),
        (lambda: dehyst.identify([0, 1], [0, 1], [0, 1], order=1.5), "order=1.5: must be a whole"),
        (lambda: dehyst.identify([0, 1], [0, 1j], [0, 1]), "t_s, drive, displacement"),
        (lambda: dehyst.validate([], [0, 1], [0, 1], [0, 1]), "no model was given"),
        (
            lambda: dehyst.simulate("paper-eq12", {"t_s": [0, 1]}, {"t_s": [0, 1]}),
            "no drive column",
        ),
    ],
)
def test_what_cannot_be_taken_is_refused_in_one_line(call: Any, says: str) -> None:
    with pytest.raises(dehyst.DehystError) as error:
        call()
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_a_result_replaces_no_recording(
    run: dict[str, np.ndarray], found: Any, tmp_path: Path
) -> None:
    """As at the command line: only another result is replaced, unless the caller asks."""
    mine = tmp_path / "mine.csv"
    write_recording(mine, run["t_s"], {k: v for k, v in run.items() if k != "t_s"})
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "model.toml").write_text("mine = true")
    diagnosed = Diagnosed(diagnose([dehyst.load_recording(mine)]), ())
    before = mine.read_bytes()
    for save in (
        lambda: found.save(mine),
        lambda: found.report(mine),
        lambda: dehyst.validate(found, run).report(mine),
        lambda: diagnosed.save(folder),
        lambda: dehyst.simulate(found, run).save(mine),
    ):
        with pytest.raises(dehyst.DehystError, match="exists already"):
            save()
    assert mine.read_bytes() == before
    assert [path.name for path in folder.iterdir()] == ["model.toml"]
    assert found.save(found.save(tmp_path / "stage.toml")).is_file()  # a model is written again
    assert dehyst.invert(found.save(mine, force=True), [0, 1e-3], [1, 1]).drive.size == 2


def test_the_import_is_light_and_every_public_name_is_there() -> None:
    program = (
        "import sys, dehyst\n"
        "heavy = {'numpy', 'scipy', 'numba', 'matplotlib', 'zenoh'} & sys.modules.keys()\n"
        "assert not heavy, heavy\n"
        "assert set(dehyst.__all__) <= set(dir(dehyst))\n"
        "for name in dehyst.__all__: assert getattr(dehyst, name) is not None\n"
        "try: dehyst.nothing\n"
        "except AttributeError as error: assert 'nothing' in str(error)\n"
        "else: raise SystemExit('no error')\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)
