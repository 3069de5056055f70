"""Script of the process of :mod:`.beside`: ``python beside_child.py SYS_PATH_AS_JSON [MODULE ...]``.

A question is a pickle of a function and its arguments after its length in 8 bytes, and so is the answer: True and the
value, or False and the error in words. It ends with its input. It imports nothing from dem_bridge by itself.
"""

from __future__ import annotations

import gc
import importlib
import json
import os
import pickle
import sys
from typing import Any, BinaryIO


def answer(question: bytes) -> bytes:
    """Return the answer to a question."""
    try:
        function, arguments = pickle.loads(question)
        return pickle.dumps((True, function(*arguments)), protocol=5)
    except Exception as error:
        return pickle.dumps((False, f"{type(error).__name__}: {error}"))


def serve(questions: BinaryIO, answers: BinaryIO) -> None:
    """Answer questions until there are no more."""
    while len(head := questions.read(8)) == 8:
        reply = answer(questions.read(int.from_bytes(head, "little")))
        answers.write(len(reply).to_bytes(8, "little") + reply)
        answers.flush()


def main(path: str, *modules: str) -> None:
    """Import modules, and serve until the parent ends."""
    gc.set_threshold(100_000)  # otherwise a tenth of the time of an import is a search for garbage
    sys.path[:] = json.loads(path)
    answers: Any = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no answer
    for name in modules:
        importlib.import_module(name)
    serve(sys.stdin.buffer, answers)


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except BrokenPipeError:  # the parent has ended
        os._exit(1)
    os._exit(0)
