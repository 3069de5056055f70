"""Count the truths of many scenes that lie outside of the stated uncertainty, by backend and quantity.

``python -m tests.runs.uncertainty.measure_bars -n 500 --seed 1`` takes 500 random scenes of
:mod:`tests.helpers.many_scenes`; ``--scenes awkward`` those of :mod:`tests.helpers.awkward_scenes`, ``--scenes all``
both. Codes with a fixed step run at their default one. A finite uncertainty of what does not exist, or of what the run
does not have, counts as outside. References must have none outside, others at most 1 %. Each result is a line of
``reports/latest/bars.jsonl``; ``--resume`` keeps the results that are there, and
``--tabulate`` runs nothing more. ``--write`` puts the table into
docs/quality.md.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import resource
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

import dem_bridge as db
from dem_bridge.backends.base import backend, unsupported_reason
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.scene.scene import Scene
from tests.helpers.awkward_scenes import awkward
from tests.helpers.many_scenes import many
from tests.helpers.truths import QUANTITIES, Truth

REFERENCES = ("reference", "scipy")
OTHERS = ("verlet", "blanes-moan", "ode45")
#: part of the truths that may lie outside for codes that are no references
ALLOWED = 0.01
ROOT = Path(__file__).parents[3]
RESULTS, PAGE = ROOT / "reports" / "latest" / "bars.jsonl", ROOT / "docs" / "quality.md"
_BEGIN = "<!-- truths: written by python -m tests.runs.uncertainty.measure_bars --write -->"
_END = "<!-- end of truths -->"
Pairs = Sequence[tuple[Scene, Truth]]


@dataclass(frozen=True)
class Trial:
    """Compare one run with its truth."""

    backend: str
    scene: str
    ratio: dict[str, float]
    """Error over uncertainty, the worst of all bodies or contacts."""
    width: dict[str, float]
    """Uncertainty over error, the median of all bodies or contacts."""
    refused: str = ""
    """Why there is no run; the ratios are those of no error then."""
    cpu: float = math.nan
    """CPU time of the run with its uncertainty, s."""


def try_scene(name: str, scene: Scene, truth: Truth) -> Trial | None:
    """Return the trial of a backend on a scene; None where it does not support the scene."""
    if unsupported_reason(backend(name), scene):
        return None
    begin = _cpu()
    try:
        run = db.solve(scene, backend=name)
    except (RunBroken, UsageError) as error:
        return Trial(name, scene.name, {}, {}, refused=str(error), cpu=_cpu() - begin)
    ratio, width = (
        {quantity: measure(run, quantity) for quantity in QUANTITIES} for measure in (truth.outside, truth.width)
    )
    return Trial(name, scene.name, ratio, width, cpu=_cpu() - begin)


def _cpu() -> float:
    """Return the CPU time of this process and of those that have ended, s."""
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def try_backend(name: str, pairs: Pairs) -> list[Trial]:
    """Return the trials of a backend on the scenes that it supports and does not refuse."""
    trials = [try_scene(name, scene, truth) for scene, truth in pairs]
    return [trial for trial in trials if trial is not None and not trial.refused]


def kept_trials(path: Path) -> list[Trial]:
    """Return the trials in a file; the last line of a run that was killed may be incomplete."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return [Trial(**json.loads(line)) for line in lines if line.endswith("}")]


