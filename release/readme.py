"""The README as an index shows it: alone, so that a link to a file beside it would lead nowhere."""

from __future__ import annotations

import re

_FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
_BESIDE = r"(?!https?://|mailto:)[^)\s]+"
_IMAGE = re.compile(rf"!\[[^]]*\]\({_BESIDE}\)\n*|<img\b(?![^>]*src=\"https?://)[^>]*>\n*")
_LINK = re.compile(rf"\[((?:[^][]|\[[^]]*\])*)\]\({_BESIDE}\)")


def for_index(text: str) -> str:
    """`text` without pictures from beside it, and with the words alone of links to what is beside it."""
    done, at = [], 0
    for fence in _FENCE.finditer(text):
        done += [_alone(text[at : fence.start()]), fence.group()]
        at = fence.end()
    return "".join([*done, _alone(text[at:])])


def _alone(text: str) -> str:
    return _LINK.sub(r"\1", _IMAGE.sub("", text))
