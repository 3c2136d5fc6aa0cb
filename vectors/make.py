"""Writes vectors/*.json, which Python and TypeScript both run.

Valid messages are sealed by joserfc and derived by cryptography directly, not by the code under test. Run it as
`python vectors/make.py`; a test checks that what is committed is what it writes.
"""

from __future__ import annotations

import base64
import json
import sys
from pathlib import Path
from typing import Any

from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

HERE = Path(__file__).parent
NOW = 1_700_000_000.0
LIMIT = 48 * 1024
HEADER = b'{"alg":"dir","enc":"A256GCM"}'


def b64(raw: bytes) -> str:
    return base64.urlsafe_b64encode(raw).rstrip(b"=").decode()


def derive(pin: str, info: str, length: int) -> bytes:
    return HKDF(algorithm=SHA256(), length=length, salt=b"", info=info.encode()).derive(pin.encode())


KEY = derive("123456789012", "secret_key_0.12", 32)
IV = bytes(range(12))


def sealed(plaintext: bytes, *, key: bytes = KEY, iv: bytes = IV, header: bytes = HEADER, tag_bytes: int = 16) -> str:
    aad = b64(header)
    out = AESGCM(key).encrypt(iv, plaintext, aad.encode())
    return ".".join((aad, "", b64(iv), b64(out[:-16]), b64(out[-16:][:tag_bytes])))


def body(payload: Any, timestamp: Any = NOW) -> str:
    return json.dumps({"timestamp": timestamp, "payload": payload}, separators=(",", ":"))


def keys() -> list[dict[str, Any]]:
    pins = ["123456789012", "000000000001", "0000", "9" * 39, "012345678901234567890123456789012345678", "1" * 64]
    good = [
        {
            "name": f"pin of {len(pin)} digits, {pin[:4]}…",
            "expect": "ok",
            "pin": pin,
            "topic": base64.urlsafe_b64encode(derive(pin, "secret_topic_0.12", 16)).decode(),
            "key_hex": derive(pin, "secret_key_0.12", 32).hex(),
        }
        for pin in pins
    ]
    bad = {
        "empty": "",
        "three digits": "123",
        "65 digits": "1" * 65,
        "a letter": "12345678901a",
        "a space": "1234 5678901",
        "a minus": "-12345678901",
        "other digits": "１２３４５６７８９０１２",
        "arabic digits": "١٢٣٤٥٦",
        "a newline": "123456789012\n",
    }
    return good + [{"name": name, "expect": "BadPin", "pin": pin} for name, pin in bad.items()]


