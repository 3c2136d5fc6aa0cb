"""Nicknames: what is kept of a wish, and that no two visitors seem one."""

# ruff: noqa: RUF001

from __future__ import annotations

import unicodedata

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from phalanx.link.session import Role
from phalanx.link.session.events import Admitted
from phalanx.link.session.nickname import MARKS_IN_A_ROW, clean_nickname, is_reserved, name_skeletons
from phalanx.link.session.visitors import FEW
from session_world import World


def named(*wishes: str) -> list[str]:
    world = World()
    return [world.join(name=wish).last(Admitted).name for wish in wishes]


@pytest.mark.parametrize(
    ("wish", "kept"),
    [
        ("  Ada \u202e Love\nlace\t\x00 ", "Ada Lovelace"),
        ("Zoë 🤖", "Zoë 🤖"),
        ("🚀", "🚀"),
        ("x" * 99, "x" * 32),
        ("Ada\u00a0\u3000\u2003Lovelace", "Ada Lovelace"),
        ("A\u200bd\u2060a\ufe0f\U000e0061", "Ada"),
        ("Ａｄａ", "Ada"),
        ("O’Brien – née “X”", 'O\'Brien - née "X"'),
        ("Ада", "Ада"),
        ("राम कृष्ण", "राम कृष्ण"),
        ("สมหญิง", "สมหญิง"),
        ("山田 太郎", "山田 太郎"),
        ("محمد ٣", "محمد 3"),
        ("\u0301Ada", "Ada"),
        ("Ada\u20dd", "Ada"),
        ("A\u034fda", "Ada"),
        ("محـمد", "محمد"),
        ("ᎪᎠᎪ", ""),  # Cherokee, which looks like ADA
        ("\U0001d159Ada", "Ada"),
    ],
)
def test_a_nickname_keeps_what_can_be_read(wish, kept):
    assert clean_nickname(wish) == unicodedata.normalize("NFKC", kept)


@pytest.mark.parametrize(
    "blank", ["\u200b\ufeff", "\u3164", "\u2800", "\u115f\u1160", "   ", "...", "\u0301", "\u034f", "\uffa0"]
)
def test_a_blank_nickname_is_none(blank):
    assert clean_nickname(blank) == ""
    assert named(blank) == ["Visitor 1"]


def test_marks_do_not_flood():
    flooded = clean_nickname("A" + "\u0316\u0317" * 40 + "da")
    assert sum(map(bool, map(unicodedata.combining, flooded))) == MARKS_IN_A_ROW
    assert flooded.endswith("da")


@pytest.mark.parametrize(
    "other",
    [
        "Alice",
        "ALICE",
        "AIice",
        "A1ice",
        "Аlice",
        "Αlice",
        "Alicе",
        "Al\u0131ce",
        "Alíce",
        "Ali ce",
        "Alice.",
        "A|ice",
        "Alіⅽe",
        "Ａlice",
    ],
)
def test_who_looks_like_another_gets_a_number(other):
    first, second = named("Alice", other)
    assert first == "Alice"
    assert second.endswith(" 2")


def test_a_name_that_many_have_costs_each_newcomer_as_much(monkeypatch):
    world, asked = World(), []
    visitors = world.server.visitors
    is_free = visitors._is_free
    monkeypatch.setattr(visitors, "_is_free", lambda seen, gone: bool(asked.append(seen)) or is_free(seen, gone))
    for n in range(250):
        assert world.join(name="x").last(Admitted).name == (f"x {n + 1}" if n else "x")
        assert len(asked) <= FEW
        asked.clear()
    world.operations.remove(7, world.now)
    assert world.join(name="x").last(Admitted).name == "x 7"


def test_names_that_differ_by_case_alone_are_one_in_every_script():
    assert named("Зоя", "зоя", "ЗОЯ", "ωmega", "Ωmega") == ["Зоя", "зоя 2", "ЗОЯ 3", "ωmega", "Ωmega 2"]


def test_different_names_stay_as_they_are():
    wishes = [
        "Ada",
        "Bob",
        "Eda",
        "Adam",
        "Ada Lovelace",
        "Дарья",
        "राम",
        "रमा",
        "山",
        "🚀",
        "🤖",
        "Ada 7",
        "Зоя",
        "Mary",
        "Marr",
    ]
    assert named(*wishes) == wishes


@pytest.mark.parametrize(
    "wish", ["operator", "The Operator", "0perat0r 2", "ОРЕRАТОR", "gatevvay", "G a t e w a y", "everybody"]
)
def test_only_operators_and_tickets_have_names_of_what_is_no_visitor(wish):
    assert is_reserved(clean_nickname(wish))
    assert named(wish) == ["Visitor 1"]
    world = World()
    assert world.join(world.ticket(Role.OPERATE), name="Operator").last(Admitted).name == "Operator"
    assert world.join(world.ticket(name="Operator Zoe")).last(Admitted).name == "Operator Zoe"
    assert world.join(world.ticket(), name="Operator").last(Admitted).name == "Visitor 3"


def test_a_name_is_free_again_for_whoever_looks_like_it():
    world = World()
    world.join(name="Ada")
    world.operations.remove(1, world.now)
    assert world.join(name="Аda").last(Admitted).name == "Аda"
    world.boot()
    assert world.join(name="Ada").last(Admitted).name == "Ada 2", "also after a restart"


@given(st.lists(st.text(st.sampled_from("Aaаαl1Ii|O0oо mrn\u0301\u200b.🤖"), max_size=40), max_size=12))
def test_no_two_visitors_look_the_same(wishes):
    names = named(*wishes)
    seen = [each for name in names for each in name_skeletons(name)]
    assert len(set(seen)) == len(seen)
    assert all(name == name.strip() and any(name_skeletons(name)) and len(name) <= 32 for name in names)


@given(st.text(max_size=60))
@example("¯0")
def test_what_is_kept_is_kept_again(wish):
    kept = clean_nickname(wish)
    assert len(kept) <= 32
    assert clean_nickname(kept) == kept
    assert all(each.isprintable() for each in kept)
    assert name_skeletons(kept + "7") == {each + "7" for each in name_skeletons(kept)}
