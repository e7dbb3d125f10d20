"""Find the encoding of a text that does not state it, by what the text looks like in each."""

import re
from collections.abc import Sequence
from itertools import pairwise

from dehyst.daemon.files.foreign.units import find_unit_key
from dehyst.models.errors import BadRecording

MARKS = ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"))
LATIN = ("cp1252", "cp1250", "cp1254", "mac_roman", "cp850")
"""Encodings of Windows in western and central Europe and in Turkey, of the Macintosh, and of DOS;
the first in doubt."""
OTHER_SCRIPTS = (
    "cp1251", "koi8_r", "cp866", "iso8859_5",  # Cyrillic
    "cp1253", "iso8859_7",  # Greek
    "cp932", "euc_jp",  # Japanese
    "gb18030", "cp950",  # Chinese, simplified and traditional
    "cp949",  # Korean
)  # fmt: skip
UNCLEAR = "\ufffd"
"""Stands for letters in an encoding that is not clear."""
_USUAL = frozenset(
    "äöüßÄÖÜéèêàâçñóíáúåøæÅØýčěšřžůČŠŘŽąćęłńśźżŁőűğışİ"
    "оеаинтсрвлкмуд"
    "αοιετσνηυρςάόίέή"
    "时间電压壓圧电位移置秒毫微纳米伏特变変量測测计計采樣样频率周期通道输輸入出力控制信号號传感器温度数序目标標实實际"
    "値值时時間定記録形変信開始結果ータセンサチャンネル"
    "시간전압변위위치초출력입력측정센서채널온도값신호제어"
)
"""Letters that are common in the headings of a language: for an alphabet, those that make up more
than half of any text; for Chinese, Japanese and Korean, those of the words for what is measured."""
_SIGNS = frozenset("°²³·±×µμΩ℃§©®™€£")
"""What may be in a heading in any language, but not between two letters of a word."""
_SCRIPTS = (("\u0370", "\u03ff"), ("\u0400", "\u04ff"), ("\u1100", "\uffef"))
"""Greek, Cyrillic, and those of East Asia; all others count as Latin."""
_APART = re.compile(r"[\s,;|/()\[\]{}<>\"'=:.\d_+*#%&\u2009\u3000–—‘’“”„…（）［］，：｜、。-]+")
A_UNIT = 3
"""Number of letters that a unit counts as: other letters form one by chance even less often."""
MARGIN = 2
"""Lead, in usual letters, by which an encoding is clear: with less, one letter could decide."""
LOOKED_AT, LONGEST = 200, 4096
"""Lines with letters beyond ASCII by which the encoding is judged, and the most bytes of one before
and after the first of these."""
_BEYOND_ASCII = re.compile(rb"[\x80-\xff]")
_LETTERS = re.compile(rb"[\x80-\xff](?:[\x80-\xff]|[A-Za-z](?=[\x80-\xff]))*[A-Za-z]?")
"""Letters beyond ASCII, with the ASCII letters that may be the second bytes of some."""


def decode_text(name: str, data: bytes) -> tuple[str, str]:
    """Return (text, a remark or "") of text in the usual encodings. Letters in one that is not
    clear become UNCLEAR, so that none of them names a column or a unit. Raises BadRecording if it
    is not text."""
    for mark, encoding in MARKS:
        if data.startswith(mark):
            try:
                return data.decode(encoding), ""
            except UnicodeDecodeError:
                raise BadRecording(f"{name}: is not whole {encoding} text") from None
    head = data[:4096]
    if b"\0" in head:
        for encoding, zeros in (("utf-16-le", head[1::2]), ("utf-16-be", head[::2])):
            if len(zeros) > 8 and zeros.count(0) > 0.9 * len(zeros):
                return data.decode(encoding, errors="replace"), ""
    if b"\0" in data:
        line = data[: data.index(b"\0")].count(b"\n") + 1
        raise BadRecording(
            f"{name}: line {line} holds a zero byte: not a text file, or one whose writer was "
            "stopped: delete that line and what follows (of a recording of dehyst's own, convert "
            "--unfinished keeps what is before)"
        )
    try:
        return data.decode("utf-8"), ""
    except UnicodeDecodeError:
        pass
    if encoding := find_encoding(data):
        return data.decode(encoding, errors="replace"), ""
    text = _LETTERS.sub(b"\x80", data).decode("ascii", errors="replace")
    return text, (
        f"letters beyond ASCII left out (shown as {UNCLEAR}), because their encoding is not clear: "
        "save the file in UTF-8 to keep them"
    )


def find_encoding(data: bytes) -> str:
    """Return the encoding in which text that is not UTF-8 looks like text, "" if none does, or if
    two that read different letters do equally well."""
    lines = _lines_beyond_ascii(data)
    looks: list[tuple[int, int, str, str]] = []
    for encoding in (*LATIN, *OTHER_SCRIPTS):
        try:
            text = lines.decode(encoding)
        except UnicodeDecodeError:
            continue
        words = {word for word in _APART.split(text) if not word.isascii()}
        likeness = [_likeness_of(word) for word in words]
        looks.append((sum(a + b for a, b in likeness), sum(a for a, _ in likeness), encoding, text))
    most, letters, best, text = max(looks, key=lambda look: look[0], default=(0, -1, "", ""))
    rivals = [one for also, _, one, other in looks if other != text and also > most - MARGIN]
    sure = all(one in LATIN for one in (best, *rivals))  # they differ by a letter
    return best if letters >= 0 and (sure or not rivals) else ""


def _lines_beyond_ascii(data: bytes) -> bytes:
    """Return the first lines that hold bytes beyond ASCII."""
    lines: list[bytes] = []
    at = 0
    while len(lines) < LOOKED_AT and (found := _BEYOND_ASCII.search(data, at)):
        begin = max(data.rfind(b"\n", 0, found.start()) + 1, found.start() - LONGEST)
        end = data.find(b"\n", found.start(), found.start() + LONGEST)
        at = end if end > 0 else found.start() + LONGEST
        lines.append(data[begin:at])
    return b"\n".join(lines)


def _likeness_of(word: str) -> tuple[int, int]:
    """Return by how many the usual letters of a word exceed the others; and what its units and
    signs count for, which many encodings have in common."""
    if find_unit_key(word):
        return 0, A_UNIT
    inside = [a.isalpha() and b.isalpha() for a, b in zip(word, word[2:], strict=False)]
    apart = [True, *(not between for between in inside), True]
    signs = sum(sign in _SIGNS and alone for sign, alone in zip(word, apart, strict=False))
    letters = [letter for letter in word if letter.isalpha() and letter not in _SIGNS]
    beyond = [letter for letter in letters if not letter.isascii()]
    scripts = {_script_of(letter) for letter in letters}
    odd = len(scripts) > 1 or (scripts == {0} and len(beyond) > max(1, len(letters) // 2))
    usual = sum(letter in _USUAL or letter.lower() in _USUAL for letter in beyond if not odd)
    others = sum(not letter.isascii() for letter in word) - signs - len(beyond)
    return 2 * usual - len(beyond) - 2 * others - 2 * _changes_case(letters), signs


def _script_of(letter: str) -> int:
    return next((i for i, (low, high) in enumerate(_SCRIPTS, 1) if low <= letter <= high), 0)


def _changes_case(letters: Sequence[str]) -> int:
    """Return how often a capital letter follows a small one, of those beyond ASCII."""
    return sum(a.islower() and b.isupper() and not b.isascii() for a, b in pairwise(letters))
