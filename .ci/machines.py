"""Run the tests as other machines would: ``make machines`` writes the tables "machines" of docs/quality.md.

    make machines                              # the digit parts (DIGITS) under each setting
    make machines ARGS="--whole"               # the whole suite under three settings (WHOLE)
    make machines ARGS="--setting old --check" # one setting; nothing is written into the page

A setting changes the last digits, the threads or the order of sets. One that changes nothing where it should is skipped
with the reason. Results without failures are kept in ``reports/latest/machines`` until the code changes, so that an
interrupted matrix goes on; ``--fresh`` runs all again. The code must not be edited meanwhile. Exit codes: 0, and 1
where a test failed.
"""

from __future__ import annotations

import argparse
import datetime
import hashlib
import json
import os
import re
import resource
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from quality import PAGE, write_rows

ROOT = PAGE.parent.parent
FOLDER = ROOT / "reports" / "latest" / "machines"
LIBM, PROBE = (Path(__file__).with_name(name) for name in ("other_libm.c", "machine_probe.py"))
_PARTS = ("runs/uncertainty", "backends", "judging", "verification/regression", "observables", "physics")
#: the tests whose subject is digits, and the examples of what they test
DIGITS = (*(f"{room}/{part}" for room in ("tests", "dem_bridge") for part in _PARTS),)
#: libraries whose digits are compared with those of this machine as it is
PROBES = ("libm", "numpy", "dot", "solve", "kernel")
#: variables that the digits of machine code depend on, for calls of libm with constants are made by the compiler
_COMPILED = ("NUMBA_CPU_NAME", "GLIBC_TUNABLES", "LD_PRELOAD", "DEM_BRIDGE_OTHER_LIBM")


@dataclass(frozen=True)
class Setting:
    """One other machine."""

    name: str
    title: str
    variables: Mapping[str, str] = field(default_factory=dict)
    changes: tuple[str, ...] = ()
    """Probes of which at least one must change its digits; otherwise this machine does not take the setting."""
    lacks: str = ""
    """Why the setting cannot be made here."""


@dataclass(frozen=True)
class Outcome:
    """Count the tests of one setting."""

    changed: tuple[str, ...] = ()
    passed: int = 0
    failures: tuple[str, ...] = ()
    skipped: int = 0
    cpu: float = 0.0
    reason: str = ""
    """Why the setting was skipped."""

    def cells(self, processor: str) -> tuple[str, ...]:
        """Return the cells of a row of the table, without the name of the setting.

        >>> Outcome(("libm", "dot"), 7, ("t.py::test_a",), 1, 3.2).cells("znver5")[:-1]
        ('libm, dot', '7', '1', '1', '3', 'znver5')
        >>> Outcome(reason="no glibc").cells("znver5")[:-1]
        ('not run: no glibc', '-', '-', '-', '-', 'znver5')
        """
        counts = (str(self.passed), str(len(self.failures)), str(self.skipped), f"{self.cpu:.0f}")
        ran = (", ".join(self.changed) or "none", *counts)
        return (
            *((f"not run: {self.reason}", "-", "-", "-", "-") if self.reason else ran),
            processor,
            datetime.date.today().isoformat(),
        )


