"""What is possible and unlikely in a script is said; each kind is planted here, and a sound script has none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from dem_bridge.judging.check.laboratory import Laboratory
from dem_bridge.judging.check.plausible import Plausibility, plausibility_of
from dem_bridge.judging.check.subject import subject_of
from tests.helpers.checked_decks import BALLS, CONTACT, MODULUS, NO_FRICTION, POISSON, RADIUS, UNDAMPED, script


def entries(folder: Path, text: str) -> dict[str, Plausibility]:
    """Return the entries for a script by their names; nothing is run by LAMMPS."""
    (folder / "in.chain").write_text(text)
    with subject_of(folder / "in.chain") as subject:
        return {entry.name: entry for entry in plausibility_of(Laboratory(subject=subject), text)}


def test_a_sound_script_has_nothing_to_look_at(tmp_path: Path) -> None:
    found = entries(tmp_path, script())
    assert [entry.name for entry in found.values() if entry.look] == []
    assert found["step"].value == pytest.approx(0.01, rel=0.01)
    assert found["overlap"].sentence == "largest overlap 0.12 % of the radius"
    assert found["overlap"].as_json()["outcome"] == "ok"


SOFT = {
    "contact": CONTACT * 1e6**0.4,
    "coefficients": f"pair_coeff * * hertz/material {MODULUS / 1e6:g} 0 0.3 {UNDAMPED}",
}
FAR_WALL = f"fix wall all wall/gran granular {BALLS} xplane NULL {20 * RADIUS:g}"
FAR = "\n".join(f"create_atoms 1 single {2.5 * RADIUS * k:.15g} 0 0 units box" for k in range(5))
CLOSE = "\n".join(f"create_atoms 1 single {1.99 * RADIUS * k:.15g} 0 0 units box" for k in range(5))
DASHPOT = f"pair_coeff * * hertz/material {MODULUS:g} 10 {POISSON:g} {NO_FRICTION} damping velocity"
KINDS = f"set atom 3*5 type 2\nset group all diameter {2 * RADIUS:g}\nset group all density 7800"


@pytest.mark.parametrize(
    ("name", "changes", "said"),
    [
        ("overlap", SOFT, "(are stiffness, speed and units right?)"),
        ("step", {"per_contact": 10.0}, "the step is 10 % of the shortest contact time"),
        (
            "exponent",
            {"coefficients": f"pair_coeff * * hooke 1e7 0 {UNDAMPED}"},
            "that of spheres goes as its power 3/2",
        ),
        ("tension", {"coefficients": DASHPOT}, "damping without limit_damping pulls"),
        ("contacts", {"atoms": FAR}, "no contact closes during the run"),
        ("start", {"atoms": CLOSE}, "bodies begin with overlaps of up to 1 % of the radius, which no load holds"),
        ("motion", {"start": ""}, "nothing moves at the start"),
        ("end", {"bodies": 5, "length": 0.5}, "bodies have not moved when the run ends"),
        ("step", {"per_contact": 0.6, "length": 6.0}, "the step is 1.7 times the shortest contact time"),
        ("wall", {"more": FAR_WALL}, "a wall is never touched"),
        ("density", {"sizes": f"set group all diameter {2 * RADIUS:g}\nset group all density 7.8e6"}, "7.8e+06 kg/m^3"),
        ("modulus", {"coefficients": f"pair_coeff * * {BALLS.replace('2e+11', '200')}", "run": "run 10"}, "200 Pa"),
        (
            "mixing",
            {
                "sizes": KINDS,
                "coefficients": f"pair_coeff 1 1 hertz 1e11 0 {UNDAMPED}\npair_coeff 2 2 hertz 1e10 0 {UNDAMPED}",
            },
            "LAMMPS takes K = 3.2e+10, the geometric mean; two springs in series have 1.8e+10",
        ),
    ],
)
def test_what_is_unlikely_is_said_with_its_number(
    tmp_path: Path, name: str, changes: dict[str, Any], said: str
) -> None:
    found = entries(tmp_path, script(**changes))
    assert said in found[name].sentence
    assert found[name].look
    assert next(iter(found.values())).look  # what is worth a look comes first


def test_a_deck_of_this_program_has_a_radius_that_says_nothing(tmp_path: Path) -> None:
    text = f"# surrogate radius R = 1e-5 m\n{script(**SOFT)}"
    assert "overlap" not in entries(tmp_path, text)


def test_a_mixed_modulus_is_told_and_is_nothing_to_look_at(tmp_path: Path) -> None:
    pairs = f"pair_coeff 1 1 hertz/material 7e10 0 0.25 {UNDAMPED}\npair_coeff 2 2 hertz/material 2e11 0 0.3 {UNDAMPED}"
    mixing = entries(tmp_path, script(sizes=KINDS, coefficients=pairs))["mixing"]
    assert not mixing.look
    # 2 (1 - nu_1^2) / ((1 - nu_1^2) / E_1 + (1 - nu_2^2) / E_2)
    assert mixing.value == pytest.approx(2 * 0.9375 / (0.9375 / 7e10 + 0.91 / 2e11))


def test_overlaps_of_a_script_that_is_no_chain_are_named_with_their_number(tmp_path: Path) -> None:
    halved = "\n".join(f"create_atoms 1 single {RADIUS * k:.15g} 0 0 units box" for k in range(4))
    start = entries(tmp_path, script(atoms=halved))["start"]
    assert start.look
    assert start.value == pytest.approx(1.0)
    assert start.sentence.startswith("atoms 1 and 2 begin with an overlap of 100 % of the smaller radius")
    apart = "\n".join(f"create_atoms 1 single {2.1 * RADIUS * k:.15g} {RADIUS * k:.15g} 0 units box" for k in range(4))
    assert "start" not in entries(tmp_path, script(atoms=apart))
