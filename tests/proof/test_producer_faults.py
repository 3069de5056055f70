"""The checker refuses certificates of a producer in which a fault is planted, and accepts those of the producer.

A fault whose claims stay true, as a box that is wide enough all the same, is none for a checker; each fault here makes
claims that are false or that do not follow from each other.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from types import ModuleType

import pytest

import dem_bridge as db
from dem_bridge.errors import DemBridgeError

pytest.importorskip("flint", reason="needs python-flint, the extra proof")

from dem_bridge.proof import certificate, flow, producer
from dem_bridge.proof.checker import check_proof
from dem_bridge.proof.problem import measure_scale, problem_of
from tests.helpers import proofs

#: two bodies that meet at a wall under gravity
SCENE = db.Scene(
    name="two",
    duration=1e-4,
    mass=(8.1e-3, 1e-2),
    stiffness=(4e9,),
    velocity=(0.8, -0.1),
    gap=(1e-6,),
    wall_right=db.Wall(stiffness=8e9, gap=2e-6),
    gravity=9.81,
    samples=8,
)
#: steps that hold larger errors than those of proofs, so that a forgotten one shows
COARSE = flow.StepRule(share=0.25, guard=24)
MODULES = {"flow": flow, "producer": producer, "certificate": certificate}
#: module, part of its source, and what it becomes
FAULTS: dict[str, tuple[str, str, str]] = {
    "the remainder is forgotten": ("flow", "ball.widen(target.at(i), error,", "ball.widen(target.at(i), 0.0 * error,"),
    "a digit of a stiffness": (
        "flow",
        "enumerate([*problem.stiffness, ",
        "enumerate([*(value * (1 + Fraction(1, 2**60)) for value in problem.stiffness), ",
    ),
    "a digit of a mass": ("flow", "[1 / mass for mass", "[1 / mass * (1 + Fraction(1, 2**60)) for mass"),
    "a digit of a gap": (
        "flow",
        "*problem.gap, *inverse",
        "*(value + Fraction(1, 2**90) for value in problem.gap), *inverse",
    ),
    "gravity is left out": (
        "flow",
        "*inverse, *problem.acceleration]",
        "*inverse, *(0 * value for value in problem.acceleration)]",
    ),
    "another exponent": ("flow", "np.array(problem.doubled", "np.array([4 for _ in problem.doubled]"),
    "a box is narrowed": ("producer", "WIDER * max(radius, floor)", "max(radius, floor) / WIDER"),
    "a box is rounded inwards": ("producer", "(math.ceil((radius + abs(rounded - middle)) / unit)) * unit", "unit"),
    "a sample is early": ("producer", "samples.append(flow.state(time))", "samples.append(flow.state(step.begin))"),
    "touches are not in order": ("producer", "record.touches += sorted(", "record.touches[:0] = sorted("),
    "a touch is left out": ("producer", "if side != before:\n", "if side != before and k != 1:\n"),
    "a touch opens in place of closing": ("producer", "_touch(k, side > 0,", "_touch(k, side < 0,"),
    "a touch is too certain": ("producer", "(last - first) / 2 * WIDER)", "(last - first) / 2 / 10**15)"),
    "flags of contacts are wrong": ("producer", "closed=tuple(middle > radius", "closed=tuple(middle < radius"),
    "a sample is rounded away": (
        "certificate",
        "{round(middle / Fraction(10) ** place)}",
        "{round(middle / Fraction(10) ** place) + 2}",
    ),
    "a sample has digits that are not proved": (
        "certificate",
        "max(least, _place(2 * WIDER * radius)) if radius else least",
        "_place(radius) - 9 if radius else least",
    ),
    "a mass of the file is rounded": (
        "certificate",
        "[value.hex() for value in scene.mass]",
        "[float(f'{value:.1g}').hex() for value in scene.mass]",
    ),
}


def faulty(name: str, old: str, new: str) -> ModuleType:
    """Return a module of the producer with a change of its source."""
    path = Path(str(MODULES[name].__file__))
    source = path.read_text(encoding="utf-8")
    assert source.count(old) == 1, f"{old!r} is {source.count(old)} times in the source; give one place"
    module = ModuleType(str(MODULES[name].__name__))
    module.__file__ = str(path)
    exec(compile(source.replace(old, new), str(path), "exec"), module.__dict__)
    return module


def sentence(modules: dict[str, ModuleType], rule: flow.StepRule, folder: Path) -> str:
    """Return what the checker says about a certificate of a producer of these modules."""
    problem, scale, record = problem_of(SCENE), measure_scale(SCENE), producer.Record(bits=300)
    modules["producer"].prove_from(problem, scale, record, 16, rule=rule)
    assert not record.reason
    path = proofs.written(modules["certificate"].document_of(SCENE, problem, record), folder)
    return check_proof(path, SCENE, jobs=1).sentence


def test_certificates_without_a_fault_are_proved(tmp_path: Path) -> None:
    for rule in (flow.STEP_RULE, COARSE):
        assert sentence(MODULES, rule, tmp_path).startswith("proved")


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_in_the_producer_is_refused(tmp_path: Path, fault: str) -> None:
    name, old, new = FAULTS[fault]
    modules = {**MODULES, name: faulty(name, old, new)}
    if name == "flow":
        modules["producer"] = faulty("producer", "import annotations", "import annotations")
        vars(modules["producer"]).update(Flow=modules["flow"].Flow, Stopped=modules["flow"].Stopped)
    rule = COARSE if fault == "the remainder is forgotten" else flow.STEP_RULE
    with suppress(DemBridgeError):  # a producer may lose its way
        assert sentence(modules, rule, tmp_path).startswith("not proved")
