"""Name the failures of LAMMPS that known defects of its release explain."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from dem_bridge.lmp.known_defects import known_defects
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.trajectory.trajectory import Trajectory


def named_failures(scene: str, engine: str, run: Trajectory | None, verdicts: Iterable[Verdict]) -> Iterator[Verdict]:
    """Yield the verdicts, each failure of LAMMPS with the known defects that the deck of its run meets.

    A defect that the deck meets and that no verdict shows has a verdict that says so.

    Parameters
    ----------
    scene : str
        Its name.
    engine : str
        Backend that is LAMMPS.
    run : Trajectory or None
        Its run; None if it failed.
    verdicts : iterable of Verdict
        The verdicts on the scene.
    """
    names = [] if run is None else run.provenance.get("lammps", {}).get("known_defects", [])
    met = [item for item in known_defects() if item.name in names]
    names_met, shown = ", ".join(item.name for item in met), False
    for verdict in verdicts:
        if met and verdict.backend == engine and verdict.outcome is Outcome.FAIL:
            # the first one describes the defect
            why = f"known defect {names_met}" if shown else "; ".join(map(str, met))
            shown, sentence = True, f"{why[0].upper()}{why[1:]}: {verdict.sentence}"
            verdict = replace(verdict, known_defect=names_met, sentence=sentence)
        yield verdict
    if met and not shown:
        yield Verdict(
            scene=scene,
            quantity="known defect",
            backend=engine,
            reference="",
            outcome=Outcome.PASS,
            sentence=f"No result of {engine} shows the known defect {names_met}, although the deck meets it.",
        )
