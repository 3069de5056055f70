"""Provide a paper as large as a real one, with invented numbers, for tests of pages and bundles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.study import Claim, ClaimValue, FigureData, Headline, Map, Panel, Points, Series, Table
from dem_bridge.verification.verification import Verification, verification_of

_STATEMENT = (
    "The residence time of the wave in the decelerating chain grows monotonically along the chain, while the wave"
    " speed in the accelerating chain rises from about 320 m/s to 590 m/s",
    "Binary collisions predict the arrival time to within 2 %",
    "The spectrum does not cascade to lower frequencies",
    "The maximum contact force goes as beta^(2/5)",
)
_SENTENCE = (
    "Largest residence time 41.23 µs by the reference (± 3e-11 µs), 41.23 µs by LAMMPS (± 1e-5 µs), 41.31 µs by ode45:"
    " of the 6.1 % that binary collisions differ, 5.9 % are the theory and 0.2 % the paper's own integration; at the"
    " last ten cylinders the order is reversed.",
    "0.398 ± 0.004 over windows of 20 to 120 cylinders.",
    "Static compression and impact <b>cannot</b> be told apart here: no run.",
)
_OUTCOMES = (Outcome.PASS, Outcome.PASS, Outcome.FAIL, Outcome.MODEL_DIFFERENCE, Outcome.UNDECIDED, Outcome.NOT_RUN)
_BACKENDS = ("paper", "reference", "lammps-granular", "ode45", "bca", "adiabatic")


#: a verification of no scenes
NOTHING = verification_of((), accuracy=1e-3, wall=0.0)


def fake_paper(verification: Verification = NOTHING) -> Verification:
    """Return a verification with 20 claims, 6 tables of up to 200 rows and 14 columns, 5 figures.

    Its claims and two tables are those of the study of the paper: where no studies are installed the test is skipped.
    """
    paper = pytest.importorskip("dem_bridge.studies.paper.study")
    kinds = pytest.importorskip("dem_bridge.studies.paper.claims").KINDS
    wrong_table = pytest.importorskip("dem_bridge.studies.paper.opening").wrong_table
    claims = tuple(_claim(i, kinds) for i in range(20))
    return replace(
        verification,
        id="paper",
        title="Chaunsali, Kim & Yang (2018), claim by claim",
        answer=(
            "The paper's chains do accelerate and decelerate the front as it says, by 44 % and 31 %.",
            "17 of its 20 statements hold within error bars; 3 do not, and each is named with its number below.",
            "The largest term of the whole budget is the contact stiffness: the approximate formula is 17.8 % too stiff"
            " at 2 degrees, which moves residence times by 6.8 %.",
            "LAMMPS, ode45 and binary collisions differ from the reference by 1.1e-6, 3.6e-3 and 6.1e-2.",
            "Dissipation, which the paper leaves out, takes 12 % of the front's energy over 40 cylinders.",
        ),
        headlines=(
            Headline(
                number="1.1e-06", sentence="largest velocity error of LAMMPS. Cause: the time step & nothing else."
            ),
            Headline(number="2.3 %", sentence="largest error of the BCA in the arrival at the last cylinder."),
            Headline(number="8 of 20", sentence="statements of the paper hold; 4 do not."),
        ),
        abstract=(
            Points(heading="Question", points=("Does LAMMPS solve the equations?", "Do 20 statements hold?", "Where?")),
            Points(heading="Method", points=("12 scenes by 3 codes.", "5e-06 was fixed beforehand.", "2 references.")),
            Points(
                heading="Result", points=("Of 400 comparisons 385 pass.", "8 of 20 hold.", "The mass & the weight.")
            ),
            Points(heading="Criteria", points=("They are ours.",)),
        ),
        not_verified=(
            "The experiment: its chains are compared by what is printed, for no raw data are published.",
            "Plastic flow at the contacts beyond 1.1 GPa.",
            *verification.not_verified,
        ),
        claims=claims,
        tables=(paper.claims_table(claims), wrong_table(claims), _budget(), *_tables(), *verification.tables),
        figures=(_figure(2), _scale(), *(_figure(i) for i in range(3, 7))),
    )


def _claim(i: int, kinds: Mapping[Outcome, str]) -> Claim:
    outcome = _OUTCOMES[i % len(_OUTCOMES)]
    values = tuple(
        ClaimValue(
            name="largest residence time" if i % 2 else "exponent of the peak force against the stiffness",
            backend=backend,
            value=41.23456789e-6 * (1 + 1e-3 * k) if backend != "paper" else 4.1e-5,
            uncertainty=float("nan") if backend in ("paper", "bca") else 10.0 ** -(9 + k),
            unit="s",
        )
        for k, backend in enumerate(_BACKENDS)
    )
    return Claim(
        id=f"C{i + 1}" if i % 5 else f"mass-gradient-amplification-{i}",
        where=f"section {3 + i % 4}, figure {2 + i % 5}{'ab'[i % 2]}",
        statement=_STATEMENT[i % len(_STATEMENT)],
        outcome=outcome,
        sentence=_SENTENCE[i % len(_SENTENCE)],
        kind=kinds.get(outcome, "limit"),
        values=() if outcome is Outcome.NOT_RUN else values,
    )


def _budget() -> Table:
    rows = (
        ("contact stiffness: approximate for exact Hertz law", "parameter", 0.178, 0.068, 0.061, "angle 2 degrees"),
        ("dissipation left out (dashpot, restitution 0.96)", "model", float("nan"), 0.021, 0.12, "fitted"),
        ("scatter of the contact angles, 0.5 degrees", "parameter", 0.05, 0.031, 0.044, "300 chains, seeded"),
        ("Young's modulus ± 2 %", "parameter", 0.02, 0.008, 0.008, "beta^(2/5)"),
        ("ode45 at its default tolerances", "numerics", float("nan"), 3.6e-3, 3.6e-3, "the paper's method"),
        ("LAMMPS: time step 1e-8 s", "numerics", float("nan"), 1.5e-6, 1.1e-6, "twin"),
        ("LAMMPS: round-off", "numerics", float("nan"), 2.2e-11, 1.7e-9, "twin in positions"),
    )
    return Table(
        id="budget",
        title="The whole budget, model and parameters included",
        caption="Change of each observable by each cause, relative; largest first.",
        columns=("cause", "kind", "of beta", "residence time", "velocity", "from"),
        rows=rows,
    )


def _tables() -> tuple[Table, ...]:
    rng = np.random.default_rng(5)
    validity = [
        (k, "cylinder on cylinder" if k else "sphere on cylinder", *(10.0 ** rng.uniform(-9, 9, 12)).tolist())
        for k in range(40)
    ]
    gammas = [
        (round(g, 3), float(rng.normal()), float(rng.normal()) if g else "", "PASS")
        for g in np.linspace(-0.02, 0.02, 9)
    ]
    words = [
        (f"m{i}", "A finding about an inconsistency in print, in a sentence that is long. " * (1 + i % 3), "FAIL")
        for i in range(12)
    ]
    return (
        Table(
            id="validity",
            title="Validity of the model, contact by contact",
            caption="Where Hertz' theory ends.",
            columns=(
                "contact", "kind", "angle (degrees)", "beta exact (N/m^1.5)", "beta approximate (N/m^1.5)",
                "semi-major axis (m)", "half-height (m)", "pressure (Pa)", "strength (Pa)", "contact time (s)",
                "sound across (s)", "static force (N)", "dynamic force (N)", "ratio",
            ),
            rows=tuple(validity),
        ),
        Table(
            id="scatter",
            title="Scatter of the contact angles",
            caption="200 seeded chains.",
            columns=("chain", "arrival (ms)", "velocity (m/s)", "force (N)", "outcome"),
            rows=tuple(
                (k, *rng.normal(size=3).tolist(), ("PASS", "UNDECIDED")[k % 2]) for k in range(200)
            ),
        ),
        Table(
            id="gradients",
            title="Mass gradients",
            caption="Figure 6.",
            columns=("gamma", "V out / V in", "bar", "outcome"),
            rows=tuple(gammas),
        ),
        Table(
            id="inconsistencies",
            title="Inconsistencies of the paper",
            caption="Each with its effect.",
            columns=("id", "what", "outcome"),
            rows=tuple(words),
        ),
        Table(id="empty", title="Nothing", caption="No rows.", columns=("a", "b"), rows=()),
    )  # fmt: skip


def _scale() -> FigureData:
    """Return errors on one scale, with headings that have no value."""
    rows = ("Errors:", "reference", "LAMMPS, round-off", "LAMMPS, time step", "ode45", "Effects:", "BCA: arrival")
    kinds = ("", "round-off", "round-off", "time step", "", "", "model")
    x, y = np.array([1e-12, 1.7e-9, 1.1e-6, 3.6e-3, 2.3e-2]), np.array([1.0, 2.0, 3.0, 4.0, 6.0])
    series = (
        Series(label="slow", style="mark-2", x=x, y=y),
        Series(label="fast", style="mark-3", x=0.4 * x, y=y),
        Series(label="tolerance", style="guide", x=np.full(2, 5e-6), y=np.array([1.5, 3.5])),
    )
    panel = Panel(title="(e)", x_label="difference", y_label="", series=series, rows=rows, row_kinds=kinds)
    return FigureData(id="scale", title="Every difference on one scale", caption="Numerical errors.", panels=(panel,))


def _figure(i: int) -> FigureData:
    x, t = np.arange(1.0, 41.0), np.linspace(0.0, 1.0, 80)
    wave = Map(
        label="velocity (m/s)",
        x=x,
        y=t,
        values=np.exp(-((t[:, None] * 40 - x[None, :]) ** 2) / (4 + i)),
        diverging=False,
    )
    line = Series(label="reference", style="reference", x=x, y=np.sqrt(x + i), bar=np.full(40, 1e-3))
    fit = Series(label="fit", style="fit", x=x, y=np.sqrt(x))
    return FigureData(
        id=f"figure-{i}",
        title=f"Figure {i}: velocity and its power law",
        caption="Left: by the reference. Right: the same along the front, with the fit of the paper. " * 2,
        panels=(
            Panel(title="(a) slow", x_label="cylinder", y_label="time (ms)", map=wave),
            Panel(title="(b) along the front", x_label="cylinder", y_label="velocity (m/s)", series=(line, fit)),
        ),
    )
