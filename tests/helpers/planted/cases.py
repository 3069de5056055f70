"""Draw cases from seeds: a chain, a fault or none, a code, and what its file holds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tests.helpers.planted.chains import FAMILIES, Chain
from tests.helpers.planted.faults import LISTED, ONLY, OUTSIDE, PAIRS, SIZED, Planted, Setting, plant
from tests.helpers.planted.files import write_csv

#: kind of case -> share among random cases
SHARES = {"listed": 0.6, "none": 0.2, "pair": 0.1, "outside": 0.1}


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A drawn case: a planted file, the seed that repeats it, and its kind."""

    seed: int
    kind: str
    planted: Planted

    def __str__(self) -> str:
        planted, setting = self.planted, self.planted.setting
        parts = [f"seed {self.seed}", planted.chain.family, f"{planted.chain.n_body} bodies", planted.fault]
        parts += [f"effect {planted.effect:.3g} floors", setting.integrator, f"{setting.digits} digits"]
        parts += ["+".join(setting.quantities), "all" if setting.bodies is None else f"bodies {setting.bodies}"]
        parts += [f"dt {'stated' if setting.dt_stated else 'unknown'}, {setting.stride} steps a row"]
        return ", ".join(parts) + f", {dict(planted.parameters)}"

    def write(self, folder: Path) -> tuple[Path, Path, float | None]:
        """Write the CSV file and the scene file; return their paths and the time step, None if it is not stated."""
        path, scene = folder / f"case{self.seed}.csv", folder / f"case{self.seed}.toml"
        planted = self.planted
        bodies = planted.setting.bodies or range(planted.chain.n_body)
        write_csv(path, planted.run, list(bodies), planted.setting.digits)
        scene.write_text(planted.chain.scene)
        return path, scene, planted.setting.dt if planted.setting.dt_stated else None


def draw_setting(rng: np.random.Generator, chain: Chain, fault: str) -> Setting:
    """Return a random code and the contents of its file."""
    integrator = str(rng.choice(["verlet", "position-verlet", "rk4", "dop853", "fine"], p=[0.6, 0.1, 0.1, 0.05, 0.15]))
    quantities = [("displacement", "velocity"), ("velocity",), ("displacement",)][
        int(rng.choice(3, p=[0.5, 0.35, 0.15]))
    ]
    by_step = ("half-step-velocity", "first-order-integrator", "one-step-late", "single-precision")
    if any(name in fault for name in by_step):
        integrator = "verlet"
    if "half-step" in fault and "velocity" not in quantities:
        quantities = ("velocity",)
    rows = int(rng.choice([101, 161, 201, 301]))
    bodies = None
    if rng.random() < 0.2 and chain.n_body > 3:
        count = int(rng.integers(2, chain.n_body))
        bodies = tuple(sorted(rng.choice(chain.n_body, size=count, replace=False).tolist()))
    stride = int(rng.choice([4, 10, 20, 50, 100]))
    return Setting(
        integrator=integrator,
        stride=stride,
        rows=rows,
        interval=chain.duration * float(rng.choice([1.0, 0.83])) / (rows - 1),
        digits=int(rng.integers(6, 18)),
        quantities=quantities,
        bodies=bodies,
        dt_stated=integrator in ("verlet", "position-verlet", "rk4") and bool(rng.random() < 0.65),
    )


def draw(seed: int, *, kind: str | None = None, fault: str | None = None, family: str | None = None) -> Case:
    """Return the case of a seed; kind, fault and family are drawn unless they are given."""
    rng = np.random.default_rng([seed, 18])
    drawn_kind = str(rng.choice(list(SHARES), p=list(SHARES.values())))
    kind = kind or ("listed" if fault in LISTED else drawn_kind)
    faults = {
        "listed": list(LISTED),
        "none": ["none"],
        "pair": ["+".join(pair) for pair in PAIRS],
        "outside": list(OUTSIDE),
    }[kind]
    fault = fault or str(rng.choice(faults))
    families = [name for name in FAMILIES if all(name in ONLY.get(part, FAMILIES) for part in fault.split("+"))]
    family = family or str(rng.choice(families))
    bodies = 2 if rng.random() < 0.05 and family == "scattered" else int(rng.choice([5, 8, 12, 16, 24, 40]))
    chain = FAMILIES[family](rng, bodies)
    setting = draw_setting(rng, chain, fault)
    if fault == "order-of-bodies" and setting.bodies is not None:
        setting = replace(setting, bodies=None)
    large = bool(rng.random() < 0.5)
    target = 10 ** rng.uniform(np.log10(60.0), np.log10(300.0)) if not large else 10 ** rng.uniform(3.0, 4.5)
    if kind == "pair":
        target = 10 ** rng.uniform(3.0, 4.5)
    elif rng.random() < 0.1:
        target = 10 ** rng.uniform(0.0, np.log10(50.0))
    return Case(seed=seed, kind=kind, planted=_sized(chain, fault, setting, target, seed))


def _sized(chain: Chain, fault: str, setting: Setting, target: float, seed: int) -> Planted:
    """Return the planted file whose effect is about ``target`` floors, if the size of the fault is free."""
    size = 0.01
    # in a pair with a fault of a fixed size the other one is as large as it is drawn
    sized = all(part in SIZED for part in fault.split("+"))
    for _ in range(4 if sized else 1):
        planted = plant(chain, fault, setting, size, np.random.default_rng([seed, 19]))
        if not sized or 0.7 < planted.effect / target < 1.4 or planted.effect == 0.0:
            break
        smaller = size * target / planted.effect
        if smaller >= 0.5 and size == 0.5:
            break
        # a fault is at most a half, so that it stays one that people make
        size = min(smaller, 0.5)
    return replace(planted, also=_single_causes(planted, size, seed)) if "+" in fault else planted


def _single_causes(planted: Planted, size: float, seed: int) -> frozenset[str]:
    """Return the causes of a fault of a pair whose other fault has an effect below 50 floors, alone or beside it."""
    names = planted.fault.split("+")
    seeds = np.random.default_rng([seed, 19]).integers(1 << 30, size=2)
    alone = [
        plant(planted.chain, name, planted.setting, size, np.random.default_rng(own))
        for name, own in zip(names, seeds, strict=True)
    ]
    causes = frozenset[str]()
    for a, b in (alone, alone[::-1]):
        beside = b.effect
        if len(a.run.time) == len(planted.run.time) and "units" not in names:
            changes = (np.max(np.abs(planted.run.values[q] - a.run.values[q])) / planted.floor[q] for q in a.floor)
            beside = min(beside, max(changes))
        causes |= a.truth if beside < 50.0 else frozenset()
    return causes
