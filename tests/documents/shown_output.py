"""Whether a command still prints what a page shows."""

from __future__ import annotations

import re

# A number that is not part of a name: joint_3.0 stays text.
_NUMBER = re.compile(r"(?<![\w.])[+-]?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w])")
# The signs of a virtual sliding, the last column: arbitrary along a tangent without friction.
_SIGNS = re.compile(r" [-+.]{2}$")
# Counts of a search hang on the last bits, and times on the machine.
_COUNTS = re.compile(r"\d+(?= (?:LPs?|programs?|nodes?|modes?|sets of outcomes)\b)")
_TIMES = re.compile(r"about \d+(?:\.\d+)? (?:s|min)\b")
_NOISE = 1e-6
_ANYTHING = "..."


def difference(shown: str, printed: str) -> str:
    """Say where the printed text is not the one shown; empty where it is.

    A line ``...`` stands for any lines, ``...`` inside a line for any text. Numbers may differ by
    one in the last digit that is shown; numbers like 3e-12, the rest of a rounding, by anything
    that is as small. Blanks and the length of rules are those of a table and do not count, nor do
    the signs of a mode at the end of a line, how many programs a search took, and how long one
    would take.
    """
    expected, actual = _lines(shown), _lines(printed)
    position, skipping = 0, False
    for line in expected:
        if line == _ANYTHING:
            skipping = True
            continue
        if not skipping and position == len(actual):
            return f"not printed any more: {line!r}"
        places = range(position, len(actual)) if skipping else [position]
        hit = next((i for i in places if _same(line, actual[i])), None)
        if hit is None:
            now = "nothing like it" if skipping else repr(actual[position])
            return f"shown: {line!r}\nprinted: {now}"
        position, skipping = hit + 1, False
    if position < len(actual) and not skipping:
        return f"printed and not shown: {actual[position]!r}"
    return ""


def _lines(text: str) -> list[str]:
    plain = (re.sub(r"-{3,}", "---", " ".join(line.split())) for line in text.splitlines())
    timeless = (_TIMES.sub("about some time", _COUNTS.sub("some", line)) for line in plain)
    return [_SIGNS.sub(" signs", line) for line in timeless if line]


def _same(shown: str, printed: str) -> bool:
    if _ANYTHING in shown:
        pieces = (re.escape(piece) for piece in shown.split(_ANYTHING))
        return re.fullmatch(".*".join(pieces), printed) is not None
    if _NUMBER.sub("#", shown) != _NUMBER.sub("#", printed):
        return False
    return all(map(_close, _NUMBER.findall(shown), _NUMBER.findall(printed)))


def _close(shown: str, printed: str) -> bool:
    a, b = float(shown), float(printed)
    if "e" in shown and max(abs(a), abs(b)) < _NOISE:
        return True
    mantissa, _, exponent = shown.partition("e")
    digits = len(mantissa.partition(".")[2])
    return abs(a - b) <= 1.01 * 10.0 ** (int(exponent or 0) - digits) * ("." in mantissa)