def envelopes() -> list[dict[str, Any]]:
    cases: list[dict[str, Any]] = []

    def add(name: str, expect: str, jwe: str, plaintext: str | None = None, **more: Any) -> None:
        case = {
            "name": name,
            "expect": expect,
            "key_hex": KEY.hex(),
            "iv_hex": IV.hex(),
            "now": NOW,
            "max_bytes": LIMIT,
        }
        case["jwe"] = jwe
        if plaintext is not None:
            case["plaintext"] = plaintext
        cases.append(case | more)

    def plain(name: str, expect: str, plaintext: str, **more: Any) -> None:
        add(name, expect, sealed(plaintext.encode()), plaintext, **more)

    payloads: list[Any] = [None, True, 0, -1.5, "", "héllo ☂", [], {}, {"left_x": 0, "left_y": 60}, [[[1]]], "x" * 200]
    for payload in payloads:
        text = body(payload)
        plain(f"payload {json.dumps(payload)[:24]}", "ok", text, timestamp=NOW, payload=payload)
    plain("other keys are ignored", "ok", '{"a":1,"timestamp":1700000000,"payload":2,"b":[]}', timestamp=NOW, payload=2)
    for rest in ('1,"payload":1', '{"a":1,"\\u0061":2}', '[{"a":{"b":1,"b":1}}]'):
        plain(f"a key twice: {rest}", "MalformedEnvelope", f'{{"timestamp":1700000000,"payload":{rest}}}')
    again = [{"a": 1}, {"a": {"a": ":"}}]
    plain("one key in several objects", "ok", body(again), timestamp=NOW, payload=again)
    for name, skew in (("29.9 s old", -29.9), ("30 s old", -30.0), ("30 s ahead", 30.0)):
        plain(name, "ok", body(1, NOW + skew), timestamp=NOW + skew, payload=1)
    for name, skew in (("30.1 s old", -30.1), ("30.1 s ahead", 30.1), ("1970", -NOW), ("the year 5138", 1e11)):
        plain(name, "Stale", body(1, NOW + skew))
    for name, text in {
        "timestamp NaN": '{"timestamp":NaN,"payload":1}',
        "timestamp Infinity": '{"timestamp":Infinity,"payload":1}',
        "timestamp 1e999": '{"timestamp":1e999,"payload":1}',
        "timestamp of 400 digits": '{"timestamp":1' + "0" * 400 + ',"payload":1}',
        "timestamp a string": '{"timestamp":"1700000000","payload":1}',
        "timestamp true": '{"timestamp":true,"payload":1}',
        "timestamp null": '{"timestamp":null,"payload":1}',
        "no timestamp": '{"payload":1}',
        "no payload": '{"timestamp":1700000000}',
        "payload NaN": '{"timestamp":1700000000,"payload":NaN}',
        "an array": "[1700000000,1]",
        "a number": "1700000000",
        "null": "null",
        "empty text": "",
        "not JSON": "{'timestamp':1700000000,'payload':1}",
        "trailing comma": '{"timestamp":1700000000,"payload":1,}',
        "trailing bytes": '{"timestamp":1700000000,"payload":1}x',
        "a pin message where none is due": '{"cmd":255,"pin_code":"123456789012"}',
    }.items():
        plain(name, "MalformedEnvelope", text)
    plain("nested 20000 deep", "MalformedEnvelope", "[" * 20_000)
    add("not UTF-8", "MalformedEnvelope", sealed(b'{"timestamp":1700000000,"payload":"\xff"}'))

    good = sealed(body(1).encode())
    header, _, iv, ciphertext, tag = good.split(".")
    flip = "B" if ciphertext[5] != "B" else "C"
    for name, jwe in {
        "another key": sealed(body(1).encode(), key=bytes(32)),
        "ciphertext altered": f"{header}..{iv}.{ciphertext[:5]}{flip}{ciphertext[6:]}.{tag}",
        "ciphertext cut by a byte": f"{header}..{iv}.{b64(base64.urlsafe_b64decode(ciphertext + '==')[:-1])}.{tag}",
        "tag of zeros": f"{header}..{iv}.{ciphertext}.{b64(bytes(16))}",
        "another IV": f"{header}..{b64(bytes(12))}.{ciphertext}.{tag}",
        "empty ciphertext": f"{header}..{iv}..{tag}",
    }.items():
        add(name, "NotAuthentic", jwe)
    spare = tag[:-1] + chr(ord(tag[-1]) + 1)  # 16 bytes leave spare bits in the last character
    for name, jwe in {
        "empty": "",
        "garbage": "hello",
        "four segments": ".".join(good.split(".")[:4]),
        "six segments": good + ".x",
        "header with other keys": sealed(body(1).encode(), header=b'{"alg":"dir","enc":"A256GCM","kid":"1"}'),
        "header in another order": sealed(body(1).encode(), header=b'{"enc":"A256GCM","alg":"dir"}'),
        "alg none": sealed(body(1).encode(), header=b'{"alg":"none","enc":"A256GCM"}'),
        "an encrypted key": f"{header}.AAAA.{iv}.{ciphertext}.{tag}",
        "padding": f"{header}..{iv}.{ciphertext}.{tag}==",
        "spare bits": f"{header}..{iv}.{ciphertext}.{spare}",
        "plus and slash": f"{header}..{iv}.{ciphertext[:-4]}+/+/.{tag}",
        "a space": f"{header}..{iv}.{ciphertext[:4]} {ciphertext[4:]}.{tag}",
        "a newline at the end": good + "\n",
        "one character too many": f"{header}..{iv}.{ciphertext}AAAAA"[:-4] + f".{tag}"
        if len(ciphertext) % 4 == 0
        else f"{header}..{iv}.{ciphertext[: len(ciphertext) // 4 * 4]}A.{tag}",
        "IV of 11 bytes": f"{header}..{b64(IV[:11])}.{ciphertext}.{tag}",
        "IV of 16 bytes": f"{header}..{b64(IV + bytes(4))}.{ciphertext}.{tag}",
        "tag of 12 bytes": sealed(body(1).encode(), tag_bytes=12),
        "not ASCII": f"{header}..{iv}.{ciphertext[:-1]}é.{tag}",
    }.items():
        add(name, "MalformedJwe", jwe)

    frame = len(body(""))
    small = 256
    for name, size, expect in (("exactly the limit", small, "ok"), ("one byte over", small + 1, "TooLarge")):
        text = body("y" * (size - frame))
        more = {"timestamp": NOW, "payload": "y" * (size - frame)} if expect == "ok" else {}
        plain(name, expect, text, max_bytes=small, **more)
    add("far too large", "TooLarge", "A" * 5000, max_bytes=small)
    return cases


