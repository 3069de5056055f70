"""Provide a small LAMMPS script with one line changed, for tests of the reader of scripts."""

from __future__ import annotations

from dem_bridge.lmp.reader.to_scene import ReadDeck, read_deck

#: three balls and a clamped one, along x; every part can be changed by its name
PARTS = {
    "units": "units si",
    "style": "atom_style sphere",
    "boundary": "boundary f p p",
    "box": "region box block -0.1 0.1 -0.1 0.1 -0.1 0.1\ncreate_box 2 box",
    "atoms": """create_atoms 1 single -0.02 0 0
create_atoms 1 single 0 0 0
create_atoms 1 single 0.02 0 0
create_atoms 2 single 0.04 0 0""",
    "sizes": "set type 1*2 diameter 0.02\nset type 1*2 mass 0.01",
    "pair": "pair_style granular",
    "coefficients": "pair_coeff * * hertz 1e11 0 tangential linear_nohistory 0 0 damping velocity limit_damping",
    "start": "group striker id 1\nvelocity striker set 0.5 0 0",
    "fixes": "group bodies type 1\nfix move bodies nve",
    "more": "",
    "step": "timestep 1e-7",
    "dump": "dump d all custom 20 dump.txt id x vx",
    "run": "run 1000",
    "after": "",
}


def script(**changes: str) -> str:
    """Return the script with parts of it changed."""
    assert set(changes) <= set(PARTS)
    return "\n".join({**PARTS, **changes}.values()) + "\n"


def read(files: dict[str, str] | None = None, /, file: str = "in.test", **changes: str) -> ReadDeck:
    """Return what the reader of scripts makes of the changed script."""
    return read_deck(script(**changes), file=file, opened=(files or {}).__getitem__)
