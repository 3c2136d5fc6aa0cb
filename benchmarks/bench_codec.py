"""Sealing and opening a message of 100 bytes, against AES-GCM of the same bytes and nothing else."""

from __future__ import annotations

import os
import time

from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from joserfc import jwe
from joserfc.jwk import OctKey
from rows import Row, ratio, timed

from phalanx.config import LinkConfig
from phalanx.crypto import IV_BYTES, open_jwe, seal_jwe
from phalanx.link import Epoch, derive_epoch, new_pin
from phalanx.link.envelope import encode_envelope, open_envelope, seal
from phalanx.link.replay import ReplayCache

LINK = LinkConfig()
HEADER = {"alg": "dir", "enc": "A256GCM"}
# Sealed with a timestamp of microseconds, a joystick's words make 100 bytes.
WHEELS = {"left_x": -100, "left_y": -100, "right_x": -10, "right_y": -100}
SOME_TIME_S = 1234567890.123456
PLAINTEXT_BYTES = 100
MOST_TIMES_RAW = 10.0


def fresh_epoch() -> Epoch:
    return derive_epoch(new_pin(LINK.pin_digits, os.urandom))


def bench_codec(repetitions: int, count: int) -> list[Row]:
    epoch = fresh_epoch()
    plaintext = encode_envelope(WHEELS, SOME_TIME_S)
    assert len(plaintext) == PLAINTEXT_BYTES
    raw_key, jose_key = AESGCM(epoch.key.raw), OctKey.import_key(epoch.key.raw)
    cache = ReplayCache(LINK.replay_capacity, LINK.tolerance_s)

    def raw() -> None:
        iv = os.urandom(IV_BYTES)
        assert raw_key.decrypt(iv, raw_key.encrypt(iv, plaintext, b""), b"") == plaintext

    def token() -> None:
        sealed = seal_jwe(plaintext, epoch.key, os.urandom(IV_BYTES))
        assert open_jwe(sealed, epoch.key, LINK.max_to_server_bytes)[1] == plaintext

    def joserfc() -> None:
        assert jwe.decrypt_compact(jwe.encrypt_compact(HEADER, plaintext, jose_key), jose_key).plaintext == plaintext

    def envelope() -> None:
        now_s = time.time()
        sealed = seal(encode_envelope(WHEELS, now_s), epoch, os.urandom(IV_BYTES))
        open_envelope(sealed, epoch, now_s, cache, LINK.max_to_server_bytes)

    jobs = {"raw": raw, "token": token, "envelope": envelope, "joserfc": joserfc}
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(repetitions):
        for name, job in jobs.items():
            times[name].append(timed(job, count))
    against = times["raw"]
    return [
        ratio(1, "seal + open 100 B, the token (JWE)", times["token"], against, limit=MOST_TIMES_RAW),
        ratio(1, "… the whole envelope (JSON, clock, replays)", times["envelope"], against, limit=MOST_TIMES_RAW),
        ratio(0, "… the token by joserfc, for comparison", times["joserfc"], against),
    ]