def topics() -> list[dict[str, Any]]:
    root, topic = "/qrkey", "AjHghGOlWfMoUEfaJVm9yw=="
    base = f"{root}/{topic}"
    command = {"kind": "command", "address": "DECAFBAD00000001", "application": "0", "command": "move_raw"}
    good = [
        ("a command", f"{base}/command/0000/DECAFBAD00000001/0/move_raw", command),
        ("a request", f"{base}/request", {"kind": "request"}),
        ("a notification", f"{base}/notify", {"kind": "notify"}),
        ("a reply", f"{base}/reply/mqttjs_1a2b3c4d", {"kind": "reply", "client_id": "mqttjs_1a2b3c4d"}),
        ("client id with . and :", f"{base}/reply/a.b:c-d_e", {"kind": "reply", "client_id": "a.b:c-d_e"}),
    ]
    bad = {
        "another root": f"/pydotbot/{topic}/request",
        "no leading slash": f"qrkey/{topic}/request",
        "another epoch": f"{root}/{topic[:-3]}A==/request",
        "nothing after the epoch": base,
        "a slash after the epoch": base + "/",
        "unknown sub-topic": f"{base}/telemetry",
        "request with more": f"{base}/request/x",
        "reply without a client": f"{base}/reply/",
        "reply to two": f"{base}/reply/a/b",
        "reply to a wildcard": f"{base}/reply/+",
        "reply to #": f"{base}/reply/#",
        "client id of 129": f"{base}/reply/" + "a" * 129,
        "another swarm": f"{base}/command/0001/AB/0/move_raw",
        "command without a name": f"{base}/command/0000/AB/0",
        "command with more": f"{base}/command/0000/AB/0/move_raw/x",
        "empty address": f"{base}/command/0000//0/move_raw",
        "address with a plus": f"{base}/command/0000/+/0/move_raw",
        "address with a space": f"{base}/command/0000/A B/0/move_raw",
        "address with a newline": f"{base}/command/0000/AB\n/0/move_raw",
        "address of 65": f"{base}/command/0000/" + "A" * 65 + "/0/move_raw",
        "application not a number": f"{base}/command/0000/AB/x/move_raw",
        "name with #": f"{base}/command/0000/AB/0/#",
        "name with a dot": f"{base}/command/0000/AB/0/move.raw",
        "not ASCII": f"{base}/command/0000/ÅB/0/move_raw",
    }
    shared = {"root": root, "topic": topic}
    return [{"name": n, "expect": "ok", **shared, "full": full, **sub} for n, full, sub in good] + [
        {"name": n, "expect": "WrongTopic", **shared, "full": full} for n, full in bad.items()
    ]


