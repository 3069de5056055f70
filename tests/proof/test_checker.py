"""The checker proves what is true, by solutions that share nothing with it, and refuses planted faults.

Each planted fault is one change of a certificate that is proved without it.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("flint", reason="needs python-flint, the extra proof")

from flint import fmpq

from dem_bridge.proof.checker import Walk, check_proof
from dem_bridge.proof.checker_file import Ball, Box, exactly
from dem_bridge.proof.checker_guess import Bond, Chain
from dem_bridge.scene.scene import Scene
from tests.helpers import proof_scenes, proofs

File = dict[str, Any]


def check(file: File, folder: Path, scene: Scene | None = None) -> str:
    """Return what the checker says about a file."""
    result = check_proof(proofs.written(file, folder), scene, jobs=1)
    assert result.sentence.startswith("proved") == result.proved
    return result.sentence


@cache
def certificates() -> dict[str, File]:
    return {"pair": proof_scenes.pair(), "linear": proof_scenes.linear()}


@pytest.mark.parametrize(
    ("name", "scene"), [("pair", proof_scenes.PAIR), ("linear", proof_scenes.LINEAR)], ids=["pair", "linear"]
)
def test_a_motion_with_a_closed_form_is_proved(tmp_path: Path, name: str, scene: Scene) -> None:
    assert check(certificates()[name], tmp_path, scene).startswith("proved: 3 segments")


@pytest.mark.slow
def test_a_motion_in_decimal_arithmetic_is_proved(tmp_path: Path) -> None:
    assert check(proof_scenes.hertz(), tmp_path, proof_scenes.HERTZ).startswith("proved: 3 segments, 5 touches")


def test_segments_are_proved_side_by_side(tmp_path: Path) -> None:
    path = proofs.written(certificates()["pair"], tmp_path)
    assert check_proof(path, jobs=2) == check_proof(path, jobs=1)


@pytest.mark.parametrize("exponent", [3.0, 3.5, 4.5])
def test_a_collision_with_another_exponent_is_proved(tmp_path: Path, exponent: float) -> None:
    stiffness = 4e9 * 1e6 ** (exponent - 2.5)
    motion = proofs.collision(replace(proof_scenes.PAIR, exponent=exponent, stiffness=(stiffness,), duration=2e-4))
    end = motion.touches[-1][0]
    times = [proofs.dyadic(1e-6), proofs.dyadic(1.1 * float(end))]
    radii = proof_scenes.powers((34, 30), (28, 24))
    assert check(proofs.certificate(motion, times, radii), tmp_path).startswith("proved")


def test_bodies_in_touch_at_the_start_have_no_touch_then(tmp_path: Path) -> None:
    motion = proofs.collision(replace(proof_scenes.PAIR, gap=(0.0,)))
    file = proofs.certificate(motion, [proofs.dyadic(9e-5)], proof_scenes.powers((30, 25)))
    assert len(file["touches"]) == 1
    assert check(file, tmp_path).startswith("proved: 1 segments, 1 touches")


def test_a_scene_of_other_numbers_is_refused(tmp_path: Path) -> None:
    file = certificates()["pair"]
    for other in ({"gravity": 1e-9}, {"stiffness": (4.0000001e9,)}, {"samples": 3}, {"duration": 1.3e-4}):
        assert "not about the scene" in check(file, tmp_path, replace(proof_scenes.PAIR, **other))


def test_a_true_claim_of_fewer_checkpoints_is_proved(tmp_path: Path) -> None:
    file = copy.deepcopy(certificates()["linear"])
    del file["checkpoints"][1]
    assert check(proofs.sealed(file), tmp_path).startswith("proved: 2 segments")


def moved(ball: list[str], radii: int) -> list[str]:
    """Return a ball that is moved by a multiple of its radius."""
    return [proofs.text(Fraction(ball[0]) + radii * Fraction(ball[1]), 70), ball[1]]


def scaled(ball: list[str], factor: Fraction) -> list[str]:
    """Return a ball with another radius."""
    return [ball[0], proofs.text(Fraction(ball[1]) * factor, 90)]


def set_at(*path: Any) -> Callable[[Any], Callable[[File], None]]:
    """Return a change of the entry of a file at a path: to a value, or by a function of it."""

    def by(value: Any) -> Callable[[File], None]:
        def change(file: File) -> None:
            *way, last = path
            for key in way:
                file = file[key]
            file[last] = value(file[last]) if callable(value) else value

        return change

    return by


def digit(text: str) -> str:
    """Return a hexadecimal double with another last bit."""
    import math

    return math.nextafter(float.fromhex(text), math.inf).hex()


def swap(*path: Any, first: int = 0, second: int = 1) -> Callable[[File], None]:
    def change(file: File) -> None:
        entries: Any = file
        for key in path:
            entries = entries[key]
        entries[first], entries[second] = entries[second], entries[first]

    return change


def drop(*path: Any) -> Callable[[File], None]:
    def change(file: File) -> None:
        entries: Any = file
        for key in path[:-1]:
            entries = entries[key]
        del entries[path[-1]]

    return change


def coarser(file: File) -> None:
    """Round the middles of a box to 18 digits, with the radii as before: the producer had fewer bits."""
    for key in ("displacement", "velocity"):
        balls = file["checkpoints"][2][key]
        balls[:] = [[proofs.text(Fraction(middle), 18), radius] for middle, radius in balls]


def again(file: File) -> None:
    """List a touch twice."""
    file["touches"].insert(1, copy.deepcopy(file["touches"][0]))


def without_wall(file: File) -> None:
    """Leave out the wall and its flags."""
    del file["scene"]["contacts"][2]
    for point in file["checkpoints"]:
        point["closed"].pop()


BOX = ("checkpoints", 2)
TOUCH = ("touches", 2)
SAMPLE = ("samples", "velocity", 3)
#: change of the linear certificate, and what the checker says
FAULTS: dict[str, tuple[Callable[[File], None], str]] = {
    "a box is shrunk": (set_at(*BOX, "displacement", 1)(lambda b: scaled(b, Fraction(1, 10**6))), "its ball at t ="),
    "a velocity is shrunk": (
        set_at(*BOX, "velocity", 2)(lambda b: scaled(b, Fraction(1, 10**6))),
        "its ball at t =",
    ),
    "a box is moved": (set_at(*BOX, "displacement", 0)(lambda b: moved(b, 2)), "its ball at t ="),
    "a velocity is moved": (set_at(*BOX, "velocity", 0)(lambda b: moved(b, -2)), "its ball at t ="),
    "a box has no radius": (set_at(*BOX, "velocity", 0, 1)("0"), "its ball at t ="),
    "a box has fewer digits": (coarser, "its ball at t ="),
    "a sample is moved": (set_at(*SAMPLE, 1)(lambda b: moved(b, 2)), "may be outside"),
    "a displacement is moved": (set_at("samples", "displacement", 5, 0)(lambda b: moved(b, 2)), "may be outside"),
    "a sample is rounded inwards": (set_at(*SAMPLE, 0)(lambda b: scaled(b, Fraction(1, 10**15))), "may be outside"),
    "the first sample is moved": (set_at("samples", "velocity", 0, 0, 0)("0.8"), "does not hold the start"),
    "a sample time is changed": (set_at("samples", "time", 3)("1/5000"), "samples.time"),
    "samples are left out": (drop("samples", "time", 3), "samples.time"),
    "a row of samples is left out": (drop("samples", "velocity", 3), "has 5 entries in place of 6"),
    "a touch is left out": (drop(*TOUCH), "lists 6 touches of 7"),
    "a touch is listed twice": (again, "lists 8 touches of 7"),
    "two touches are swapped": (swap("touches", first=1, second=2), "touch 1 is that of contact 1"),
    "a touch is one of another contact": (set_at(*TOUCH, "contact")(0), "touch 2 is that of contact 2"),
    "a touch opens in place of closing": (set_at(*TOUCH, "closes")(False), "or of the other kind"),
    "a touch is moved": (set_at(*TOUCH, "time")(lambda b: moved(b, 2)), "outside its ball of times"),
    "a touch is rounded inwards": (
        set_at(*TOUCH, "time")(lambda b: scaled(b, Fraction(1, 10**15))),
        "outside its ball of times",
    ),
    "a touch is of no contact": (set_at(*TOUCH, "contact")(3), "names no contact"),
    "a contact is a truth value": (set_at(*TOUCH, "contact")(True), "names no contact"),
    "a digit of a mass": (set_at("scene", "mass", 1)(digit), "not proved"),
    "a digit of a stiffness": (set_at("scene", "contacts", 0, "stiffness")(digit), "not proved"),
    "a digit of a gap": (set_at("scene", "contacts", 1, "gap")(digit), "not proved"),
    "a digit of gravity": (set_at("scene", "gravity")(digit), "not proved"),
    "a digit of a velocity": (set_at("scene", "velocity", 0)(digit), "not the start of the scene"),
    "a load": (set_at("scene", "constant_force", 2)((1e-20).hex()), "not proved"),
    "another exponent": (set_at("scene", "contacts", 1, "exponent")((2.5).hex()), "not proved"),
    "an exponent without a bounded slope": (set_at("scene", "contacts", 1, "exponent")((1.5).hex()), "the exponent of"),
    "an exponent that is no half": (set_at("scene", "contacts", 1, "exponent")((2.2).hex()), "the exponent of"),
    "two masses are swapped": (swap("scene", "mass"), "not proved"),
    "a wall is left out": (without_wall, "not proved"),
    "a contact is left out": (drop("scene", "contacts", 1), "joins"),
    "a contact joins others": (set_at("scene", "contacts", 0, "bodies")([0, 2]), "joins"),
    "a checkpoint is later": (
        set_at(*BOX, "time")(lambda t: proofs.ratio(Fraction(t) + Fraction(1, 2**80))),
        "its ball at t =",
    ),
    "a time is not dyadic": (set_at(*BOX, "time")("7/30000"), "not dyadic"),
    "closed flags are swapped": (set_at("checkpoints", 2, "closed")(lambda flags: flags[::-1]), "closed is wrong"),
    "the start is left out": (drop("checkpoints", 0), "not the start"),
    "the start is not exact": (set_at("checkpoints", 0, "velocity", 0, 1)("1e-40"), "not the start"),
    "two checkpoints are swapped": (swap("checkpoints", first=1, second=2), "do not increase"),
    "no checkpoint but the start": (set_at("checkpoints")(lambda points: points[:1]), "proved_until"),
    "the end is later": (set_at("proved_until")("1/2048"), "proved_until"),
    "a number is not a number": (set_at(*BOX, "velocity", 0, 0)("nan"), "no exact number"),
    "a radius is infinite": (set_at(*BOX, "velocity", 0, 1)("inf"), "no exact number"),
    "a radius is above all floats": (set_at(*BOX, "velocity", 0, 1)("1e500"), "not proved"),
    "a radius is below all floats": (set_at(*BOX, "velocity", 0, 1)("1e-500"), "not proved"),
    "a radius is negative": (set_at(*BOX, "velocity", 0, 1)("-1e-20"), "negative radius"),
    "a number is no text": (set_at(*BOX, "velocity", 0, 0)(0.125), "no number as a text"),
    "an exponent without end": (set_at(*BOX, "velocity", 0, 0)("1e9999"), "the exponent of"),
    "a mass is zero": (set_at("scene", "mass", 0)((0.0).hex()), "a mass is not positive"),
    "a stiffness is negative": (set_at("scene", "contacts", 0, "stiffness")((-1.0).hex()), "stiffness of contact 0"),
    "another schema": (set_at("schema")("dem-bridge/proof/2"), "schema ="),
    "a key is missing": (drop(*TOUCH, "closes"), "lacks ['closes']"),
    "an unknown key": (set_at("remark")("right"), "unknown ['remark']"),
    "peaks of fewer contacts": (set_at("peaks")([{"contact": 0}]), "peaks has 1 entries in place of 3"),
    "a peak without its time": (set_at("peaks")([{"overlap": ["0", "0"]}] * 3), "peak 0 lacks ['at']"),
    "a list of no length": (set_at("checkpoints")({}), "is no list"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_is_refused(tmp_path: Path, fault: str) -> None:
    file = copy.deepcopy(certificates()["linear"])
    change, sentence = FAULTS[fault]
    change(file)
    assert sentence in check(proofs.sealed(file) if "remark" not in file else file | {}, tmp_path)


def walked(chain: Chain, box: Box, time: Fraction, radius: float) -> Walk:
    """Follow a chain from a box up to a time with defects far below a radius."""
    ball = Ball(fmpq(0), exactly(radius))
    n = len(chain.mass)
    end = Box(fmpq(time.numerator, time.denominator), (ball,) * n, (ball,) * n, (False,) * len(chain.bonds))
    walk = Walk(chain, box, end, 2.0**-24)
    for _ in walk.steps():
        pass
    return walk


def states(*walks: tuple[Fraction, Walk]) -> proofs.Motion:
    """Return the ends of walks as a motion of the scene of three bodies in touch."""
    ends = {time: [Fraction(int(y.p), int(y.q)) for part in walk.state for y in part] for time, walk in walks}
    return proofs.Motion(proof_scenes.FAINT, ends.__getitem__, [], Fraction(0))


def faint_start() -> tuple[Chain, Box]:
    """Return equations and start of three bodies in touch, the first of which is struck."""
    c, zero = proof_scenes.FAINT.contacts, Ball(fmpq(0), fmpq(0))
    numbers = zip(c.left.tolist(), c.right.tolist(), c.stiffness.tolist(), strict=True)
    bonds = tuple(Bond(left, right, exactly(beta), fmpq(0), 3) for left, right, beta in numbers)
    velocity = tuple(Ball(exactly(v), fmpq(0)) for v in proof_scenes.FAINT.velocity)
    mass = tuple(map(exactly, proof_scenes.FAINT.mass))
    return Chain(mass, (fmpq(0),) * 3, bonds), Box(fmpq(0), (zero,) * 3, velocity, (False, False))


def test_a_faint_force_must_not_be_forgotten_or_taken_for_a_constant(tmp_path: Path) -> None:
    chain, box = faint_start()
    time, radius = proofs.dyadic(1e-6, 60), 1e-25
    faint = replace(chain.bonds[1], stiffness=chain.bonds[1].stiffness / 10**40)
    forgotten = replace(chain, bonds=(chain.bonds[0], faint))
    right, wrong = walked(chain, box, time, radius), walked(forgotten, box, time, radius)
    push = (right.state[1][2] - wrong.state[1][2]) * chain.mass[2] / wrong.time
    constant = walked(replace(forgotten, steady=(fmpq(0), -push, push)), box, time, radius)
    claims = {"right": right, "forgotten": wrong, "constant": constant}
    said = {}
    for name, walk in claims.items():
        file = proofs.certificate(states((time, walk)), [time], [(Fraction(radius), Fraction(radius))])
        said[name] = check(file, tmp_path)
    assert said["right"].startswith("proved")
    assert "its ball" in said["forgotten"]
    assert "its ball" in said["constant"]


def test_a_contact_may_be_fainter_than_a_box_although_its_sign_is_known(tmp_path: Path) -> None:
    chain, box = faint_start()
    time = proofs.dyadic(1e-7, 60)
    walk = walked(chain, box, time, 1e-25)
    overlap = Fraction(*map(int, (walk.state[0][1].p, walk.state[0][1].q)))
    assert walk.signs[1].sign == 1
    motion = states((time, walk))
    file = proofs.certificate(motion, [time], [(overlap, Fraction(1, 10**12))])
    file["checkpoints"][1]["closed"] = [True, False]
    assert check(proofs.sealed(file), tmp_path).startswith("proved: 1 segments, 0 touches")


def test_a_box_into_which_only_a_part_of_the_flow_leads_is_refused(tmp_path: Path) -> None:
    chain, box = faint_start()
    first, second, radius = proofs.dyadic(1e-6, 60), proofs.dyadic(3e-5, 60), Fraction(1, 10**25)
    walk = walked(chain, box, first, float(radius))
    balls = [tuple(Ball(y, exactly(float(radius))) for y in part) for part in walk.state]
    onward = walked(chain, Box(walk.time, balls[0], balls[1], (True, True)), second, 1e-22)
    motion = states((first, walk), (second, onward))
    wide = [Fraction(float(errors.max())) for errors in onward.tube.errors]
    for part, proved in ((Fraction(3, 2), True), (Fraction(1, 2), False)):
        file = proofs.certificate(motion, [first, second], [(radius, radius), (2 * wide[0], part * wide[1])])
        assert check(file, tmp_path).startswith("proved") == proved


def test_a_digest_of_another_content_is_refused(tmp_path: Path) -> None:
    file = copy.deepcopy(certificates()["pair"])
    file["scene"]["name"] = "another"
    assert "digest" in check(file, tmp_path)


@pytest.mark.parametrize("text", ["", "{", "[]", "[" * 100_000, "nan", '{"schema": NaN}', "\xff\xfe"])
def test_a_file_that_is_no_certificate_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "proof.json"
    path.write_bytes(text.encode("latin-1"))
    assert check_proof(path).sentence.startswith("not proved: the file")


def test_a_file_that_cannot_be_read_raises(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No such file"):
        check_proof(tmp_path / "absent.json")
    with pytest.raises(OSError, match="Is a directory"):
        check_proof(tmp_path)


def test_the_text_of_the_file_is_not_changed_by_the_helpers(tmp_path: Path) -> None:
    file = certificates()["pair"]
    assert json.loads(proofs.written(file, tmp_path).read_text()) == file == proofs.sealed(file)