def settings(dispatched: Sequence[str], libm: str) -> list[Setting]:
    """Return all settings, from the features that numpy dispatches and has here, and the path of :data:`LIBM` built.

    >>> by_name = {setting.name: setting for setting in settings(["X86_V3", "X86_V4"], "")}
    >>> by_name["avx2"].variables
    {'NPY_DISABLE_CPU_FEATURES': 'X86_V4'}
    >>> by_name["libm-1"].lacks
    'no compiler of C for .ci/other_libm.c'
    """
    numpy = {"NPY_DISABLE_CPU_FEATURES": " ".join(dispatched)}
    above = {"NPY_DISABLE_CPU_FEATURES": " ".join(name for name in dispatched if re.match("AVX512|X86_V4", name))}
    generic, glibc = {"NUMBA_CPU_NAME": "generic"}, {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA"}
    prescott, nehalem = ({"OPENBLAS_CORETYPE": core} for core in ("Prescott", "Nehalem"))
    one, four = ({"OMP_NUM_THREADS": count, "OPENBLAS_NUM_THREADS": count} for count in "14")
    first, second, third = ({"LD_PRELOAD": libm, "DEM_BRIDGE_OTHER_LIBM": seed} for seed in "123")
    absent = "" if libm else f"no compiler of C for .ci/{LIBM.name}"
    same = "" if numpy["NPY_DISABLE_CPU_FEATURES"] else "numpy has no features to switch off here"
    avx2 = "" if above["NPY_DISABLE_CPU_FEATURES"] else "numpy has no features above AVX2 here"
    return [
        Setting("plain", "this machine"),
        Setting("numpy", "numpy without dispatched features", numpy, ("numpy",), same),
        Setting("avx2", "numpy without features above AVX2", above, ("numpy",), avx2),
        Setting("numba", "kernels for a generic processor", generic),
        Setting("glibc", "glibc without AVX2 and FMA", glibc, ("libm",)),
        Setting("prescott", "OpenBLAS for Prescott", prescott, ("dot", "solve")),
        Setting("nehalem", "OpenBLAS for Nehalem", nehalem, ("dot", "solve")),
        Setting("omp-1", "1 thread of OpenMP", one),
        Setting("omp-4", "4 threads of OpenMP", four),
        *(Setting(f"hash-{seed}", f"PYTHONHASHSEED {seed}", {"PYTHONHASHSEED": seed}) for seed in ("0", "1", "4242")),
        Setting("libm-1", "another libm, 1", first, ("libm",), absent),
        Setting("libm-2", "another libm, 2", second, ("libm",), absent),
        Setting("old", "old processor", {**numpy, **generic, **glibc, **prescott}, PROBES[:4]),
        Setting(
            "other", "old processor with another libm", {**numpy, **generic, **nehalem, **third}, PROBES[:4], absent
        ),
    ]


#: what is run before the tests, which would compile kernels in each of their processes
PREPARE: tuple[Sequence[str], ...] = (["tests.helpers.compile_kernels"],)
#: the settings of the whole suite
WHOLE = ("old", "other", "avx2")


def build_libm(folder: Path) -> str:
    """Return the path of the compiled :data:`LIBM`, or "" where it cannot be compiled."""
    target = folder / "other_libm.so"
    words = ["cc", "-O2", "-fPIC", "-shared", "-fno-builtin", "-o", str(target), str(LIBM), "-lm", "-ldl"]
    try:
        built = sys.platform == "linux" and subprocess.run(words, capture_output=True, check=False).returncode == 0
    except OSError:
        built = False
    return str(target) if built else ""


def child_probe(variables: Mapping[str, str]) -> dict[str, Any]:
    """Return the probe of a process with these variables, and the complaints of libraries about them."""
    words = [sys.executable, "-W", "error::ImportWarning", str(PROBE)]
    done = subprocess.run(words, env={**os.environ, **variables}, capture_output=True, text=True, check=False)
    return {"complaint": " ".join(done.stderr.split())[-120:], **({} if done.returncode else json.loads(done.stdout))}


def try_setting(setting: Setting, targets: Sequence[str], folder: Path, here: Mapping[str, Any]) -> Outcome:
    """Return what the tests find under a setting, or why this machine does not take it."""
    if setting.lacks:
        return Outcome(reason=setting.lacks)
    there = child_probe(setting.variables)
    if there["complaint"] != here["complaint"] or "digests" not in there:
        return Outcome(reason=there["complaint"])
    changed = tuple(name for name in PROBES if there["digests"][name] != here["digests"][name])
    if setting.changes and not set(changed) & set(setting.changes):
        return Outcome(reason=f"it changes no digit of {' or '.join(setting.changes)} here")
    began = _cpu()
    cases = _run_tests(setting, targets, folder)
    failed = [case for case in cases if case.find("failure") is not None or case.find("error") is not None]
    names = [f"{case.get('classname')}::{case.get('name')}" for case in failed] if cases else ["no test ran"]
    skipped = sum(case.find("skipped") is not None for case in cases)
    return Outcome(changed, len(cases) - len(failed) - skipped, tuple(names), skipped, _cpu() - began)


def _run_tests(setting: Setting, targets: Sequence[str], folder: Path) -> list[ElementTree.Element]:
    """Return the test cases of pytest's report; what it prints is kept beside it."""
    compiled = "".join(f"{name}={setting.variables.get(name, '')};" for name in _COMPILED)
    kernels = folder / f"kernels-{hashlib.sha256(compiled.encode()).hexdigest()[:12]}"
    variables = {**os.environ, "NUMBA_CACHE_DIR": str(kernels), **setting.variables}
    report, log = folder / f"{setting.name}.xml", folder / f"{setting.name}.log"
    report.unlink(missing_ok=True)
    tests = ["pytest", *targets, "-m", "not slow", "-n", "auto", "-q", "--junitxml", str(report)]
    with log.open("w", encoding="utf-8") as stream:
        for words in (*PREPARE, tests):
            command = [sys.executable, "-m", *words]
            subprocess.run(command, cwd=ROOT, env=variables, stdout=stream, stderr=stream, check=False)
    return list(ElementTree.parse(report).iter("testcase")) if report.exists() else []


def _cpu() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def code_digest() -> str:
    """Return a digest of the package and of the tests."""
    listed = ["git", "ls-files", "-co", "--exclude-standard", "dem_bridge", "tests", "pyproject.toml"]
    names = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    paths = [ROOT / name for name in sorted(names) if (ROOT / name).is_file()]
    return hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()


def run_matrix(chosen: Sequence[Setting], options: argparse.Namespace, here: Mapping[str, Any]) -> int:
    """Run the settings that have no result of this code yet, and write a row for each at once; return the failures."""
    kept = options.folder / "results.json"
    results = json.loads(kept.read_text(encoding="utf-8")) if kept.exists() else {}
    processor, failures = f"{here['processor']}, {here['libc']}", 0
    for setting in chosen:
        title = setting.title + (" (whole suite)" if options.whole else "")
        key = json.dumps([title, processor, here["versions"], code_digest()])
        if key in results and not options.fresh:
            outcome = Outcome(**results[key])
        else:
            outcome = try_setting(setting, () if options.whole else DIGITS, options.folder, here)
            if not outcome.failures:
                results[key] = asdict(outcome)
                kept.write_text(json.dumps(results), encoding="utf-8")
        cells = (title, *outcome.cells(processor))
        if not options.check:
            write_rows("machines", [cells])
        print("  ".join(cells), *outcome.failures, sep="\n  ", flush=True)
        failures += len(outcome.failures)
    return failures


def main() -> int:
    """Run the chosen settings."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--setting", action="append", metavar="NAME", help="one or several; default: all of them")
    parser.add_argument("--whole", action="store_true", help="the whole suite; default: under three settings")
    parser.add_argument("--check", action="store_true", help="write nothing into docs/quality.md")
    parser.add_argument("--fresh", action="store_true", help="run again what has a result")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="where results and compiled kernels are kept")
    options = parser.parse_args()
    # a job in the background ignores Ctrl-C, and so would the tests that send it
    signal.signal(signal.SIGINT, signal.default_int_handler)
    options.folder.mkdir(parents=True, exist_ok=True)
    here = child_probe({})
    if "digests" not in here:
        parser.error(here["complaint"])
    every = {setting.name: setting for setting in settings(here["features"], build_libm(options.folder))}
    names = options.setting or (WHOLE if options.whole else list(every))
    if unknown := sorted(set(names) - set(every)):
        parser.error(f"there are no settings {unknown}; allowed: {', '.join(every)}")
    if not options.check:
        features = " ".join(here["features"]) or "none"
        row = (here["processor"], features, here["libc"], here["versions"], datetime.date.today().isoformat())
        write_rows("processors", [row])
    return int(run_matrix([every[name] for name in names], options, here) > 0)


if __name__ == "__main__":
    sys.exit(main())
