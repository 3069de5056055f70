"""A deck that leaves pairs to mixing is named where its release is old or not known, and only there."""

from __future__ import annotations

import re
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import dem_bridge as db
from dem_bridge.cli import main
from dem_bridge.errors import SceneError
from dem_bridge.judging.deck import UserDeck
from dem_bridge.judging.limits import deck_limits
from dem_bridge.lmp.reader.mixing import mixing_warning, stated_release
from tests.helpers.lammps_scripts import read, script

END = "tangential linear_nohistory 0 0 damping velocity"
#: coefficients of types 1 and 2, and those of 1 with 2 that LAMMPS (22 Jul 2025) mixes from them
MODELS = {
    "hertz": ("hertz 1e9 10", "hertz 4e9 40", "hertz 2e9 20"),
    "hooke": ("hooke 1e6 0", "hooke 9e6 0", "hooke 3e6 0"),
    "material": ("hertz/material 1e9 0 0.2", "hertz/material 3e9 0 0.2", "hertz/material 1.5e9 0 0.2"),
    "dmt": ("dmt 1e9 0 0.25 0.1", "dmt 1e9 0 0.25 0.4", "dmt 1e9 0 0.25 0.2"),
}
RELEASES = {"": True, "# LAMMPS (29 Sep 2021)\n": True, "# LAMMPS (23 Jun 2022 - Update 4)\n": True,
            "# LAMMPS (2 Aug 2023)\n": False, "# run with LAMMPS 29 Aug 2024\n": False,
            "# LAMMPS (22 Jul 2025)\n# LAMMPS (29 Sep 2021)\n": True}  # fmt: skip
#: balls that do not touch at the start, as adhesion requires
APART = "set type 1*2 diameter 0.0199\nset type 1*2 mass 0.01"
#: how the pair 1 2 comes to its coefficients -> whether it is left to mixing
PAIRS = {
    "pair_coeff 1 1 {one}\npair_coeff 2 2 {two}": True,
    "pair_coeff 1 1 {one}\npair_coeff 2 2 {two}\npair_coeff 1 2 {both}": False,
    "pair_coeff * * {both}\npair_coeff 1 1 {one}\npair_coeff 2 2 {two}": False,
    "pair_coeff 1 1*2 {one}\npair_coeff 2 2 {two}": False,
}


def _coefficients(pair: str, model: str) -> str:
    one, two, both = (f"{words} {END}" for words in MODELS[model])
    return pair.format(one=one, two=two, both=both)


def _far_apart() -> str:
    """Return atoms of which only those of type 1 can meet within the run; the clamped one is too far."""
    places = (-0.02, 0.0, 0.02, 0.09)
    return "\n".join(f"create_atoms {1 + (x > 0.05)} single {x} 0 0" for x in places)


@pytest.mark.parametrize(("model", "pair", "release"), [*product(MODELS, PAIRS, RELEASES)])
def test_pairs_left_to_mixing_are_named_where_the_release_may_be_old(model: str, pair: str, release: str) -> None:
    coefficients = _coefficients(pair, model)
    deck = read(coefficients=coefficients, sizes=APART)
    warning = mixing_warning(deck.mixed, stated_release(release + coefficients))
    assert bool(warning) == (PAIRS[pair] and RELEASES[release])
    if warning:
        # the line to write is that of the mixed pair
        _, _, line = warning.partition("write ")
        name, *numbers = MODELS[model][2].split()
        words = line.split()
        assert words[:4] == ["pair_coeff", "1", "2", name]
        assert " ".join(words[4 + len(numbers) :]) == END
        assert [float(word) for word in words[4 : 4 + len(numbers)]] == pytest.approx([float(n) for n in numbers])
        assert "types 1 2 have no pair_coeff" in warning
        explicit = read(coefficients=f"{coefficients}\n{line}", sizes=APART)
        assert explicit.mixed == ()
        for name in ("stiffness", "wall_right", "damping", "adhesion"):
            assert repr(getattr(explicit.scene, name)) == repr(getattr(deck.scene, name))