def replays() -> list[dict[str, Any]]:
    def step(now: float, iv: int, timestamp: float, expect: str, epoch: str = "a") -> dict[str, Any]:
        return {"now": now, "epoch": epoch, "iv": f"{iv:024x}", "timestamp": timestamp, "expect": expect}

    return [
        {
            "name": "a replay at once, and at the end of the window",
            "capacity": 10,
            "steps": [step(100, 1, 100, "ok"), step(100, 1, 100, "Replayed"), step(130, 1, 100, "Replayed")],
        },
        {
            "name": "after the window it is stale",
            "capacity": 10,
            "steps": [step(100, 1, 100, "ok"), step(130.5, 1, 100, "Stale"), step(200, 1, 100, "Stale")],
        },
        {
            "name": "two epochs are two keys",
            "capacity": 10,
            "steps": [step(100, 1, 100, "ok"), step(100, 1, 100, "ok", "b"), step(100, 1, 100, "Replayed", "b")],
        },
        {
            "name": "full: refuse, and open again when entries expire",
            "capacity": 2,
            "steps": [
                step(100, 1, 100, "ok"),
                step(100, 2, 100, "ok"),
                step(100, 3, 100, "CacheFull"),
                step(100, 1, 100, "Replayed"),
                step(129, 3, 129, "CacheFull"),
                step(132, 3, 132, "ok"),
            ],
        },
        {
            "name": "a burst dated over the whole window leaves room for what comes a moment later",
            "capacity": 512,
            "steps": [
                *(step(100, iv, 71 + iv % 59, "ok") for iv in range(64)),
                step(100, 64, 100, "CacheFull"),
                step(100.25, 64, 100.25, "ok"),
                step(100.25, 65, 100.25, "CacheFull"),
                step(100.25, 58, 129, "Replayed"),
            ],
        },
        {
            "name": "the clock set back does not reopen what was forgotten",
            "capacity": 10,
            "steps": [
                step(100, 1, 100, "ok"),
                step(200, 2, 200, "ok"),
                step(100, 1, 100, "Stale"),
                step(180, 3, 180, "ok"),
            ],
        },
        {
            "name": "a message from ahead is remembered until it is stale",
            "capacity": 10,
            "steps": [step(100, 1, 130, "ok"), step(159, 1, 130, "Replayed"), step(160, 1, 130, "Replayed")],
        },
        {
            "name": "a refused message leaves no trace",
            "capacity": 1,
            "steps": [step(100, 1, 50, "Stale"), step(100, 1, 100, "ok")],
        },
    ]


def pin_messages() -> list[dict[str, Any]]:
    def case(name: str, expect: str, plaintext: str, **more: Any) -> dict[str, Any]:
        return {"name": name, "expect": expect, "plaintext": plaintext, **more}

    pin = "009876543210"
    return [
        case("as published", "ok", '{"cmd": 255, "pin_code": "' + pin + '"}', pin=pin),
        case("as we write it", "ok", '{"cmd":255,"pin_code":"' + pin + '"}', pin=pin),
        case("39 digits", "ok", '{"cmd":255,"pin_code":"' + "7" * 39 + '"}', pin="7" * 39),
        case("a number loses leading zeros", "MalformedEnvelope", '{"cmd":255,"pin_code":9876543210}'),
        case("no pin", "MalformedEnvelope", '{"cmd":255}'),
        case("pin null", "MalformedEnvelope", '{"cmd":255,"pin_code":null}'),
        case("letters", "MalformedEnvelope", '{"cmd":255,"pin_code":"abcd"}'),
        case("too long", "MalformedEnvelope", '{"cmd":255,"pin_code":"' + "1" * 65 + '"}'),
        case("another cmd", "MalformedEnvelope", '{"cmd":254,"pin_code":"' + pin + '"}'),
    ]


