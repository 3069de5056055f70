"""Random changes of files, the same for the same seed: of bytes, of words and lines, and of JSON documents."""

from __future__ import annotations

import json
import random
import re
from collections.abc import Callable, Sequence
from copy import deepcopy
from typing import Any

#: numbers and words that readers tend to get wrong
WORDS = (
    "nan", "inf", "-inf", "1e999", "-1", "0", "-0.0", "1e-320", "1e308", "99999999999999999999999", "1_000_000_000",
    "9" * 5000, "0x10", "", "\u0663", "\u22121", "1D-3", "1e", "true", "null", "{}", "[]", "2147483648",
    "1000000000",
    "9223372036854775808", "-9223372036854775809", '"', '"""', "'", "&", "$", "${x}", "$(1/0)", "#", "\x1b[31m", "\0",
    "\r",
    "/dev/zero", "/etc/passwd", "../../../etc/passwd", "a" * 3000, "(" * 2000, "[" * 3000, "1:1000000000", "*", "1*",
    "%s",
    "%999999999.3f", ",", ";", "\t", "=", "NULL", "id", "x", "vx", "time", "nan,nan",
)  # fmt: skip
#: values of JSON that readers tend to get wrong
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 1e308, -1e-320, 10**30, 10**400, 2**63, "", "x", "a" * 3000, [], {}, [[]], [None],
    {"": {}},
    [1, 2, 3], {"a": 1}, "\x1b[2J", "../../etc/passwd", 1.5, [1e308] * 3, [["a"]],
)  # fmt: skip

Rng = random.Random


def of_bytes(rng: Rng, data: bytes) -> bytes:
    """Return the data with a few bytes changed, inserted, left out or repeated."""
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 4, 16))):
        at, length = rng.randrange(len(out) + 1), rng.choice((1, 1, 2, 4, 8, 64, 1000))
        kind = rng.randrange(6)
        if kind == 0 and out:
            at = min(at, len(out) - 1)
            out[at] = rng.choice((0, 1, 127, 128, 255, out[at] ^ (1 << rng.randrange(8)), rng.randrange(256)))
        elif kind == 1:
            out[at:at] = rng.randbytes(length)
        elif kind == 2:
            del out[at : at + length]
        elif kind == 3:
            out[at:at] = out[at : at + length] * rng.choice((1, 2, 20))
        elif kind == 4:
            out[at : at + length] = rng.choice((b"\0", b"\xff", b"\x7f")) * length
        else:
            del out[at:]
    return bytes(out)


def of_words(rng: Rng, data: bytes) -> bytes:
    """Return the data with a few numbers, words or lines changed."""
    text = data.decode("utf-8", "surrogateescape")
    for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
        kind = rng.randrange(7)
        if kind <= 2:
            found = list(re.finditer(r"[-+]?\d[\d.eE+-]*" if kind == 0 else r"[^\s,:;=\"\[\]{}]+", text))
            if found:
                word = rng.choice(found)
                new = rng.choice(WORDS) if kind < 2 else rng.choice(found)[0]
                text = text[: word.start()] + new + text[word.end() :]
            continue
        lines = text.splitlines(keepends=True) or [""]
        at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
        if kind == 3:
            lines[at], lines[other] = lines[other], lines[at]
        elif kind == 4:
            lines[at:at] = [lines[other]] * rng.choice((1, 1, 3, 100))
        elif kind == 5:
            del lines[at : at + rng.choice((1, 1, 2, 10))]
        else:
            place = rng.randrange(len(lines[at]) + 1)
            lines[at] = lines[at][:place] + rng.choice(WORDS) + lines[at][place:]
        text = "".join(lines)
    return text.encode("utf-8", "surrogateescape")


def of_json(rng: Rng, data: bytes) -> bytes:
    """Return a JSON document with a few values, keys or entries changed; changed bytes if the data are no JSON."""
    try:
        document = json.loads(data)
    except ValueError:
        return of_bytes(rng, data)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        holders = _holders(document)
        if not holders:
            return json.dumps(rng.choice(VALUES)).encode()
        holder, key = rng.choice(holders)
        kind = rng.randrange(6)
        if kind <= 2:
            holder[key] = deepcopy(rng.choice(VALUES))  # or a later change would change all documents
        elif kind == 3:
            del holder[key]
        elif kind == 4:
            holder[key] = rng.choice((lambda value: [value], lambda value: {"a": value}, str))(holder[key])
        else:
            other, name = rng.choice(holders)
            if not _contains(other[name], holder):
                holder[key] = deepcopy(other[name])
    return json.dumps(document).encode()


def _holders(document: Any) -> list[tuple[Any, Any]]:
    """Return the objects and lists of a document, each with each of its keys."""
    waiting, found = [document], []
    while waiting:
        part = waiting.pop()
        keys = list(part) if isinstance(part, dict) else range(len(part)) if isinstance(part, list) else ()
        for key in keys:
            found.append((part, key))
            waiting.append(part[key])
    return found


def _contains(part: Any, holder: Any) -> bool:
    return part is holder or any(value is holder for value, _ in _holders(part))


def changed(seed: str, sources: Sequence[bytes], *, structure: Callable[[Rng, bytes], bytes]) -> bytes:
    """Return one of the sources, changed at random: its structure, its bytes, or its end, by that of another."""
    rng = random.Random(seed)
    data = rng.choice(sources)
    kind = rng.randrange(10)
    if kind < 6:
        return structure(rng, data)
    if kind == 6:
        other = rng.choice(sources)
        return data[: rng.randrange(len(data) + 1)] + other[rng.randrange(len(other) + 1) :]
    return of_bytes(rng, structure(rng, data) if kind == 7 else data)
