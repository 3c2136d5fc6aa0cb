"""What all commands have in common: help, mistakes told in one line, what a terminal shows; and the doctor."""

from __future__ import annotations

import inspect
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import tomllib
from importlib import import_module
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from brokers import bare_mosquitto
from commands import PHALANX, ROOT, run
from phalanx.cli import doctor
from phalanx.cli.codes import qr_text
from phalanx.cli.commands.mission import PROFILES
from phalanx.cli.credentials import login_in
from phalanx.cli.main import ABOUT, phalanx, run_command
from phalanx.gateway.projector import Wifi
from phalanx.net import Login
from ports import free_port


class TestMistakes:
    @pytest.mark.parametrize(
        ("arguments", "code", "words"),
        [
            (["up", "--robots", "0"], 2, "a swarm of 0 robots"),
            (["up", "--robots", "many"], 2, "--robots"),
            (["up", "--pin-digits", "3"], 2, "pin_digits is 3"),
            (["up", "--rotate-s", "5", "--overlap-s", "6"], 2, "overlap_s is 6"),
            (["up", "--rotate-s", "nan"], 2, "'--rotate-s': nan is not a finite number"),
            (["up", "--root", "noslash"], 2, "root 'noslash'"),
            (["up", "--qrkey", "--broker", "http://x"], 2, "unknown broker scheme http://"),
            (["up", "--qrkey", "--broker", "mqt://x"], 2, "did you mean mqtt://? "),
            (["up", "--swarm", "dotbt://x"], 2, "did you mean dotbot://? "),
            (["up", "--qrkey", "--broker", "mqtt://u:hunter2@x"], 2, "contains a login"),
            (["up", "--qrkey", "--broker", "mqtt://x", "--broker-login", "/nowhere"], 2, "cannot read /nowhere"),
            (["up", "--port", "99999"], 2, "--port"),
            (["up", "--host", "203.0.113.9"], 1, "cannot listen on 203.0.113.9"),
            (["up", "--host", "not a host"], 1, "cannot listen on not a host"),
            (["up", "--seed", "-1"], 2, "seed -1"),
            (["up", "--qrkey", "--broker", "mosquitto", "--frontend", "javascript:alert(1)"], 2, "is not a page"),
            (["up", "--duration", "0"], 2, "--duration"),
            (
                ["up", "--qrkey", "--broker", "mosquitto", "--broker-ws", "ws://x"],
                2,
                "--broker-ws without an external broker",
            ),
            (
                ["up", "--qrkey", "--broker", "mqtt://x", "--broker-ws", "mqtt://x"],
                2,
                "browsers cannot use mqtt://x:1883",
            ),
            (["up", "--page-url", "ftp://x"], 2, "'ftp://x' is not a page"),
            (["up", "--unheard-of"], 2, "--unheard-of"),
            (["nonsense"], 2, "nonsense"),
            (["link", "connect"], 2, "no swarm to visit"),
            (["link", "connect", "http://x/"], 2, "no pin"),
            (["link", "connect", "http://x/#v=1&pin=12a&broker=ws://x"], 2, "4 to 64 digits"),
            (["link", "connect", "--pin", "1234"], 2, "no swarm to visit"),
            (
                ["link", "connect", "x:#v=1&pin=123456&broker=ws://127.0.0.1:1", "--unlisted", "--drive", "a/#"],
                2,
                "'a/#' is not an address",
            ),
            (
                ["link", "connect", "http://x/#v=1&pin=123456&broker=ws://127.0.0.1:1", "--timeout", "0.5"],
                1,
                "no broker at",
            ),
            (
                ["link", "connect", "--pin", "1234", "--broker", "mqtt://127.0.0.1:1", "--timeout", "0.5"],
                1,
                "no broker at",
            ),
            (["link", "connect", "http://x/#v=1&pin=123456&broker=ws://x", "--left", "0"], 2, "without a robot"),
            (["link", "connect", "http://x/#v=1&pin=123456&broker=ws://x", "--for", "1"], 2, "without a robot"),
            (["link", "connect", "http://x/#v=1&pin=123456&broker=ws://x", "--drive", "A", "--watch"], 2, "--watch"),
            (["up", "--qrkey", "--broker", "mqtt://h/path"], 2, "has no path"),
            (
                ["up", "--qrkey", "--broker", "mqtt://localhost:1", "--wait", "0.5", "--defence", "none"],
                1,
                "0.5 s (connection refused)",
            ),
            (
                [
                    "up",
                    "--qrkey",
                    "--broker",
                    "mqtt://h.invalid",
                    "--wait",
                    "2",
                    "--duration",
                    "1",
                    "--defence",
                    "none",
                ],
                1,
                "no broker at",
            ),
            (["doctor", "--broker", "mqtt://127.0.0.1:1"], 1, ""),
            (["doctor", "--broker", "gopher://x"], 2, "gopher://"),
        ],
        ids=lambda value: " ".join(value) if isinstance(value, list) else None,
    )
    def test_one_clear_line_and_the_right_exit_code(self, arguments, code, words, capsys):
        assert run_command(arguments) == code
        told = capsys.readouterr().err
        assert words in told
        lines = [line for line in told.splitlines() if not line.startswith(("phalanx: hint:", "phalanx: warning"))]
        assert len(lines) <= 1, told
        assert "Traceback" not in told
        assert "hunter2" not in told

    def test_a_port_in_use(self):
        with socket.socket() as taken:
            taken.bind(("127.0.0.1", 0))
            taken.listen()
            port = taken.getsockname()[1]
            done = run("up", "--port", str(port))
        assert done.returncode == 1
        assert f"port {port}" in done.stderr
        assert "hint: " in done.stderr

    @pytest.mark.waits
    def test_a_wrong_login(self, tmp_path):
        tcp, ws = free_port(), free_port()
        with bare_mosquitto(tcp, ws, tmp_path, "allow_anonymous false") as (start, _):
            start()
            time.sleep(0.3)
            login = {"PHALANX_BROKER_USERNAME": "me", "PHALANX_BROKER_PASSWORD": "hunter2"}
            for arguments in (
                ["up", "--port", "0", "--defence", "none", "--qrkey"],
                ["link", "connect", "--pin", "123456"],
            ):
                done = run(*arguments, "--broker", f"mqtt://127.0.0.1:{tcp}", env=login)
                assert (done.returncode, "hunter2" in done.stderr) == (1, False)
                assert "refused the login" in done.stderr

    def test_a_login_file(self, tmp_path, capsys):
        (tmp_path / "login").write_text("no colon\n")
        assert run_command(["up", "--qrkey", "--broker", "mqtt://x", "--broker-login", str(tmp_path / "login")]) == 2
        assert "no colon" not in capsys.readouterr().err
        (tmp_path / "login").write_bytes(b"\xef\xbb\xbfguest:open house\r\n")  # as an editor of Windows does
        assert login_in(tmp_path / "login") == Login("guest", "open house")

    def test_a_file_of_authorities_that_is_none_is_told_before_any_broker_is_asked(self, tmp_path, monkeypatch, capsys):
        (tmp_path / "lab.crt").write_text("no certificate\n")
        for name, why in (("lab.crt", "no certificate in it"), ("lab.ctr", "No such file or directory")):
            monkeypatch.setenv("SSL_CERT_FILE", str(tmp_path / name))
            for command in ("doctor", "up --qrkey", "link connect --pin 123456"):
                assert run_command([*command.split(), "--broker", "mqtts://127.0.0.1:1"]) == 2
                told = capsys.readouterr().err
                assert f"SSL_CERT_FILE is {tmp_path / name}: {why}" in told
                assert ("did you mean lab.crt?" in told) == (name == "lab.ctr")

    @pytest.mark.waits
    def test_whoever_reads_our_output_may_leave(self):
        words = ["up", "--events", "--port", "0", "--defence", "none", "--rotate-s", "1", "--overlap-s", "0.5"]
        words += ["--broker", "mosquitto", "--qrkey", "--duration", "60"]
        with subprocess.Popen(
            [*PHALANX, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT
        ) as up:
            try:
                assert json.loads(up.stdout.readline())["event"] == "ready"
                up.stdout.close()
                up.wait(20)  # or TimeoutExpired: long before its duration is over
                assert "Traceback" not in up.stderr.read()
            finally:
                up.kill()

    @pytest.mark.waits
    def test_events_that_nobody_can_keep_end_a_gateway_with_a_line(self):
        with Path("/dev/full").open("w") as full:
            words = ["up", "--events", "--port", "0", "--defence", "none", "--duration", "60"]
            up = subprocess.run([*PHALANX, *words], stdout=full, stderr=subprocess.PIPE, text=True, timeout=30)
        assert up.returncode == 1
        assert up.stderr.endswith("phalanx: error: cannot write: No space left on device\n")
        assert "Traceback" not in up.stderr

    @pytest.mark.parametrize("module", ["phalanx.cli", "click", "phalanx.cli.commands.up", "numpy", "phalanx.net"])
    def test_ctrl_c_while_we_start_ends_us_without_a_word(self, module):
        code = (
            "import os, runpy, signal, sys\n"
            "class Finder:\n"
            "    def find_spec(self, name, *_):\n"
            "        try:\n"
            f"            name == {module!r} and os.kill(os.getpid(), signal.SIGINT)\n"
            "        except KeyboardInterrupt:\n"
            "            pass  # as some module did, and the gateway ran on\n"
            "sys.meta_path.insert(0, Finder())\n"
            "sys.argv = ['phalanx', 'up', '--wait', '1', '--broker', 'mqtt://127.0.0.1:1']\n"
            "runpy.run_module('phalanx', run_name='__main__')"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
        assert done.returncode == -signal.SIGINT
        assert not done.stderr

    def test_ctrl_c_is_quiet_before_anything_else_is_imported(self):
        # What the entry point says; whatever comes before is made to wait by the script that starts it.
        code = (
            "import signal, sys\n"
            "before = []\n"
            "class Finder:\n"
            "    def find_spec(self, name, *_):\n"
            "        signal.getsignal(signal.SIGINT) is signal.SIG_DFL or before.append(name)\n"
            "sys.meta_path.insert(0, Finder())\n"
            "for name in [name for name in sys.modules if name not in ('sys', '_signal', 'signal', 'builtins')]:\n"
            "    name.startswith(('enum', 'typing', 're', 'importlib.')) and sys.modules.pop(name)\n"
            "from phalanx.__main__ import main\n"
            "print(*dict.fromkeys(before))"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
        assert done.stdout.split() == ["phalanx", "phalanx.__main__"], done.stderr

    @pytest.mark.parametrize("linked", [False, True])
    def test_ctrl_c_in_pythons_own_start_and_in_an_installers_script_ends_us_without_a_word(self, tmp_path, linked):
        # A tool links what it installs; `site` comes before any line of a program.
        (folder := tmp_path / "a tool's").mkdir()
        script = shutil.copy(ROOT / "release" / "phalanx", folder)
        entry = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]["phalanx-python"]
        assert entry == "phalanx.__main__:main"
        begins = ["import os, re", "from pathlib import Path", "from phalanx.__main__ import main", "main()"]
        (folder / "phalanx-python").write_text("\n".join([f"#!{sys.executable}", *begins]))
        (folder / "phalanx-python").chmod(0o755)
        (folder / "sitecustomize.py").write_text(
            "import os, signal; os.kill(os.getpid(), signal.SIGINT); os.write(1, b'on')"
        )
        if linked:
            (tmp_path / "phalanx").symlink_to(script)
            script = tmp_path / "phalanx"
        before = os.environ | {"PYTHONPATH": f"{folder}:{ROOT / 'src'}"}
        done = subprocess.run([script, "--help"], capture_output=True, text=True, timeout=60, env=before)
        assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, "on", "")

    def test_letters_that_the_terminal_lacks_and_a_closed_stdin_are_no_traceback(self):
        lacks = {"PYTHONIOENCODING": "latin-1"}
        assert "#j=?" in run("link", "connect", "--help", env=lacks).stdout
        words = ["sh", "-c", 'exec "$@" <&-', "sh", *PHALANX, "link", "connect", "-"]
        done = subprocess.run(words, capture_output=True, text=True, timeout=60)
        assert done.returncode == 2
        assert done.stderr.startswith("phalanx: error: no swarm to visit")

    def test_no_command_tells_where_help_is(self):
        done = run(fresh=True)
        assert done.returncode == 2
        assert "up" in done.stdout + done.stderr


# Each takes longer to import than a command's help may take in all.
SLOW = ("numpy", "aiohttp", "aiomqtt", "cryptography", "matplotlib", "mcap")


def imported(*commands: list[str]) -> list[str]:
    """Of what is slow and of what commands do, what a process has imported that ran these commands."""
    script = (
        "import json, sys; from phalanx.cli.main import run_command;"
        f"codes = [run_command(words) for words in {list(commands)}];"
        f"slow = [name for name in {SLOW} if name in sys.modules];"
        "sys.exit(json.dumps([codes, slow]))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    codes, slow = json.loads(done.stderr)
    assert not any(codes), done.stderr
    return slow


class TestHelp:
    def commands(self, command=phalanx, path=()):
        yield path, command
        for name, inner in getattr(command, "commands", {}).items():
            yield from self.commands(inner, (*path, name))

    def test_every_command_has_help_with_an_example(self):
        for path, command in self.commands():
            done = CliRunner().invoke(phalanx, [*path, "--help"])
            assert done.exit_code == 0, path
            assert re.search(r"Examples?: phalanx", done.output), path
            for option in command.params:
                if isinstance(option, click.Option):
                    assert option.help, (path, option.name)

    def test_the_profiles_that_are_offered_are_those_of_missions(self):
        from phalanx.mission import Profile

        assert list(PROFILES.choices) == [profile.name.lower() for profile in Profile]

    def test_version(self):
        from phalanx import __version__

        assert run("--version", fresh=True).stdout.strip() == f"phalanx {__version__}"

    def test_the_list_of_commands_says_what_each_says_of_itself(self):
        for name, about in ABOUT.items():
            assert phalanx.commands[name].name == name
            assert phalanx.commands[name].get_short_help_str(1000) == about

    def test_help_and_lists_import_nothing_that_takes_time(self):
        """What people wait for is imports; which are there does not depend on how busy the machine is."""
        words = [[*path, "--help"] for path, _ in self.commands()]
        assert len(words) > 18
        assert imported(*words) == []
        assert imported(["sim", "list"], ["sim", "schema"], ["attack", "list"]) == []

    def test_each_command_s_function_takes_its_options(self):
        for _, command in self.commands():
            if hasattr(command.callback, "runs"):
                module, function = command.callback.runs
                body = getattr(import_module(f"phalanx.cli.{module}"), function)
                known = getattr(command.callback, "keywords", {})  # which figure to reproduce
                inspect.signature(body).bind(**known, **{option.name: None for option in command.params})


@pytest.mark.waits
class TestDoctor:
    def test_each_line_is_ok_or_a_fix_or_optional(self):
        done = run("doctor")
        assert done.returncode == 0, done.stdout
        assert all(line.startswith(("ok ", "fix", "-  ")) for line in done.stdout.splitlines())
        findings = json.loads(run("doctor", "--json").stdout)["findings"]
        assert {"python", "kernels", "C compiler", "broker of our own", "pages", "clock"} <= {
            finding["what"] for finding in findings
        }

    def test_what_is_optional_and_missing_is_neither_ok_nor_to_be_mended(self, monkeypatch):
        monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
        missing = doctor._figures()
        assert (missing.state, missing.ok) == ("-", True)
        assert missing.found.startswith("not installed (only for figures)")
        assert doctor.Finding("clock", ok=True, found="now").state == "ok"
        assert doctor.Finding("clock", ok=False, found="1970", fix="set it").state == "fix"

    def test_a_broker_that_is_there_and_one_that_is_not(self, tmp_path):
        tcp, ws = free_port(), free_port()
        with bare_mosquitto(tcp, ws, tmp_path) as (start, _):
            start()
            time.sleep(0.3)
            done = run("doctor", "--broker", f"ws://127.0.0.1:{ws}")
            assert done.returncode == 0
            assert "answers, MQTT 5" in done.stdout
            assert f"ws://127.0.0.1:{ws}/mqtt" in done.stdout
            for words, code in (((), 1), (("--broker-ws", f"ws://127.0.0.1:{ws}/mqtt"), 0)):
                done = run("doctor", "--broker", f"mqtt://127.0.0.1:{tcp}", *words)
                assert (done.returncode, "for phones  →  use --broker-ws" in done.stdout) == (code, code == 1)
        done = run("doctor", "--broker", f"mqtt://127.0.0.1:{tcp}")
        assert done.returncode == 1
        assert any(line.startswith("fix") and "connection refused" in line for line in done.stdout.splitlines())


@pytest.mark.parametrize("colour", [True, False])
def test_the_terminals_code_is_the_code(colour):
    url = "http://192.168.100.100:8080/#v=1&pin=" + "7" * 39 + "&broker=ws%3A%2F%2F192.168.100.100%3A9001%2Fmqtt"
    assert read_back(url, colour=colour) == url
    assert len(qr_text(url, border=1, colour=False).splitlines()) == 20, "it fits an ordinary terminal"


@pytest.mark.parametrize(
    ("ssid", "password", "code"),
    [
        ('"foo;bar\\baz"', "", r"WIFI:S:\"foo\;bar\\baz\";;"),  # the example of the published format
        ("Café, 2. Stock", r'a,b;c\d:e"f', r"WIFI:T:WPA;S:Café\, 2. Stock;P:a\,b\;c\\d\:e\"f;;"),
        ("ゲスト", "0123456789012345", "WIFI:T:WPA;S:ゲスト;P:0123456789012345;;"),
    ],
)
def test_phones_read_the_name_and_the_password_of_a_wifi(ssid, password, code):
    assert read_back(Wifi(ssid, password).code, colour=False) == code
    fields = re.findall(r"(?:^WIFI:|(?<!\\);)([SP]):((?:\\.|[^\\;])*)", code)
    shown = {name: re.sub(r"\\(.)", r"\1", value) for name, value in fields}
    assert (shown["S"], shown.get("P", "")) == (ssid, password)


def read_back(url: str, *, colour: bool) -> str:
    """Read a terminal's code with another program: first the terminal's cells to pixels, then zxing."""
    import numpy as np
    import zxingcpp

    light = {"█": (1, 1), "▀": (1, 0), "▄": (0, 1), " ": (0, 0)}
    rows = []
    for line in qr_text(url, border=4, colour=colour).splitlines():
        if colour:
            cells = [(t == "231", b == "231") for t, b in re.findall(r"38;5;(\d+);48;5;(\d+)m▀", line)]
        else:
            cells = [light[letter] for letter in line]
        rows += [[top for top, _ in cells], [bottom for _, bottom in cells]]
    picture = np.kron(np.array(rows, dtype=np.uint8) * 255, np.ones((8, 8), dtype=np.uint8))
    (found,) = zxingcpp.read_barcodes(picture)
    return found.text
