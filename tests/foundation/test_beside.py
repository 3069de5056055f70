"""Functions are called in another process, which repeats nothing of this program and does not outlive it."""

from __future__ import annotations

import io
import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from dem_bridge.foundation import beside_child
from dem_bridge.foundation.beside import Beside, Unanswered, packed
from tests.helpers.beside_functions import about, fail, imported, sleep, talk
from tests.helpers.processes import all_end, running


@pytest.fixture
def beside() -> Iterator[Beside]:
    process = Beside("colorsys")
    yield process
    process.end()


def _asked(process: Beside, function: Callable[..., Any], *arguments: Any) -> Callable[[], Any]:
    question = packed(function, *arguments)
    assert question is not None
    return process.ask(question)


def test_functions_are_called_in_one_other_process_in_their_order(beside: Beside) -> None:
    large = os.urandom(10**6)  # more than a pipe takes
    answers = [_asked(beside, about, n, large) for n in range(3)]
    (pid, first), *others = [answer() for answer in reversed(answers)]
    assert pid != os.getpid()
    assert first == (2, large)
    assert others == [(pid, (1, large)), (pid, (0, large))]
    assert answers[0]() == others[1]  # it can be asked again


def test_it_imports_what_is_named_and_what_it_prints_is_no_answer(beside: Beside) -> None:
    assert _asked(beside, talk)() == "word"
    assert [_asked(beside, imported, name)() for name in ("colorsys", "wave")] == [True, False]


def test_an_error_there_is_no_answer_and_the_next_question_has_one(beside: Beside) -> None:
    failed, fine = _asked(beside, fail, "for a reason"), _asked(beside, about)
    with pytest.raises(Unanswered, match=r"^ValueError: for a reason$"):
        failed()
    assert fine()[1] == ()


def test_what_cannot_go_there_is_not_packed() -> None:
    assert packed(lambda: None) is None
    assert packed(about, sys) is None
    assert pickle.loads(packed(about, 1) or b"") == (about, (1,))


def test_a_process_that_is_ended_answers_nothing_more() -> None:
    beside = Beside()
    pid, _ = _asked(beside, about)()
    waiting = [_asked(beside, sleep), _asked(beside, about)]
    beside.end()
    assert running([pid]) == []
    for answer in waiting:
        with pytest.raises(Unanswered):
            answer()


def test_a_process_that_dies_answers_nothing_more(beside: Beside) -> None:
    for _ in range(2):
        with pytest.raises(Unanswered):
            _asked(beside, os._exit, 3)()


PROGRAM = """
import os, sys, time
from dem_bridge.foundation.beside import Beside, packed
from tests.helpers.beside_functions import about, sleep
print("begins", flush=True)
class Mine:
    pass
beside = Beside()
print(beside.ask(packed(about))()[0], flush=True)
try:
    beside.ask(packed(about, Mine()))()
except Exception as error:
    print(type(error).__name__, flush=True)
{asked}
sys.stdin.readline()
os.kill(os.getpid(), 9)
"""


@pytest.mark.parametrize("asked", ["", "beside.ask(packed(time.sleep, 0.2)); time.sleep(0.1)"], ids=["idle", "busy"])
def test_the_program_is_not_run_again_and_is_not_outlived(asked: str, tmp_path: Path) -> None:
    file = tmp_path / "program.py"
    file.write_text(PROGRAM.format(asked=asked))
    with subprocess.Popen(
        [sys.executable, str(file)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    ) as program:
        assert program.stdin is not None
        assert program.stdout is not None
        begins, pid, error = (program.stdout.readline().strip() for _ in range(3))
        assert (begins, error) == ("begins", "Unanswered")
        assert running([int(pid)]) == [int(pid)]
        program.stdin.write("\n")
        program.stdin.close()
        assert program.stdout.read() == ""
        assert program.wait() == -9
    assert all_end([int(pid)])


def test_the_script_answers_until_its_input_ends() -> None:
    questions = [packed(about, 1), packed(fail, "why"), b"no pickle"]
    answers = io.BytesIO()
    beside_child.serve(
        io.BytesIO(b"".join(len(each or b"").to_bytes(8, "little") + (each or b"") for each in questions)), answers
    )
    answers.seek(0)
    values = [pickle.loads(answers.read(int.from_bytes(answers.read(8), "little"))) for _ in questions]
    assert values[:2] == [(True, (os.getpid(), (1,))), (False, "ValueError: why")]
    assert (values[2][0], answers.read()) == (False, b"")
