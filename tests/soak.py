"""A day's work in an hour: campaigns that are disturbed again and again, and what is left of them.

``make soak`` works for an hour, ``python -m tests.soak --minutes 15 --seed 3`` for as long as it is told. Every round
takes one of the disturbances below, a new store and the cases of :mod:`tests.helpers.survival`; after the disturbances
a last campaign must end complete. The program itself is the parent of a campaign in every round, of which a worker is
killed, and measures its own memory. Figures go into docs/quality.md with ``--write``.
"""

from __future__ import annotations

import argparse
import gc
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.runs import inspect
from dem_bridge.runs.campaign import run_cases
from dem_bridge.runs.case import Case
from dem_bridge.runs.keys import _MOST_DETERMINED
from dem_bridge.runs.store import DAMAGED, SUFFIX, Store
from tests.helpers.processes import happens
from tests.helpers.survival import ROOT, Survival, content
from tests.helpers.three_bodies import THREE

#: cases of a campaign, and of the campaign of this program in every round
CASES, OWN_CASES = 12, 40
#: s, at most, from the end of a run to a disturbance
_MOMENT = 1.0
#: two users without rights, one of whom keeps its files to itself
_USERS = ((54321, 0o022), (54322, 0o077))
_DAY = 86_400.0
_PACKAGES = sysconfig.get_path("purelib")


