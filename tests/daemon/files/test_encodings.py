"""Text in the encoding of a region: recognised by what it looks like as text; where that is not
clear, nothing garbled names a column or a unit."""

from pathlib import Path

import numpy as np
import pytest
from tests.rigs.foreign_files import asked, read

from dehyst.daemon.files.foreign.encoding import LATIN, OTHER_SCRIPTS, UNCLEAR, find_encoding
from dehyst.daemon.files.foreign.units import SPELLED, find_unit_key
from dehyst.models.recording import Recording

N = 300
T = np.round(0.005 * np.arange(N), 3)
U = np.round(50 + 40 * np.sin(2 * np.pi * 1.5 * T), 4)
Y = np.round(3 + 0.06 * U + 0.3 * np.cos(2 * np.pi * 1.5 * T), 5)
RUSSIAN = ("Время (с)", "Напряжение (В)", "Перемещение (мкм)")
JAPANESE = ("時間(s)", "電圧(V)", "変位(μm)")
GREEK = ("Χρόνος (s)", "Τάση (V)", "Μετατόπιση (μm)")
GERMAN = ("Zeit (s)", "Spannung (V)", "Größe (µm)")
IN = {
    "koi8_r": RUSSIAN, "cp1251": RUSSIAN, "cp866": RUSSIAN, "iso8859_5": RUSSIAN,
    "cp1253": ("Χρόνος (s)", "Τάση (V)", "Μετατόπιση (µm)"), "iso8859_7": GREEK,
    "cp950": ("時間 (秒)", "電壓 (伏)", "位移 (微米)"), "euc_jp": JAPANESE, "cp932": JAPANESE,
    "cp949": ("시간 (초)", "전압 (V)", "변위 (㎛)"),
    "gb18030": ("时间(毫秒)", "输出电压(伏)", "位移(微米)"),
    "cp1252": GERMAN, "mac_roman": GERMAN, "cp850": GERMAN,
    "cp1250": ("Čas (s)", "Napětí (V)", "Výchylka (µm)"),
    "cp1254": ("Zaman (s)", "Gerilim (V)", "Yer değiştirme (µm)"),
}  # fmt: skip


def write(path: Path, head: tuple[str, ...], encoding: str, times: np.ndarray = T) -> Path:
    rows = [f"{t:g},{u},{y}" for t, u, y in zip(times, U, Y, strict=True)]
    path.write_bytes("\n".join([",".join(head), *rows, ""]).encode(encoding))
    return path


def is_it(found: Recording) -> None:
    assert found.displacement is not None
    assert (found.drive_unit, found.displacement_unit) == ("v", "um")
    np.testing.assert_allclose(found.t_s, T, atol=1e-12)
    np.testing.assert_array_equal(found.drive, U)
    np.testing.assert_array_equal(found.displacement, Y)


@pytest.mark.parametrize("encoding", IN)
def test_headings_are_read_in_the_encoding_of_their_region(tmp_path: Path, encoding: str) -> None:
    head = IN[encoding]
    found = read(write(tmp_path / "a.csv", head, encoding, 1e3 * T if "毫秒" in head[0] else T))
    is_it(found)
    assert all(f"'{heading}'" in found.read for heading in head)
    assert UNCLEAR not in found.read


@pytest.mark.parametrize("encoding", [name for name in IN if name not in LATIN])
def test_names_without_units_are_recognised_too(tmp_path: Path, encoding: str) -> None:
    names = tuple(heading.partition("(")[0].strip() for heading in IN[encoding])
    assert find_encoding(",".join(names).encode(encoding)) in (encoding, "cp1253")  # Greek
    path = write(tmp_path / "a.csv", names, encoding)
    assert f"the unit of '{names[2]}' is not given" in asked(path, drive_unit="v", columns="u=1")


@pytest.mark.parametrize("word", ["Ход", "Ток", "Сила"])
def test_a_capital_inside_a_word_is_no_text(word: str) -> None:
    raw = f"{word} (um)".encode("koi8_r")
    assert raw.decode(find_encoding(raw)) == f"{word} (um)"


HEBREW = ("זמן (s)", "מתח (V)", "תזוזה (µm)")


@pytest.mark.parametrize(
    ("encoding", "head"),
    [
        ("cp1255", HEBREW),
        ("cp1256", ("الزمن (s)", "الجهد (V)", "الإزاحة (µm)")),
        ("cp874", ("เวลา (s)", "แรงดัน (V)", "ระยะ")),
    ],
)
def test_letters_of_an_encoding_that_is_not_clear_name_nothing(
    tmp_path: Path, encoding: str, head: tuple[str, str, str]
) -> None:
    path = write(tmp_path / "a.csv", head, encoding)
    said = asked(path)
    assert said.isascii() or set(filter(lambda c: not c.isascii(), said)) == {UNCLEAR}
    assert "their encoding is not clear: save the file in UTF-8" in said
    if "add --columns y=2" in said:
        is_it(read(path, "y=2", unit="um"))
    else:
        is_it(read(path, unit="um"))


def test_no_unit_is_another_unit_in_another_encoding() -> None:
    """Whatever the guess, a unit is right or missing."""
    spelled = [name for name in SPELLED if not name.isascii()]
    spelled += [part for head in IN.values() for name in head for part in [name.partition("(")[2]]]
    spelled += ["мс)", "мкс)", "нс)", "мВ)", "кВ)", "мм)", "нм)", "毫秒)", "千伏)", "纳米)", "°C)"]
    for text in spelled:
        for encoding in (*LATIN, *OTHER_SCRIPTS):
            try:
                raw = text.rstrip(")").encode(encoding)
            except UnicodeEncodeError:
                continue
            for other in (*LATIN, *OTHER_SCRIPTS):
                wrong = find_unit_key(raw.decode(other, errors="replace"))
                assert wrong in ("", find_unit_key(text.rstrip(")"))), (text, encoding, other)


@pytest.mark.parametrize("text", ["Temp (°C)", "Weg (µm)", "à 200 Hz, d’écart", "© 2024 µ-Epsilon"])
def test_signs_and_accents_of_western_europe_stay_western(text: str) -> None:
    raw = text.encode("cp1252")
    assert raw.decode(find_encoding(raw)) == text


def test_a_long_text_with_one_such_letter_at_its_end_is_quick(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", ("t_s", "u_v", "y_um"), "utf-8")
    rows = path.read_bytes() + 20_000 * b"# a remark of one line, in ASCII\n"
    path.write_bytes(rows + "# Größe\n".encode("cp1252"))
    assert find_encoding(path.read_bytes()) == "cp1252"