def qrurls() -> list[dict[str, Any]]:
    pin = "0" * 38 + "7"
    ours = f"http://192.168.1.7:8080/#v=1&pin={pin}&broker=ws%3A%2F%2F192.168.1.7%3A9001%2Fmqtt&root=%2Fqrkey&mqtt=5"
    theirs = (
        "https://dotbots.github.io/PyDotBot?use_qrkey=true&pin=012345678901&mqtt_host=broker.hivemq.com"
        "&mqtt_port=8884&mqtt_version=5&mqtt_use_ssl=True"
    )
    plain = theirs.replace("=True", "=False").replace("mqtt_version=5", "mqtt_version=4")
    own = {"broker": "ws://192.168.1.7:9001/mqtt", "root": "/qrkey", "mqtt": 5}
    good = [
        {"name": "ours", "url": ours, "pin": pin, **own},
        {"name": "ours, 3.1.1", "url": ours.replace("mqtt=5", "mqtt=4"), "pin": pin, **own, "mqtt": 4},
        {
            "name": "ours, login",
            "url": f"{ours}&user=guest&password=a%26b%20c%23%C3%A9",
            "pin": pin,
            **own,
            "login": {"username": "guest", "password": "a&b c#\u00e9"},
        },
        {
            "name": "ours, login without a password",
            "url": f"{ours}&user=guest",
            "pin": pin,
            **own,
            "login": {"username": "guest", "password": ""},
        },
        {"name": "ours, defaults", "url": ours.split("&root", maxsplit=1)[0], "pin": pin, **own},
        {
            "name": "published, TLS",
            "url": theirs,
            "pin": "012345678901",
            "broker": "wss://broker.hivemq.com:8884/mqtt",
            "root": "/qrkey",
            "mqtt": 5,
        },
        {
            "name": "published, login",
            "url": f"{theirs}&mqtt_username=guest&mqtt_password=open%20house",
            "pin": "012345678901",
            "broker": "wss://broker.hivemq.com:8884/mqtt",
            "root": "/qrkey",
            "mqtt": 5,
            "login": {"username": "guest", "password": "open house"},
        },
        {
            "name": "published, plain, 3.1.1",
            "url": plain,
            "pin": "012345678901",
            "broker": "ws://broker.hivemq.com:8884/mqtt",
            "root": "/qrkey",
            "mqtt": 4,
        },
    ]
    bad = {
        "empty": "",
        "no pin": ours.replace("&pin=" + pin, ""),
        "pin of letters": ours.replace(pin, "abcdefgh"),
        "a pin twice": ours + "&pin=" + pin,
        "another version": ours.replace("v=1", "v=9"),
        "no broker": ours.split("&broker", maxsplit=1)[0],
        "broker by http": ours.replace("ws%3A", "http%3A"),
        "broker with a script": ours.replace("ws%3A", "javascript%3A"),
        "broker with a login": ours.replace("%2F%2F192", "%2F%2Fu%3Ap%40192"),
        "port out of range": ours.replace("9001", "99001"),
        "root without a slash": ours.replace("root=%2Fqrkey", "root=qrkey"),
        "root with a wildcard": ours.replace("root=%2Fqrkey", "root=%2F%23"),
        "mqtt 3": ours.replace("mqtt=5", "mqtt=3"),
        "published without a host": theirs.replace("broker.hivemq.com", ""),
        "published with a bad port": theirs.replace("8884", "http"),
        "a password without a name": f"{ours}&password=x",
        "a name twice": f"{ours}&user=a&user=b",
        "a name too long": f"{ours}&user={'a' * 129}",
        "a name that commands a terminal": f"{ours}&user=%1B%5B2J",
        "published with a password alone": f"{theirs}&mqtt_password=x",
    }
    return [{"expect": "ok", **case} for case in good] + [
        {"expect": "BadPin" if name == "pin of letters" else "BadQrUrl", "name": name, "url": url}
        for name, url in bad.items()
    ]


VECTORS = {
    "keys": keys,
    "envelope": envelopes,
    "topics": topics,
    "replay": replays,
    "pin_message": pin_messages,
    "qrurl": qrurls,
}


def main() -> int:
    for name, cases in VECTORS.items():
        text = json.dumps({"cases": cases()}, indent=1, ensure_ascii=True) + "\n"
        (HERE / f"{name}.json").write_text(text)
        print(f"{name}.json: {text.count(chr(34) + 'name' + chr(34))} cases", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
