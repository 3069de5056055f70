"""Each part of the checker gives bounds that hold, and each fault that is planted in it is noticed by a probe."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from types import ModuleType

import pytest

pytest.importorskip("flint", reason="needs python-flint, the extra proof")

import dem_bridge.proof
from dem_bridge.errors import DemBridgeError
from dem_bridge.proof import checker
from tests.helpers import checker_probes as probes
from tests.helpers.checker_probes import Probe

PARTS: tuple[Probe, ...] = (
    probes.bounds_hold,
    probes.defects_hold,
    probes.roots_are_required,
    probes.tube_holds,
    probes.tube_ends,
    probes.touches_are_located,
    probes.touches_are_not_guessed,
    probes.pieces_continue,
    probes.numbers_are_rounded_up,
    probes.claimed_touches_are_compared,
    probes.largest_overlaps_are_enclosed,
    probes.crossing_times_are_enclosed,
    probes.truth_is_proved,
    probes.near_a_touch_is_refused,
)


@pytest.mark.parametrize("probe", PARTS, ids=lambda probe: probe.__name__)
def test_a_part_holds(tmp_path: Path, probe: Probe) -> None:
    probe(checker, tmp_path)


def _narrow(factor: int, *path: object) -> Probe:
    """Return the probe that a ball is refused whose radius is smaller by a factor."""

    def change(file: object) -> None:
        entry = file
        for key in path:
            entry = entry[key]  # type: ignore[index]
        entry[1] = str(Fraction(entry[1]) / factor)  # type: ignore[index]

    return probes.refuses(change)


def _set(value: object, *path: object) -> Probe:
    """Return the probe that a file is refused in which an entry has another value."""

    def change(file: object) -> None:
        *way, last = path
        for key in way:
            file = file[key]  # type: ignore[index]
        file[last] = value  # type: ignore[index]

    return probes.refuses(change)


#: part of the source, what it becomes, the probe that notices: of the checker, and of its reading of files
MUTANTS: list[tuple[str, str, str, Probe]] = [
    ("checker_extremes", "rest[0] + flatter >= 0", "rest[0] >= 0", probes.bounds_hold),
    ("checker_extremes", "rest[0] + steeper <= 0", "rest[0] <= 0", probes.bounds_hold),
    ("checker_extremes", "sum((c for c in rest if c < 0), zero)", "zero", probes.bounds_hold),
    ("checker_extremes", "sum((c for c in rest if c > 0), zero)", "zero", probes.bounds_hold),
    ("checker_extremes", "for part in (0, 1)]", "for part in (0, 0)]", probes.bounds_hold),
    ("checker", "sum(map(abs, poly", "sum(map(int, poly", probes.bounds_hold),
    ("checker", "claims.half_power(overlaps[-1][1], bond.twice)", "0.0", probes.defects_hold),
    (
        "checker",
        "claims.half_power(overlaps[-1][1], bond.twice)",
        "claims.half_power(overlaps[-1][1], 4)",
        probes.defects_hold,
    ),
    ("checker", "error[body] += span * unsure", "error[body] += 0.0 * unsure", probes.defects_hold),
    ("checker", "size(x.derivative() - slope * v)", "0.0 * size(v)", probes.defects_hold),
    ("checker", "m * v.derivative() - slope * f", "m * v.derivative() - m * v.derivative()", probes.defects_hold),
    ("checker", "+ error) / mass", "+ error)", probes.defects_hold),
    ("checker", "2 * piece.square]", "piece.square]", probes.defects_hold),
    ("checker", "forces[body] += sign * law", "forces[body] -= sign * law", probes.defects_hold),
    ("checker", "size(root * root - g) / least", "0.0 / least", probes.defects_hold),
    ("checker", "law *= g ** (bond.twice // 2)", "law *= g", probes.defects_hold),
    ("checker", "[0] * bond.twice + [1]", "[0] * 2 + [1]", probes.defects_hold),
    ("checker", 'require(bounds(g)[0] >= 0.0, "', 'require(True, "', probes.roots_are_required),
    ("checker", "require(least > 0.0,", "require(True,", probes.roots_are_required),
    ("checker", "require(overlap[0] == 0 and overlap[1] == 0,", "require(True,", probes.roots_are_required),
    ("checker", "require(piece.linear == 0 or piece.square == 0,", "require(True,", probes.roots_are_required),
    ("checker", "most + wide)", "most)", probes.tube_holds),
    ("checker", "* b * p / 2 *", "* b *", probes.tube_holds),
    ("checker", "half_power(d, p - 2)", "half_power(d, p - 1)", probes.tube_holds),
    ("checker", "start = self.errors + more", "start = self.errors", probes.tube_holds),
    ("checker", "total + rates(bound) / TAYLOR", "total", probes.tube_holds),
    ("checker", "total = total + term", "total = total + 0.5 * term", probes.tube_holds),
    ("checker", "np.add.at(force, self.right, pull)", "np.add.at(force, self.right, 0.0)", probes.tube_holds),
    ("checker", "far[self.left] + far[self.right])", "far[self.left])", probes.tube_holds),
    ("checker", "require(2.0 * float(bound[0].max()) <= wide,", "require(True,", probes.tube_ends),
    ("checker", "far[:, self.left[k]] + far[:, self.right[k]]", "far[:, self.left[k]]", probes.tube_holds),
    ("checker", "require(self.slope != 0,", "require(True,", probes.touches_are_not_guessed),
    (
        "checker",
        "if self.slope in (None, slope) else 0",
        "if self.slope in (None, slope) else slope",
        probes.touches_are_not_guessed,
    ),
    ("checker", "require(self.slope == now,", "require(True,", probes.touches_are_not_guessed),
    ("checker", "or self.sign == 0 or bool(self.near)", "or True", probes.touches_are_not_guessed),
    ("checker", "min(self.speed, speed)", "speed", probes.touches_are_located),
    ("checker", "best.radius / exactly(self.speed)", "best.radius", probes.touches_are_located),
    ("checker", "min(self.near, key", "max(self.near, key", probes.touches_are_located),
    (
        "checker",
        "self.sign, self.slope, self.speed, self.near = now, None, math.inf, []",
        "self.sign = now",
        probes.touches_are_located,
    ),
    ("checker", "above(abs(p(first) - y))", "0.0", probes.pieces_continue),
    ("checker", "require(self.time == starts < ends", "require(starts < ends", probes.pieces_continue),
    (
        "checker",
        "require(off + exactly(error) <= ball.radius,",
        "require(off <= ball.radius,",
        _narrow(10**5, "checkpoints", 2, "velocity", 2),
    ),
    (
        "checker",
        "- arb(ball.middle)) + arb(error)",
        "- arb(ball.middle))",
        _narrow(10**15, "samples", "velocity", 3, 0),
    ),
    ("checker", "            walk.arrive()\n", "", _narrow(10**5, "checkpoints", 2, "velocity", 2)),
    ("checker_extremes", "value - off >= least", "value >= least", probes.largest_overlaps_are_enclosed),
    ("checker_extremes", "least <= 0 or value", "True or value", probes.largest_overlaps_are_enclosed),
    ("checker_extremes", "value + max(*rises, fmpq(0))", "value", probes.largest_overlaps_are_enclosed),
    (
        "checker_extremes",
        "-limits(before, HALVINGS)[0]",
        "0",
        probes.largest_overlaps_are_enclosed,
    ),
    (
        "checker_extremes",
        "limits(after, HALVINGS)[1]",
        "0",
        probes.largest_overlaps_are_enclosed,
    ),
    ("checker_extremes", "high + off <= max(most", "high <= max(most", probes.largest_overlaps_are_enclosed),
    (
        "checker_extremes",
        "or passage.contains(claim.at)",
        "and passage.contains(claim.at)",
        probes.largest_overlaps_are_enclosed,
    ),
    ("checker_extremes", "scaled.isqrt()", "scaled >> _BITS", probes.crossing_times_are_enclosed),
    ("checker_extremes", "piece.square * q * q", "piece.square * q", probes.crossing_times_are_enclosed),
    ("checker_extremes", "passage.overlap(q) > passage.off", "True", probes.crossing_times_are_enclosed),
    (
        "checker_extremes",
        "(fmpq(0), q) if piece.square >= 0 else (q, fmpq(1))",
        "(fmpq(0), q)",
        probes.crossing_times_are_enclosed,
    ),
    (
        "checker_extremes",
        "(fmpq(0), q) if piece.square >= 0 else",
        "(q, q) if piece.square >= 0 else",
        probes.crossing_times_are_enclosed,
    ),
    ("checker_extremes", "and rate(q) > off_rate", "and rate(q) > 0", probes.crossing_times_are_enclosed),
    (
        "checker_extremes",
        "require(low > off_rate or high < -off_rate, f",
        "require(True, f",
        probes.crossing_times_are_enclosed,
    ),
    ("checker_extremes", "and rate(q) > off_rate", "", probes.crossing_times_are_enclosed),
    ("checker_extremes", "rate(q) < -off_rate", "rate(q) < 0", probes.crossing_times_are_enclosed),
    ("checker_extremes", "(side == 0 and self.known[k])", "False", probes.crossing_times_are_enclosed),
    ("checker_extremes", "side > 0 or (side", "False or (side", probes.crossing_times_are_enclosed),
    (
        "checker_file",
        "math.nextafter(int(value.p) / int(value.q), math.inf)",
        "int(value.p) / int(value.q)",
        probes.numbers_are_rounded_up,
    ),
    ("checker_file", "math.inf if value > 0 else -1.0e308", "1.0e308", probes.numbers_are_rounded_up),
    ("checker_file", "math.sqrt(value) if twice % 2 else 1.0", "1.0", probes.numbers_are_rounded_up),
    ("checker_file", "require(inside, f", "require(True, f", probes.claimed_touches_are_compared),
    (
        "checker_file",
        "require(touch.time.middle - touch.time.radius > before,",
        "require(True,",
        probes.claimed_touches_are_compared,
    ),
    ("checker_file", "require(len(proved) == len(claimed),", "require(True,", probes.claimed_touches_are_compared),
    (
        "checker_file",
        "require(closed == (signs[-1] > 0),",
        "require(True,",
        _set([True] * 3, "checkpoints", 2, "closed"),
    ),
    (
        "checker_file",
        "require(start.time == 0 and is_exact,",
        "require(True,",
        _set("1e-40", "checkpoints", 0, "velocity", 0, 1),
    ),
    (
        "checker_file",
        "(touch.contact, touch.closes) == (claim.contact, claim.closes)",
        "True",
        probes.claimed_touches_are_compared,
    ),
]


#: how a probe notices: a bound that does not hold, or a file of which the checker loses its way
NOTICED = (AssertionError, pytest.fail.Exception, ArithmeticError, ValueError, DemBridgeError)


@contextmanager
def _mutant(module: str, old: str, new: str) -> Iterator[ModuleType]:
    """Import the checker anew with a change in one of its modules, and the module as it was afterwards."""
    order = ("checker_file", "checker_extremes", "checker")  # each imports those before it
    names = [f"dem_bridge.proof.{name}" for name in order[order.index(module) :]]
    kept = {name: sys.modules[name] for name in names}
    try:
        for name in names:
            path = Path(str(kept[name].__file__))
            source = path.read_text(encoding="utf-8")
            if name.endswith(f".{module}"):
                assert source.count(old) == 1, f"{old!r} is {source.count(old)} times in the source; give one place"
                source = source.replace(old, new)
            fresh = ModuleType(name)
            fresh.__file__ = str(path)
            sys.modules[name] = fresh
            setattr(dem_bridge.proof, name.rpartition(".")[2], fresh)
            exec(compile(source, str(path), "exec"), fresh.__dict__)
        yield sys.modules[names[-1]]
    finally:
        sys.modules.update(kept)
        for name in names:
            setattr(dem_bridge.proof, name.rpartition(".")[2], kept[name])
        importlib.invalidate_caches()


@pytest.mark.parametrize(
    ("module", "old", "new", "probe"), MUTANTS, ids=[f"{old} -> {new}"[:90] for _, old, new, _ in MUTANTS]
)
def test_a_fault_in_the_checker_is_noticed(tmp_path: Path, module: str, old: str, new: str, probe: Probe) -> None:
    with _mutant(module, old, new) as faulty, pytest.raises(NOTICED):
        probe(faulty, tmp_path)
