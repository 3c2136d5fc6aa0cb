"""Nicknames: sanitising of requested names, and detection of look-alikes, so that nobody poses as another visitor."""

# ruff: noqa: RUF001

from __future__ import annotations

import unicodedata
from bisect import bisect_right

NICKNAME_CHARACTERS = 32
MARKS_IN_A_ROW = 3  # more combining marks would cover the lines above and below
RESERVED = ("operator", "gateway", "everybody")

# Letters of scripts in daily use; others have look-alikes that are not in the table below.
_LETTERS = (
    *((0x41, 0x5A), (0x61, 0x7A), (0xC0, 0x24F), (0x300, 0x36F), (0x370, 0x3FF), (0x400, 0x4FF), (0x531, 0x587)),
    *((0x591, 0x5EA), (0x620, 0x6FF), (0x780, 0x7B1), (0x900, 0xEFF), (0xF40, 0xFBC), (0x1000, 0x109F)),
    *((0x10D0, 0x10FF), (0x1200, 0x137F), (0x1780, 0x17D3), (0x1E00, 0x1EFF), (0x3041, 0x30FF), (0x3105, 0x312F)),
    *((0x3400, 0x9FFF), (0xAC00, 0xD7A3), (0x20000, 0x323AF)),
)
_BEGINS = [begin for begin, _ in _LETTERS]
_DRAWN = ((0x2600, 0x27BF), (0x1F300, 0x1FAFF))  # pictographs
_IGNORED = "\u034f\u0640\u17b4\u17b5"  # in those ranges, but invisible or shown as a longer line
_AS_TYPED = str.maketrans("‘’ʼ“”–—", "'''\"\"--")  # phones replace typed quotes and dashes

# Letters that look the same, of the scripts above and without their marks: Unicode's confusables.txt (UTS #39).
_GROUPS = """
    O0ΟОՕଠዐ 2ƧϨ 3ƷȜЗӠ 5Ƽ 6б 8Ȣȣ AΑА BΒВ CС EΕЕ FϜ HΗН JͿЈ KΚК MΜϺМ NΝ PΡР RƦ SЅՏ TΤТ UՍሀ VѴ XΧХ YΥУҮ ZΖ
    aαа bƄЬƅь cсϲ eеҽ fքẝ gƍց hһհ lιıіӏ1|ƖǀΙІӀi jϳјȷյ nոռ oοσоօഠဝჿ pρр qգզ rг sƽѕ uυս vνѵ xх yγуүყỿ
    يیى كک هہە ßβ ĸκк ƆϽ ƨϩ ƩΣ þƿϸ ǝә ȝӡჳ ɅΛЛ ΓГ ΠП ΦФՓቀ ΨѰ πп ψѱ ςϛ ÞϷ ͶИ ҶӋ ҷӌ ƏӘ Իኮ Մሆ Ոበ Պጣ Ռቡ δծẟ ձኔ
    ॱൎ ऽઽ உഉ ஐஜജ ஈర అಅ ఆಆ ఇಇ ఒಒ జಜ ఞಞ ణಣ యಯ ఱಱ లಲ ணണ രറ ழഴ ஶശ ഞൡ རཪ អឣ
    ขฃ ชซ ฎฏ คดต ฑท ฆม ภฦ าๅ จຈ ยຍ บບ ปປ ฝຝ พພ ฟຟ イ亻 エ工 カ力 タ夕 ト卜 ニ二 ハ八 へヘ ロ口囗 ー一
"""
_LOOKS = {ord(each): group[0] for group in _GROUPS.split() for each in group}
_LOOKS |= str.maketrans({"m": "rn", "w": "vv", "ѡ": "vv", "ա": "vv"})


def clean_nickname(wish: str) -> str:
    """Reduce a requested nickname to letters, digits, ASCII signs and pictographs; empty if nothing visible is left."""
    kept, marks = "", 0
    for each in unicodedata.normalize("NFKC", wish).translate(_AS_TYPED):
        kind = unicodedata.category(each)
        marks = marks + 1 if kind[0] == "M" else 0
        if kind == "Nd":
            kept += str(unicodedata.decimal(each))
        elif kind == "Zs":
            kept += " "
        elif (marks <= MARKS_IN_A_ROW and (kept.strip() or not marks) and _is_letter(each, kind)) or _is_sign(each):
            kept += each
    kept = " ".join(kept.split())[:NICKNAME_CHARACTERS].strip()
    return kept if any(name_skeletons(kept)) else ""


def name_skeletons(name: str) -> set[str]:
    """Return the skeletons of a name, as written and in lower case; names that look alike have a skeleton in common.

    Marks, spaces and signs are left out. The skeleton of a concatenation is the concatenation of the skeletons.
    """
    plain = [each for each in unicodedata.normalize("NFKD", name) if not unicodedata.combining(each)]
    seen = "".join(
        each for each in plain if each == "|" or unicodedata.category(each)[0] in "LMN" or each >= "\U0001f300"
    )
    return {_one_for_all(seen), _one_for_all(seen.casefold())}


def is_reserved(name: str) -> bool:
    """Return whether a name looks like a reserved one, such as the operator's."""
    return any(_one_for_all(each) in seen for each in RESERVED for seen in name_skeletons(name))


def _one_for_all(seen: str) -> str:
    return seen.translate(_LOOKS).casefold().translate(_LOOKS)


def _is_letter(each: str, kind: str) -> bool:
    at = bisect_right(_BEGINS, ord(each)) - 1
    return kind[0] in "LM" and kind != "Me" and at >= 0 and ord(each) <= _LETTERS[at][1] and each not in _IGNORED


def _is_sign(each: str) -> bool:
    if each.isascii():
        return each.isprintable()
    return unicodedata.category(each)[0] == "S" and any(begin <= ord(each) <= end for begin, end in _DRAWN)