@dataclass
class Round:
    """Campaigns over one new store, and what happens to them."""

    survival: Survival
    draw: random.Random
    campaigns: int = 0
    kills: int = 0
    """Kills of a campaign or of one process of it."""
    damaged: set[str] = field(default_factory=set)
    """Entries that were damaged on purpose."""
    again: int = 0
    """Runs that a disturbance lets a later campaign make again."""
    variables: dict[str, str] = field(default_factory=dict)
    """Of the environment of the campaigns."""

    def begin(self, prepare: Callable[[], object] = int, **variables: str) -> subprocess.Popen[str]:
        """Start a campaign."""
        self.campaigns += 1
        return self.survival.begin(prepare=prepare, variables={**self.variables, **variables})

    def finish(self, program: subprocess.Popen[str]) -> dict[str, object]:
        """Wait for a campaign that ends by itself, and return what it prints."""
        return self.survival.finish(program)

    def wait(self, program: subprocess.Popen[str]) -> None:
        """Wait for a random moment, or until the campaign ends."""
        moment = self.draw.uniform(0.0, _MOMENT)
        ended = self.draw.randint(1, CASES // 2) + self.survival.counted("end")
        happens(lambda: program.poll() is not None or self.survival.counted("end") >= ended)
        with suppress(subprocess.TimeoutExpired):
            program.wait(moment)

    def kill(self, program: subprocess.Popen[str], *, whole: bool | None = None) -> None:
        """Kill a campaign, or its main process only."""
        self.survival.killed |= {program.pid, *self.survival.processes()}
        with suppress(ProcessLookupError):
            (os.killpg if whole or self.draw.random() < 0.5 else os.kill)(program.pid, signal.SIGKILL)
        self.kills += 1
        program.communicate()

    def interrupt(self, program: subprocess.Popen[str]) -> None:
        """Press Ctrl-C once or twice."""
        for _ in range(self.draw.randint(1, 2)):
            with suppress(ProcessLookupError):
                program.send_signal(signal.SIGINT)
            with suppress(subprocess.TimeoutExpired):
                program.wait(self.draw.uniform(0.0, 1.0))
        self.kills += 1  # a second Ctrl-C stops what runs
        program.communicate()

    def entries(self) -> list[Path]:
        """Return the entries of the store."""
        return sorted(self.survival.store.glob(f"*{SUFFIX}"))


def killed_parent(case: Round) -> None:
    """campaign killed, with its workers or without"""
    for _ in range(case.draw.randint(1, 3)):
        program = case.begin()
        case.wait(program)
        case.kill(program)


def killed_worker(case: Round) -> None:
    """worker or engine killed"""
    program = case.begin()
    case.wait(program)
    others = [pid for pid in _workers(case.survival.processes()) if pid != program.pid]
    if others:
        victim = case.draw.choice(others)
        case.survival.killed |= set(others)
        with suppress(ProcessLookupError):
            os.kill(victim, signal.SIGKILL)
        case.kills += 1
    case.finish(program)


def _workers(processes: Sequence[int]) -> list[int]:
    """Return processes without that of multiprocessing which counts its resources and says so when it is killed."""
    return [pid for pid in processes if b"resource_tracker" not in content(Path(f"/proc/{pid}/cmdline"))]


def interrupted(case: Round) -> None:
    """Ctrl-C once or twice"""
    program = case.begin()
    case.wait(program)
    case.interrupt(program)


def beside_another(case: Round) -> None:
    """two campaigns over one store, one killed"""
    programs = [case.begin() for _ in range(2)]
    case.wait(programs[0])
    case.kill(programs[0], whole=True)
    case.finish(programs[1])


def damaged_entries(case: Round) -> None:
    """random entries damaged, cut, emptied or deleted"""
    case.finish(case.begin())
    for path in case.draw.sample(case.entries(), case.draw.randint(1, CASES)):
        content = bytearray(path.read_bytes())
        kind = case.draw.randrange(4)
        if kind == 0:
            content[case.draw.randrange(len(content))] ^= 1 << case.draw.randrange(8)
        elif kind == 1:
            del content[case.draw.randrange(len(content)) :]
        elif kind == 2:
            content[:] = bytes(len(content))
        case.again += 1
        if kind == 3:
            path.unlink()
        else:
            path.write_bytes(content)
            case.damaged.add(path.stem)


def full_disk(case: Round) -> None:
    """store without room: small tmpfs, or a limit of the size of files"""
    store = case.survival.store
    store.mkdir()
    # an entry takes 8 kB or more: some fit on the disk, and none into a file of less
    mount = ["mount", "-t", "tmpfs", "-o", f"size={case.draw.randint(16, 60)}k", "tmpfs", str(store)]
    mounted = case.draw.random() < 0.5 and subprocess.run(mount, check=False, capture_output=True).returncode == 0
    limit = 1000 * case.draw.randint(1, 3)  # with 0 the runs themselves cannot be counted
    try:
        end = case.finish(case.begin(int if mounted else partial(_limit_files, limit)))
        assert end["runs"] == CASES, end
        assert "nothing is stored" in str(end["trouble"]), end
        kept, damaged = inspect.check(Store(store))
        assert damaged == []
        case.again += CASES - kept
        kept_files = {path.name: path.read_bytes() for path in case.entries()}
        assert _beside(case.survival, set()) == []
    finally:
        if mounted:
            subprocess.run(["umount", str(store)], check=True)
    for name, entry in kept_files.items():
        (store / name).write_bytes(entry)


def _limit_files(size: int) -> None:
    """Let no file of this process grow beyond a size, bytes; a write then fails as on a full disk."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


def clock_set_back(case: Round) -> None:
    """clock set back: all files are from the future"""
    program = case.begin()
    case.wait(program)
    case.kill(program)
    _shift(case, case.draw.choice([60.0, _DAY, 3650 * _DAY]))
    program = case.begin()
    case.wait(program)
    _shift(case, case.draw.choice([-3650 * _DAY, _DAY, 3650 * _DAY]))  # while it runs
    case.finish(program)
    # locks that it held then were taken for old: none, for it was alone
    store = Store(case.survival.store, limit=1)
    store.make_room()
    case.again += CASES - len(case.entries())


def _shift(case: Round, seconds: float) -> None:
    """Give all files of the store, temporary folders and shared memory another date."""
    date = time.time() + seconds
    shared = [path for pid in case.survival.killed for path in Path("/dev/shm").glob(f"mpich_shm_{pid:x}_*")]
    for path in (*case.survival.store.glob("*"), *case.survival.temporary.rglob("*"), *shared):
        with suppress(OSError):
            os.utime(path, (date, date), follow_symlinks=False)


def two_users(case: Round) -> None:
    """two users over one store, one with umask 077"""
    survival = case.survival
    survival.python = str(_python_of_others())
    case.variables = {"PYTHONPATH": os.pathsep.join([os.environ.get("PYTHONPATH", ""), _PACKAGES])}
    survival.store.mkdir()
    (survival.folder / "count").touch()
    survival.halt()
    for path in (survival.folder, survival.store, survival.temporary):
        path.chmod(0o777)
    (survival.folder / "count").chmod(0o666)
    programs = [case.begin(partial(_become, *user), HOME=str(_home(user[0]))) for user in _USERS]
    ends = [case.finish(program) for program in programs]
    assert all(end["runs"] == CASES for end in ends), ends
    # the first cannot read the entries of the second and makes them anew
    case.again += CASES


@cache
def _python_of_others() -> str | None:
    """Return a Python that users without rights can run with the packages of this one; None: there is none."""
    for python in (sys.executable, f"/usr/bin/python3.{sys.version_info.minor}"):
        with suppress(OSError, subprocess.CalledProcessError):
            subprocess.run(
                [python, "-c", "import numba, dem_bridge"],
                preexec_fn=partial(_become, *_USERS[0]),
                env={"PYTHONPATH": os.pathsep.join([str(ROOT), _PACKAGES])},
                capture_output=True,
                check=True,
            )
            return python
    return None


def _become(user: int, umask: int) -> None:
    """Be another user."""
    os.umask(umask)
    os.setgroups([])
    os.setgid(user)
    os.setuid(user)


def _home(user: int) -> Path:
    """Return a home of a user, in which kernels are compiled once."""
    home = Path(tempfile.gettempdir()) / f"dem-bridge-soak-home-{user}"
    home.mkdir(exist_ok=True)
    os.chown(home, user, user)
    return home


#: disturbances, by what they are called in the table
DISTURBANCES = (
    killed_parent,
    killed_worker,
    interrupted,
    beside_another,
    damaged_entries,
    full_disk,
    clock_set_back,
    two_users,
)


def _beside(survival: Survival, damaged: set[str]) -> list[str]:
    """Return what is left beside entries, and entries that were set aside though nobody damaged them."""
    return [name for name in survival.left() if not (name.endswith(DAMAGED) and name.removesuffix(DAMAGED) in damaged)]


@dataclass
class Figures:
    """What the rounds of one disturbance came to."""

    rounds: int = 0
    campaigns: int = 0
    kills: int = 0
    runs: int = 0
    lost: int = 0
    accepted: int = 0
    """Damaged entries that were taken for results, or other digits."""
    repeated: int = 0
    """Runs made again beyond those that were running."""
    left: int = 0
    """Files, shared memory and processes that remained."""
    errors: int = 0
    seconds: float = 0.0

    def row(self, name: str) -> list[str]:
        """Return the cells of the table."""
        numbers = (self.rounds, self.campaigns, self.kills, self.runs, self.lost, self.accepted, self.repeated)
        cells = (*numbers, self.left, self.errors, f"{self.seconds / 60:.1f}", time.strftime("%Y-%m-%d", time.gmtime()))
        return [name, *map(str, cells)]


def do_round(disturb: Callable[[Round], None], kind: str, seed: int, digest: object, figures: Figures) -> str:
    """Do one round; return what was wrong in a line, '' if nothing was."""
    began, folder = time.monotonic(), Path(tempfile.mkdtemp(prefix="dem-bridge-soak-"))
    folder.chmod(0o755)
    survival = Survival(folder / "round", CASES, kind=kind)
    case = Round(survival, random.Random(seed))
    wrong: list[str] = []
    try:
        disturb(case)
        end = case.finish(case.begin())
        figures.lost += (lost := CASES - int(str(end["runs"])))
        figures.accepted += (other := end["digest"] != digest)
        kept, damaged = inspect.check(Store(survival.store))
        figures.lost += CASES - kept
        figures.accepted += len(damaged)
        made, allowed = survival.counted("begin"), CASES + case.again + survival.jobs * case.kills
        figures.repeated += max(made - allowed, 0)
        assert survival.all_ended()
        figures.left += len(left := _beside(survival, case.damaged))
        figures.runs += made
        if lost or other or kept != CASES or damaged or made > allowed or left:
            wrong.append(f"{end}, kept {kept}, damaged {damaged}, made {made} of {allowed}, left {left}")
    except Exception:
        figures.errors += 1
        wrong.append(traceback.format_exc())
    finally:
        for pid in survival.processes():
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        if not wrong:
            shutil.rmtree(folder, ignore_errors=True)
    figures.rounds += 1
    figures.campaigns += case.campaigns
    figures.kills += case.kills
    figures.seconds += time.monotonic() - began
    return f"{disturb.__doc__}, {kind}, seed {seed}, {folder}: {'; '.join(wrong)}" if wrong else ""


def _own_cases(nth: int, count: int) -> list[Case]:
    """Return cases that differ from those of any other campaign."""
    scene = replace(THREE, samples=20, spacing=None)
    scenes = [replace(scene, name=f"n{k}", velocity=(5.0 + 1e-4 * nth + 1e-6 * k, 0.0, 0.0)) for k in range(count)]
    settings: dict[str, Any] = {"resolution": Resolution(dt=1e-8), "sampling": Sampling(count=20)}
    return [Case(scene=scene, backend="verlet", uncertainty=False, **settings) for scene in scenes]


def own_campaign(nth: int, draw: random.Random, folder: Path) -> float:
    """Run a campaign with this program as its parent, of which a worker is killed; return the memory in MB."""
    cases = _own_cases(nth, OWN_CASES)
    children = Path(f"/proc/self/task/{threading.get_native_id()}/children")

    def kill(done: float, *_: object) -> None:
        if done and workers and draw.random() < 0.2:
            with suppress(ProcessLookupError, IndexError):
                os.kill(draw.choice(_workers([int(pid) for pid in children.read_text().split()])), signal.SIGKILL)
            workers.clear()

    workers = [nth]
    results = run_cases(cases, jobs=2, store=Store(folder), progress=kill)
    assert None not in [result.trajectory for result in results], [result.failure for result in results]
    gc.collect()
    return resource.getpagesize() * int(Path("/proc/self/statm").read_text().split()[1]) / 1e6


def slope(values: Sequence[float]) -> tuple[float, float]:
    """Return the slope of values by their number, and half of its interval of 95 %.

    >>> slope([1.0, 2.0, 3.0, 4.0])
    (1.0, 0.0)
    """
    fit = stats.linregress(np.arange(len(values)), values)
    return float(fit.slope), float(stats.t.ppf(0.975, len(values) - 2) * fit.stderr)


def main(words: Sequence[str]) -> int:
    """Do rounds until the time is over."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--write", action="store_true", help="write the figures into docs/quality.md")
    options = parser.parse_args(words)
    end, draw = time.monotonic() + 60.0 * options.minutes, random.Random(options.seed)
    figures = {disturb.__doc__ or "": Figures() for disturb in DISTURBANCES}
    wrong, memory, digests = list[str](), list[float](), dict[str, object]()
    for nth in range(_MOST_DETERMINED):  # what this program keeps of its latest keys, so that it grows no more
        _own_cases(-nth, 1)[0].key  # noqa: B018
    with tempfile.TemporaryDirectory(prefix="dem-bridge-soak-") as name:
        for kind in ("twin", "lammps-1"):
            undisturbed = Survival(Path(name) / kind, CASES, kind=kind)
            digests[kind] = undisturbed.finish(undisturbed.begin())["digest"]
        nth = 0
        while time.monotonic() < end:
            disturb = DISTURBANCES[nth % len(DISTURBANCES)]
            if disturb is two_users and (os.geteuid() != 0 or _python_of_others() is None):
                nth += 1
                continue
            kind = "twin" if disturb in (full_disk, two_users) or draw.random() < 0.7 else "lammps-1"
            row = figures[disturb.__doc__ or ""]
            problem = do_round(disturb, kind, options.seed + 1000 * nth, digests[kind], row)
            if problem:
                wrong.append(problem)
            try:
                memory.append(own_campaign(nth, draw, Path(name) / "own"))
            except Exception:
                wrong.append(f"the campaign of this program: {traceback.format_exc()}")
            nth += 1
            print(f"{nth} {disturb.__name__} {kind} {row} {memory[-1:]}", problem, flush=True)
        mine = [path.name for path in (Path(name) / "own").iterdir() if path.suffix != SUFFIX]
        if mine:
            wrong.append(f"left by the campaigns of this program: {mine}")
    whole = Figures(**{key: sum(getattr(row, key) for row in figures.values()) for key in vars(Figures())})
    rows = [row.row(name) for name, row in figures.items() if row.rounds] + [whole.row("whole")]
    later = memory[len(memory) // 4 :]
    growth = "-" if len(later) < 4 else "{:+.3f} +- {:.3f}".format(*slope(later))
    date = time.strftime("%Y-%m-%d", time.gmtime())
    of_memory = [str(len(memory)), str(OWN_CASES * len(memory)), f"{max(memory, default=0.0):.1f}", growth, date]
    for cells in (*rows, of_memory):
        print(" | ".join(cells))
    print("\n".join(wrong) or "nothing was wrong")
    if options.write:
        sys.path.insert(0, str(ROOT / ".ci"))
        from quality import write_rows

        write_rows("soak", rows)
        write_rows("memory of the soak", [of_memory])
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
