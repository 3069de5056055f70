"""Every benchmark of ``make bench`` is started here on a tiny case: it runs to its end and prints what it measures."""

from __future__ import annotations

import importlib
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.bench.history import BUDGETS

FOLDER = Path(__file__).parent
NAMES = sorted(file.stem for file in FOLDER.glob("bench_*.py"))
#: a line of each benchmark's output that only its last part prints; numbers in it are of the machine
LAST_LINES = {
    "bench_backends": r"dem-bridge --help .*\d",
    "bench_bars": r"blanes-moan .*crossing_time .* 2 .*100\.00 %",
    "bench_campaign": r"Dask, 4 runs of the twin: .* % of linear",
    "bench_ensembles": r"bare LAMMPS at dt = 1e-07 s: \d",
    "bench_horizon": r"2e\+04 steps, and all else: \d+ s",
    "bench_integrators": r"1e-04 .*blanes-moan, alone|blanes-moan, alone .*\d",
    "bench_lammps": r"drag, LAMMPS - twin; order .*\d\.\de-\d\d; -?\d",
    "bench_paper": r"verify tiny: \d+\.\d s, again \d+\.\d s",
    "bench_plan": r"lammps-granular .*0\.01 ",
    "bench_studies": r"energy +\d+\.\d +\d+\.\d",
    "bench_scale": r"64 chains on 2 processes: \d.* predicted, .* measured, ratio \d",
}
#: its exit code says whether numbers are as they must be, also on the tiny case (others judge times or many scenes)
EXACT = "bench_horizon"


def test_make_bench_runs_every_benchmark() -> None:
    makefile = (FOLDER.parents[1] / "Makefile").read_text(encoding="utf-8")
    assert re.findall(r"-m tests\.bench\.(\w+)", makefile) == ["history"]
    assert sorted(BUDGETS) == NAMES == sorted(LAST_LINES)


#: the benchmarks that take 2 to 10 s of CPU on their tiny case; `make test-all` starts these too
DEEP = ("bench_backends", "bench_campaign", "bench_horizon", "bench_lammps", "bench_paper", "bench_plan", "bench_scale",
        "bench_studies")  # fmt: skip


@pytest.mark.lammps
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name in DEEP else name for name in NAMES]
)
def test_a_benchmark_runs_to_its_end_on_a_tiny_case(name: str, capfd: pytest.CaptureFixture[str]) -> None:
    if name == "bench_integrators" and shutil.which("cc") is None:
        pytest.skip("no C compiler")
    main: Callable[..., int] = importlib.import_module(f"tests.bench.{name}").main
    code = main(tiny=True)
    output = capfd.readouterr().out
    assert re.search(LAST_LINES[name], output), output
    assert (code == 0) if name == EXACT else code in (0, 1)
