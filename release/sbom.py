"""What a wheel brings with it and asks for, in CycloneDX 1.6: read from the lock files, with nothing looked up.

The npm packages are those that `dependencies` of web/package.json lead to; the pages have of them what a browser runs.
The Python packages are not in the wheel: they are the versions it is tested with.
"""

from __future__ import annotations

import base64
import json
import re
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
_PIN = re.compile(r"^([A-Za-z0-9._-]+)==(\S+?)(?: ; (.+?))? \\$")
_VIA = re.compile(r"^    #(?: via)? +([A-Za-z0-9].*)$")
_NAME = re.compile(r"^[A-Za-z0-9._-]+")
# C of others that is compiled into ours (firmware/port/monocypher/SOURCE.md).
MONOCYPHER = {
    "type": "library",
    "bom-ref": "pkg:github/LoupVaillant/Monocypher@4.0.3",
    "name": "monocypher",
    "version": "4.0.3",
    "purl": "pkg:github/LoupVaillant/Monocypher@4.0.3",
    "licenses": [{"expression": "BSD-2-Clause OR CC0-1.0"}],
}


def bill_of_materials(version: str) -> dict[str, Any]:
    """The whole document; the same for the same lock files."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    purl = f"pkg:pypi/{project['name']}@{version}"
    components = [*_python(project["dependencies"]), *_npm(), MONOCYPHER]
    return {
        "$schema": "http://cyclonedx.org/schema/bom-1.6.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {
            "component": {
                "type": "application",
                "bom-ref": purl,
                "name": project["name"],
                "version": version,
                "purl": purl,
                "licenses": [{"expression": project["license"]}],
            }
        },
        "components": components,
    }


def _python(wanted: list[str]) -> list[dict[str, Any]]:
    """What the requirements lead to, as requirements.lock has it; its comments say what asks for what."""
    pins: list[tuple[str, str, str]] = []
    asked_by: dict[str, set[str]] = {}
    for line in (ROOT / "requirements.lock").read_text(encoding="utf-8").splitlines():
        if pin := _PIN.match(line):
            pins.append((pin[1], pin[2], pin[3] or ""))
        elif (via := _VIA.match(line)) and via[1] != "via":
            asked_by.setdefault(pins[-1][0], set()).add(via[1])
    reached = {match[0].lower() for want in wanted if (match := _NAME.match(want))}
    missing = reached - {name for name, _, _ in pins}
    if missing:
        raise SystemExit(f"error: not in requirements.lock: {', '.join(sorted(missing))}; hint: scripts/lock.sh")
    while more := {name for name, by in asked_by.items() if by & reached} - reached:
        reached |= more
    return [
        _component("pypi", name, version) | ({"properties": [{"name": "marker", "value": when}]} if when else {})
        for name, version, when in pins
        if name in reached
    ]


def _npm() -> list[dict[str, Any]]:
    packages = json.loads((ROOT / "web/package-lock.json").read_text(encoding="utf-8"))["packages"]
    found = {}
    for path, package in packages.items():
        name = path.rpartition("node_modules/")[2]
        if path and not package.get("dev"):
            component = _component("npm", name, package["version"])
            algorithm, _, digest = package["integrity"].partition("-")
            content = base64.b64decode(digest).hex()
            component["hashes"] = [{"alg": algorithm.upper().replace("SHA", "SHA-"), "content": content}]
            component["licenses"] = [{"expression": package["license"]}]
            found[component["purl"]] = component
    return [found[purl] for purl in sorted(found)]


def _component(kind: str, name: str, version: str) -> dict[str, Any]:
    purl = f"pkg:{kind}/{name.replace('@', '%40')}@{version}"
    return {"type": "library", "bom-ref": purl, "name": name, "version": version, "purl": purl}