def resumed(names: Sequence[str], pairs: Pairs, path: Path, *, keep: bool) -> Iterator[Trial]:
    """Yield the trials of all backends, those in the file first, and add each new one to the file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = path.read_text(encoding="utf-8").splitlines() if keep and path.exists() else []
    wanted = {scene.name for scene, _ in pairs}
    done = {(trial.backend, trial.scene): trial for trial in kept_trials(path)} if lines else {}
    yield from (trial for (name, scene), trial in done.items() if name in names and scene in wanted)
    with path.open("a" if keep else "w", encoding="utf-8") as file:
        file.write("\n" if lines and not lines[-1].endswith("}") else "")
        for name in names:
            for scene, truth in pairs:
                if (name, scene.name) not in done and (tried := try_scene(name, scene, truth)) is not None:
                    file.write(json.dumps(asdict(tried)) + "\n")
                    file.flush()
                    yield tried


def summary(trials: Sequence[Trial]) -> list[str]:
    """Return a line for each quantity: how many truths lie outside, the 95 % interval (Clopper-Pearson), widths."""
    lines = []
    runs = [trial for trial in trials if not trial.refused]
    for quantity in QUANTITIES if runs else ():
        ratios = np.array([trial.ratio[quantity] for trial in runs])
        outside = int(np.sum(ratios > 1.0))
        sure = binomtest(outside, len(runs)).proportion_ci()
        widths = [trial.width[quantity] for trial in runs if not math.isnan(trial.width[quantity])]
        worst = runs[int(np.argmax(ratios))]
        lines.append(
            f"| `{worst.backend}` | {quantity.replace('_', ' ')} | {len(runs):,} ({len(trials) - len(runs):,})"
            f" | {outside}"
            f" | {100 * sure.low:.2f} to {100 * sure.high:.2f} % | {ratios.max():.2g} ({worst.scene})"
            f" | {np.median(widths) if widths else math.nan:.2g} |"
        )
    return lines


def table(trials: Sequence[Trial]) -> str:
    """Return the table of docs/quality.md, for the random scenes and for those that are built."""
    head = "| scenes | backend | quantity | scenes (refused) | outside | 95 % interval | largest error | median width |"
    lines = [head, "|---|---|---|---:|---:|---:|---:|---:|"]
    names = list(dict.fromkeys(trial.backend for trial in trials))
    for kind in ("many", "awkward"):
        for name in names:
            chosen = [trial for trial in trials if trial.backend == name and trial.scene.startswith(f"{kind}-")]
            lines += [f"| {'random' if kind == 'many' else kind} {line}" for line in summary(chosen)]
    return "\n".join([*lines, "", f"Measured on {datetime.now(UTC).date().isoformat()}."])


def enough(trials: Sequence[Trial], allowed: float) -> bool:
    """Return whether at most this part of the truths lies outside for every quantity."""
    runs = [trial for trial in trials if not trial.refused]
    parts = (np.mean([trial.ratio[quantity] > 1.0 for trial in runs]) for quantity in QUANTITIES)
    return not runs or all(part <= allowed for part in parts)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return 1 where more lie outside than may."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-n", type=int, default=200, help="largest number of scenes")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scenes", choices=("many", "awkward", "all"), default="many")
    parser.add_argument("--backend", action="append", help="one or several; default: all of them")
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--resume", action="store_true", help="keep the results that the file has")
    parser.add_argument("--write", action="store_true", help="write the table to docs/quality.md")
    parser.add_argument("--tabulate", action="store_true", help="run nothing; take all results that the file has")
    options = parser.parse_args(arguments)
    pairs = [*(many() if options.scenes != "awkward" else []), *(awkward() if options.scenes != "many" else [])]
    chosen = np.random.default_rng(options.seed).permutation(len(pairs))[: options.n]
    names = options.backend or [*REFERENCES, *OTHERS]
    new = resumed(names, [pairs[i] for i in chosen.tolist()], options.results, keep=options.resume)
    trials = []
    for trial in kept_trials(options.results) if options.tabulate else new:
        trials.append(trial)
        outside = {quantity: ratio for quantity, ratio in trial.ratio.items() if ratio > 1.0}
        if outside or trial.refused:
            print(trial.backend, trial.scene, trial.refused or outside, flush=True)
    text = table(trials)
    print(text)
    if options.write:
        page = PAGE.read_text(encoding="utf-8")
        block = f"{_BEGIN}\n{text}\n{_END}"
        PAGE.write_text(re.sub(f"{_BEGIN}.*{_END}", lambda _: block, page, flags=re.DOTALL), encoding="utf-8")
    failed = [
        name
        for name in names
        if not enough([trial for trial in trials if trial.backend == name], 0.0 if name in REFERENCES else ALLOWED)
    ]
    return min(len(failed), 1)


if __name__ == "__main__":
    sys.exit(main())