@pytest.mark.parametrize("model", ["hertz", "hooke", "material"])
def test_pairs_that_cannot_touch_and_types_without_atoms_need_nothing(model: str) -> None:
    mixed = _coefficients(next(iter(PAIRS)), model)
    assert read(coefficients=mixed).mixed
    assert read(coefficients=mixed, atoms=_far_apart()).mixed == ()
    # with weight the energy is not that of the start
    fall = "fix g all gravity 9.81 vector 1 0 0\nfix hold clamped freeze"
    group = "group clamped type 2\ngroup striker id 1\nvelocity striker set 0.5 0 0"
    assert read(coefficients=mixed, atoms=_far_apart(), start=group, more=fall).mixed
    assert read(coefficients=mixed, atoms="create_atoms 1 single 0 0 0\ncreate_atoms 1 single 0.02 0 0").mixed == ()


@pytest.mark.parametrize("style", ["gran/hooke", "gran/hooke/history", "gran/hertz/history"])
def test_the_older_styles_have_one_law_and_mix_nothing(style: str) -> None:
    assert read(pair=f"pair_style {style} 1e9 0 0 0 0 0", coefficients="pair_coeff * *").mixed == ()


@pytest.mark.parametrize(("release", "told"), [("", True), ("# LAMMPS (22 Jul 2025)", False)])
def test_import_deck_warns(release: str, told: bool, tmp_path: Path) -> None:
    deck, out = tmp_path / "in.mixed", tmp_path / "mixed.toml"
    deck.write_text(f"{release}\n{script(coefficients=_coefficients(next(iter(PAIRS)), 'hertz'))}")
    done = CliRunner().invoke(main, ["import", "deck", str(deck), "-o", str(out)])
    assert done.exit_code == 0
    assert ("warning" in done.stderr) == told
    assert ("pair_coeff 1 2 hertz 2000000000.0 20.0" in done.stderr) == told


@pytest.mark.parametrize(("release", "told"), [(20210929, True), (20250722, False)])
def test_judge_warns_where_an_old_release_ran_the_deck(release: int, told: bool) -> None:
    deck = read(coefficients=_coefficients(next(iter(PAIRS)), "hertz"))
    nothing: Any = SimpleNamespace(units="si", time_steps=[], step=None, particles=SimpleNamespace(atoms={}))
    user = UserDeck(path=Path("in.x"), commands=(), state=nothing, read=deck, mirrored=False, problems=())
    run: Any = SimpleNamespace(deck=user, version=release, dt=None, dangerous=0)
    record = SimpleNamespace(time=np.array([0.0, 1e-6]))
    errors: Any = SimpleNamespace(record=record, quantities={"velocity": SimpleNamespace(scale=1.0)})
    rows = {row.what: row.advice for row in deck_limits(deck.scene, run, errors)}
    assert ("mixing of types" in rows) == told
    assert ("write pair_coeff 1 2 hertz" in rows.get("mixing of types", "")) == told


#: section without a model -> what the message says to write
NONE = {
    "damping none": "damping velocity, with the coefficient 0",
    "tangential none": "tangential linear_nohistory 0 0",
}


@pytest.mark.parametrize(
    ("words", "model"), [*product(NONE, ("hertz 1e9 0", "hertz/material 1e9 0 0.2", "hooke 1e6 0"))]
)
def test_a_section_none_is_refused_with_what_to_write(words: str, model: str) -> None:
    kept = [part for part in ("tangential linear_nohistory 0 0", "damping velocity") if part[:3] != words[:3]]
    with pytest.raises(SceneError, match=re.escape(NONE[words])) as refused:
        read(coefficients=f"pair_coeff * * {model} {kept[0]} {words}")
    assert f"{words}, which LAMMPS refuses" in str(refused.value)
    # rolling and twisting have it as their default
    assert read(coefficients=f"pair_coeff * * {model} {END} rolling none twisting none").scene.damping is None


def test_a_wall_without_damping_is_refused_alike() -> None:
    wall = "fix w all wall/gran granular hertz 1e9 0 tangential linear_nohistory 0 0 damping none xplane NULL 0.06"
    with pytest.raises(SceneError, match="damping velocity, with the coefficient 0"):
        read(more=wall)


@pytest.mark.lammps
@pytest.mark.parametrize("words", NONE)
def test_the_installed_release_refuses_them(words: str, tmp_path: Path) -> None:
    kept = [part for part in ("tangential linear_nohistory 0 0", "damping velocity") if part[:3] != words[:3]]
    deck = tmp_path / "in.none"
    deck.write_text(script(coefficients=f"pair_coeff * * hertz 1e9 0 {kept[0]} {words}"))
    with pytest.raises(db.errors.RunBroken, match="Must specify"):
        db.judge([deck], db.load_scene("decelerating-40"))
