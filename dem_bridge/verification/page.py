"""Write a verification as files: its page shows runs, budgets and shared modules beside what every study has.

Its scope follows ASME V&V 10 and 40: code verification asks whether a program solves its equations correctly, solution
verification how large the numerical error of a given run is, and validation whether the equations describe reality.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from dem_bridge.backends.base import BACKENDS, ENGINE_BACKENDS
from dem_bridge.foundation.notebook import picture, scene_sketch
from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.live import Chain, error_scale_of, shown_chains
from dem_bridge.report.page import KINDS, SEVERITY, outcomes_of, study_files, valued
from dem_bridge.report.texts import Texts
from dem_bridge.runs.recall import recall
from dem_bridge.runs.store import Store
from dem_bridge.verification import records
from dem_bridge.verification.banner import banner_of
from dem_bridge.verification.chains import chains_of, error_scale
from dem_bridge.verification.independence import ANSWERS_THROUGH, Shared, matrix
from dem_bridge.verification.pictures import begin_pictures, with_figures_of
from dem_bridge.verification.proved import ProvedMotion, proved_motion
from dem_bridge.verification.reference_choice import BLANES_MOAN, REFERENCE, SCIPY
from dem_bridge.verification.roles import POSITIONAL, THEORY, TWIN
from dem_bridge.verification.verification import Verification

NAMES = {
    **dict.fromkeys(ENGINE_BACKENDS, "LAMMPS"),
    TWIN: "twin",
    POSITIONAL: "twin in positions",
    REFERENCE: "reference",
    SCIPY: "scipy",
    BLANES_MOAN: "Blanes-Moan",
    THEORY: "BCA",
}
#: tables that the page of a verification shows in another form
_SHOWN_OTHERWISE = ("claims", "verdicts")


def verification_files(study: Verification, store: Store | None = None) -> dict[str, str | bytes]:
    """Return the files of a verification by name, for the paper with an RO-Crate; pictures are kept in ``store``."""
    files = study_files(study, store, template=("verification.html.j2", __package__), **_shown(study, store))
    files |= {motion.link: motion.file.read_bytes() for motion in _proved(study)}
    if study.claims:
        files[records.NAME] = records.crate(study, files)
    return files


def _proved(study: Verification) -> list[ProvedMotion]:
    """Return the proved motions of the scenes; their certificates are files of the report."""
    motions = (proved_motion(item.scene) for item in study.studies)
    return [motion for motion in motions if motion is not None]


def _played(study: Verification) -> list[Chain]:
    """Return what the page plays."""
    by_name = {item.scene.name: item for item in study.studies}
    names = [name for name in study.played if name in by_name] or list(by_name)
    return [chain for name in names for chain in chains_of(by_name[name])]


def _shown(study: Verification, store: Store | None) -> dict[str, Any]:
    """Return what the page shows beside the parts that every study has."""
    pictures = begin_pictures(study, store)
    # scenes of the paper without refinement levels have no figures of their own
    with_figures = with_figures_of(study)
    scales = [panel for figure in study.figures if figure.id == "scale" for panel in figure.panels]
    errors = scales[0] if scales else error_scale(study.studies)
    of = {"outcomes": outcomes_of(study.verdicts, "LAMMPS and of our codes")} if study.claims else {}
    return of | {
        "banners": sorted(
            (banner_of(chain, study.accuracy) for chain in study.studies),
            key=lambda banner: SEVERITY.index(banner.outcome),
        ),
        "chains": shown_chains(_played(study)),
        "scale": None if errors is None else error_scale_of(errors),
        "picture_of": pictures,
        "certificates": [motion.link for motion in _proved(study)],
        "paper": bool(study.claims),
        "scope": scope(study),
        "sketch": lambda chain: Markup(scene_sketch(chain.scene)),
        "tables": [table for table in study.tables if table.id not in _SHOWN_OTHERWISE],
        "kinds": KINDS,
        "valued": valued(study.claims),
        "with_figures": with_figures,
        "with_theory": lambda pair: any(chain.run(THEORY) is not None for chain in pair),
        "names": NAMES,
        "backends": tuple(BACKENDS),
        "shares": recall(store, "shared modules", [], matrix, kinds=[Shared]),
        "answers_through": ANSWERS_THROUGH,
    }


def picture_of_verification(study: Verification) -> str:
    """Return the HTML of the motion of the first scene for a notebook; empty where it was not run."""
    from dem_bridge.verification.figures import spacetime_maps  # imports matplotlib

    figure = spacetime_maps(study.studies[:1])
    return "" if figure is None else picture(figure, f"velocity of each body: {study.studies[0].scene.name}")


TEXTS = Texts("scope", "dem_bridge.verification")
PARTS = ("use", "domain", "tolerances", "code", "solution", "validation")


def scope(verification: Verification) -> tuple[tuple[str, str], ...]:
    """Return headings with their paragraphs; numbers follow from the scenes and the verdicts."""
    scenes = [study.scene for study in verification.studies]
    if not scenes:
        return ()
    counts = Counter(verdict.outcome for verdict in verification.verdicts)
    budgets = [budget for study in verification.studies for budget in study.budgets]
    exponents = np.concatenate([scene.contacts.exponent for scene in scenes])
    stiffness = np.concatenate([scene.contacts.stiffness for scene in scenes])
    features = sorted({feature.label for scene in scenes for feature in scene.features})
    values = {
        "scenes": len(scenes),
        "bodies": _range([scene.n_body for scene in scenes]),
        "stiffness": _range(stiffness),
        "exponents": _range(exponents),
        "speed": max(float(np.max(np.abs(scene.velocity))) for scene in scenes),
        "features": ", ".join(features) or "none",
        "accuracy": verification.accuracy,
        "verdicts": counts.total(),
        "passed": counts[Outcome.PASS],
        "budgets": len(budgets),
        "unexplained": sum(budget.is_finding for budget in budgets),
    }
    return tuple((TEXTS(part, "headings"), TEXTS(part, **values)) for part in PARTS)


def _range(values: Sequence[float] | NDArray[np.float64]) -> str:
    """Return the least and the largest of some values as text, or the value if all are the same."""
    ends = [f"{value:.3g}" for value in (np.min(values), np.max(values))]
    return ends[0] if ends[0] == ends[1] else f"{ends[0]} to {ends[1]}"
