"""The file that keeps the operator's token over a restart: made for its owner alone, and refused if others may read it."""

from __future__ import annotations

import os

import pytest

from phalanx.cli.credentials import kept_token
from phalanx.errors import UsageError


def test_it_is_made_for_its_owner_alone_and_says_the_same_again(tmp_path):
    path = tmp_path / "token"
    before = os.umask(0)
    try:
        token = kept_token(path)
    finally:
        os.umask(before)
    assert len(token) == 32
    assert path.stat().st_mode & 0o777 == 0o600
    assert kept_token(path) == token
    assert kept_token(tmp_path / "another") != token


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620])
def test_a_file_that_others_may_read_or_write_is_refused_and_its_token_not_told(tmp_path, mode):
    path = tmp_path / "token"
    path.write_text("an-operators-secret-token\n")
    path.chmod(mode)
    with pytest.raises(UsageError, match="other users may read") as caught:
        kept_token(path)
    assert "secret" not in f"{caught.value} {caught.value.hint}"


@pytest.mark.parametrize("words", [b"short", b"a token of several words", b"\xff" * 20, b"x" * 4000])
def test_what_is_no_token_is_refused(tmp_path, words):
    path = tmp_path / "token"
    path.touch(0o600)
    path.write_bytes(words)
    with pytest.raises(UsageError):
        kept_token(path)


def test_neither_a_link_nor_a_pipe_nor_a_folder_is_followed(tmp_path):
    elsewhere, pipe = tmp_path / "elsewhere", tmp_path / "pipe"
    (tmp_path / "link").symlink_to(elsewhere)
    os.mkfifo(pipe, 0o600)
    for path in (tmp_path / "link", pipe, tmp_path, tmp_path / "no" / "where"):
        with pytest.raises(UsageError):
            kept_token(path)
    assert not elsewhere.exists()
