"""Spoil files: numbers, keys and types of what they hold, and their bytes."""

from __future__ import annotations

import copy
import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from random import Random
from typing import Any

import yaml

NUMBERS: tuple[Any, ...] = (
    0, -0.0, 1, -1, 2, 3, 0.5, 1e-300, 5e-324, 1e300, -1e300, 1.7e308, 1e30, 1.1e30, -1e30, 1e-30,
    1e12, -1e12, 1.1e12, 1e-12, 1e-13, 1e6, 1e-6, 1e9, 1e-9, 1e16, 1e22, 1e-20, 1e4, 1e3, 1025,
    float("nan"), float("inf"), -float("inf"), 2**31, 2**63, -(2**63), 2**64, 10**400, 3.14159,
)  # fmt: skip
WORDS: tuple[Any, ...] = (
    "", "text", "nan", "1:30", "0x10", "\ud83d\ude00", "a\x1b[2Jb", "../../../../etc/passwd",
    "/dev/zero", "file:///dev/zero", "package://../x", "x" * 300, "x" * 5000, "scene.yaml", "..",
    "mesh.gltf", "hand", "default", "box", "floor", None, True, False, [], {}, [[]], [1, 2, 3],
    [0, 0, 0], {"type": "box"}, {"a": {"b": {"c": 1}}}, "2020-13-45", "!!python/none", "~", "%00",
    "$\\frac$", "$x", "a$b$c", "_x^{", "two\nlines", "x" * 200, "x" * 1_000_000,
)  # fmt: skip
_NUMBER = re.compile(rb"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_TEXT = ("yaml", "json", "urdf", "obj", "off", "gltf", "dae", "mtl")


def spoil(name: str, content: bytes, random: Random) -> bytes:
    """Return a file with one to three mistakes in it."""
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        ways: list[Callable[[bytes, Random], bytes]] = [_bytes]
        ending = name.rpartition(".")[2]
        if ending in _TEXT or name.startswith("text."):
            ways += [_number, _lines]
        if ending == "yaml":
            ways += 5 * [_yaml]
        elif ending in ("json", "gltf"):
            ways += 5 * [_json]
        elif ending in ("urdf", "dae"):
            ways += 5 * [_xml]
        content = random.choice(ways)(content, random)
    return content


def _bytes(content: bytes, random: Random) -> bytes:
    """Flip, insert, remove, repeat or cut bytes."""
    if not content:
        return random.randbytes(random.randrange(100))
    spoilt = bytearray(content)
    place = random.randrange(len(spoilt))
    match random.randrange(7):
        case 0:
            for _ in range(random.choice((1, 1, 4, 40))):
                spoilt[random.randrange(len(spoilt))] ^= 1 << random.randrange(8)
        case 1:
            spoilt[place:place] = random.randbytes(random.choice((1, 4, 100)))
        case 2:
            del spoilt[place : place + random.choice((1, 4, 100))]
        case 3:
            del spoilt[place:]
        case 4:
            part = spoilt[place : place + random.choice((1, 10, 200))]
            spoilt[place:place] = part * random.choice((1, 10, 1000))
        case 5:
            spoilt[place : place + 4] = random.choice((b"\xff\xff\xff\x7f", bytes(4), b"\xff" * 4))
        case _:
            spoilt[place:place] = random.choice((b"[", b"{", b"<a>", b"(", b"- ", b"? ")) * 3000
    return bytes(spoilt)


def _number(content: bytes, random: Random) -> bytes:
    """Write another number, or a word, where one stands."""
    found = list(_NUMBER.finditer(content))
    if not found:
        return content
    hit = random.choice(found)
    new = str(random.choice((*NUMBERS, *WORDS[:4]))).encode("utf-8", "replace")
    return content[: hit.start()] + new + content[hit.end() :]


def _lines(content: bytes, random: Random) -> bytes:
    """Repeat, remove, swap or indent lines."""
    lines = content.split(b"\n")
    place = random.randrange(len(lines))
    match random.randrange(4):
        case 0:
            lines[place:place] = [lines[place]] * random.choice((1, 1, 100))
        case 1:
            del lines[place]
        case 2:
            other = random.randrange(len(lines))
            lines[place], lines[other] = lines[other], lines[place]
        case _:
            lines[place] = random.choice((b"  ", b"\t", b"- ", b"&a ", b"*a ")) + lines[place]
    return b"\n".join(lines)


def _yaml(content: bytes, random: Random) -> bytes:
    try:
        data = yaml.safe_load(content)
    except (yaml.YAMLError, ValueError, RecursionError):
        return _bytes(content, random)
    spoilt = _tree(data, random)
    return yaml.safe_dump(spoilt, sort_keys=False, allow_unicode=True).encode("utf-8", "replace")


def _json(content: bytes, random: Random) -> bytes:
    try:
        data = json.loads(content)
    except (ValueError, RecursionError):
        return _bytes(content, random)
    return json.dumps(_tree(data, random)).encode("utf-8", "replace")


def _places(data: Any, place: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return where every value of a tree stands."""
    found = [place]
    if isinstance(data, dict | list):
        items = data.items() if isinstance(data, dict) else enumerate(data)
        for key, value in items:
            found += _places(value, (*place, key))
    return found


def _tree(data: Any, random: Random) -> Any:
    """Return a tree with one value, key or part spoilt."""
    data = copy.deepcopy(data)
    places = [place for place in _places(data) if place]
    if not places:
        return random.choice(WORDS)
    place = random.choice(places)
    parent = data
    for key in place[:-1]:
        parent = parent[key]
    key, value = place[-1], parent[place[-1]]
    if isinstance(value, int | float) and not isinstance(value, bool) and random.random() < 0.7:
        parent[key] = random.choice(NUMBERS)
        return data
    match random.randrange(9):
        case 0:
            del parent[key]
        case 1 | 2:
            parent[key] = random.choice((*NUMBERS, *WORDS))
        case 3 if isinstance(parent, dict):
            parent[f"{key}x"] = parent.pop(key)
        case 4:
            for _ in range(random.choice((1, 20, 70))):
                parent[key] = {"a": parent[key]} if random.random() < 0.5 else [parent[key]]
        case 5 if isinstance(value, list):
            parent[key] = value * random.choice((2, 30, 500))
        case 6:
            _scale(parent[key] if isinstance(value, dict | list) else parent, random)
        case 7:
            other = random.choice(places)
            source = data
            for step in other:
                source = source[step]
            parent[key] = copy.deepcopy(source)
        case _ if isinstance(parent, dict):
            parent.update({f"key_{i}": i for i in range(random.choice((1, 50, 3000)))})
    return data


def _scale(data: Any, random: Random) -> None:
    """Multiply all numbers of a part."""
    factor = random.choice((1e-300, 1e-9, 1e-3, 1e3, 1e9, 1e300, -1, 0))
    stack = [data]
    while stack:
        part = stack.pop()
        items = list(part.items()) if isinstance(part, dict) else list(enumerate(part))
        for key, value in items:
            if isinstance(value, float | int) and not isinstance(value, bool):
                try:
                    part[key] = value * factor
                except OverflowError:
                    part[key] = factor
            elif isinstance(value, dict | list):
                stack.append(value)


def _xml(content: bytes, random: Random) -> bytes:
    """Spoil an element: its attributes, its text, its place."""
    try:
        root = ET.fromstring(content)  # noqa: S314 - our own file
    except (ET.ParseError, ValueError):
        return _bytes(content, random)
    pairs = [(parent, child) for parent in root.iter() for child in parent]
    if not pairs:
        return _bytes(content, random)
    parent, child = random.choice(pairs)
    match random.randrange(8):
        case 0:
            parent.remove(child)
        case 1:
            for _ in range(random.choice((1, 1, 50))):
                parent.append(copy.deepcopy(child))
        case 2:
            child.tag = random.choice(("robot", "link", "joint", "mesh", "box", "x", "origin"))
        case 3:
            for _ in range(random.choice((1, 90, 2000))):
                inner = ET.Element(child.tag, child.attrib)
                inner.append(child)
                child = inner
            parent.append(child)
        case 4 if child.text:
            child.text = _number(child.text.encode(), random).decode("utf-8", "replace")
        case 5 if child.attrib:
            del child.attrib[random.choice(list(child.attrib))]
        case _ if child.attrib:
            name = random.choice(list(child.attrib))
            words = child.attrib[name].split() or [""]
            new = random.choice((*NUMBERS, *(word for word in WORDS if isinstance(word, str))))
            words[random.randrange(len(words))] = re.sub("[\x00-\x1f]", "", str(new))
            child.attrib[name] = " ".join(words)
    try:
        return ET.tostring(root)
    except RecursionError:
        return content
