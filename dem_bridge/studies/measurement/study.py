"""Study of a measurement: measured values beside a scene, each difference with its validation uncertainty.

The comparison is that of ASME V&V 20 (:mod:`dem_bridge.studies.measurement.comparison`); named parameters are fitted.
It is validation: a difference beyond the uncertainties says that the scene, with its parameters, is not what was
measured. No code is wrong then, so the outcome is MODEL_DIFFERENCE and never FAIL.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dem_bridge.backends.base import ENGINE_BACKENDS, unsupported_reason
from dem_bridge.backends.base import backend as backend_named
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.columns import PERCENT, Column
from dem_bridge.report.study import FigureData, Panel, Series, Study, check_setting
from dem_bridge.report.texts import Texts
from dem_bridge.runs.campaign import Progress
from dem_bridge.runs.store import Store
from dem_bridge.scene.file.load import Measurement
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.measurement.comparison import Comparison, Joint, compare, deviations_of
from dem_bridge.studies.measurement.fit import LEVEL, Fit, Fitted, chosen, fit_parameters
from dem_bridge.studies.measurement.parameters import KINDS, parameters_of
from dem_bridge.studies.measurement.prediction import Prediction
from dem_bridge.studies.measurement.readings import QUANTITIES, Reading, checksum, read_measurement
from dem_bridge.studies.measurement.scalars import Scalar, joint_of, scalars_of
from dem_bridge.studies.recalled import recall_study
from dem_bridge.trajectory.trajectory import Floats

TEXTS = Texts("measurement", "dem_bridge.studies")
JOINT_COLUMNS = ("values together", "number", "statistic", "p")
FIT_COLUMNS = ("parameter", "unit", "change", "standard uncertainty", "low", "high", "declared uncertainty")
SCALARS_COLUMNS = ("scalar", "place", "unit", "S", "D", "E", "u_num", "u_input", "u_D", "u_val", "outcome")
SERIES_COLUMNS = (
    "series", "unit", "values", "E", "u_num", "u_input", "u_D", "largest |E| / u_val", Column("within", PERCENT),
)  # fmt: skip
#: sentences of an outcome, on the values and on the fitted parameters
_SENTENCES = {
    Outcome.PASS: ("agrees", "parameters-agree"),
    Outcome.MODEL_DIFFERENCE: ("differs", "parameters-differ"),
    Outcome.UNDECIDED: ("undecided", "parameters-undecided"),
}
#: a joint statistic that a right model exceeds as rarely as ``coverage`` standard deviations is undecided; as rarely as
#: this many more, it is a difference of the model. With coverage 2: once in 22 and once in 370 right models
BEYOND = 1.0
#: largest number of series that are drawn
MOST_PANELS = 6
#: factor and unit of times in tables and figures
_MICRO = 1e6
#: value of parameters of the measurement that changes nothing
_BASE = {"gain": "1", "time": "0"}
_UNIT = {"velocity": "m/s", "displacement": "m", "contact_force": "N"}


def study_measurement(
    scene: Scene,
    *,
    measurement: Measurement | None = None,
    files: Sequence[str] = (),
    parameters: Sequence[str] = (),
    fit: Sequence[str] = (),
    coverage: float = 2.0,
    samples: int = 100,
    seed: int = 0,
    backend: str = "reference",
    dt: float | None = None,
    progress: Progress | None = None,
    store: Store | None = None,
) -> Study:
    """Compare measured values with a scene, each difference with its validation uncertainty, and fit parameters.

    Each difference E = S - D of a simulated and a measured value stands beside u_val = sqrt(u_num^2 + u_input^2 +
    u_D^2), after ASME V&V 20-2009: the numerical uncertainty of the run, that of the parameters by sampling, and that
    of the measured value. The values and the uncertain parameters are those of the table [measurement] of the scene
    file.

    Parameters
    ----------
    scene : Scene
        Scene that was measured.
    measurement : Measurement, optional
        Table [measurement] of the scene file.
    files : sequence of str
        CSV file of measured values, in place of those that the scene file names.
    parameters : sequence of str
        Uncertain parameter as NAME=UNCERTAINTY, such as stiffness=0.02, in addition to those of the scene file.
    fit : sequence of str
        Name of a parameter to fit. The default is that of the scene file.
    coverage : float
        Factor k of the validation uncertainty.
    samples : int
        Number of samples of the parameters.
    seed : int
        Seed of the samples.
    backend : str
        Code of the run that is compared.
    dt : float, optional
        Time step of this run, s.
    progress, store : as in :func:`dem_bridge.study`

    Returns
    -------
    Study

    Raises
    ------
    UsageError
        If there is no measurement, if a file, a value or a parameter is not allowed, or for a setting out of its range.
    UnsupportedScene
        If the backend does not support the scene.
    """
    check_setting("coverage", coverage, "a number > 0, up to 10", most=10.0)
    check_setting("samples", samples, "a whole number from 10 to 100000", least=10, most=100_000)
    check_setting("seed", seed, "a whole number >= 0", least=0)
    measurement = _completed(scene, measurement, files, parameters, fit)
    declared = parameters_of(measurement.parameters, scene)
    chosen(declared, measurement.fit)
    if reason := unsupported_reason(backend_named(backend), scene):
        raise UnsupportedScene(f"{scene.name}: {reason}")
    readings = read_measurement(measurement.files, scene)
    prediction = Prediction(scene=scene, readings=readings, backend=backend, dt=dt)
    settings: dict[str, Any] = {"coverage": coverage, "samples": samples, "seed": seed}
    of_files = {file.name: checksum(file) for file in measurement.files}

    def compared() -> Study:
        return _study(prediction, measurement, of_files, **settings, progress=progress)

    return recall_study(
        "measurement",
        store,
        compared,
        scene,
        Engine.chosen() if backend in ENGINE_BACKENDS else None,
        **settings,
        **{"backend": backend, "dt": dt, "measurement": {**vars(measurement), "files": of_files}},
    )


def _study(
    prediction: Prediction,
    measurement: Measurement,
    of_files: Mapping[str, str],
    *,
    coverage: float,
    samples: int,
    seed: int,
    progress: Progress | None,
) -> Study:
    """Compare, fit and return the study; ``of_files``: checksums of the files by name."""
    scene, readings, backend = prediction.scene, prediction.readings, prediction.backend
    declared = parameters_of(measurement.parameters, scene)
    to_fit, others = chosen(declared, measurement.fit)
    compared = compare(prediction, declared, count=samples, seed=seed, progress=progress)
    fitted = fit_parameters(prediction, to_fit, others, compared.measured, compared.noise) if to_fit else None
    scalars = scalars_of(prediction, compared)
    verdicts = [_verdict(scene, compared, scalars, quantity, coverage, backend) for quantity in _quantities(readings)]
    if fitted is not None and fitted.declared is not None:
        verdicts.append(_verdict_on_parameters(scene, fitted, fitted.declared, coverage, backend, compared.linear))
    what = {"scene": scene.name, "name": measurement.name, "k": f"{coverage:g}"}
    return TEXTS.study(
        {**what, "source": measurement.source or "not stated", "samples": samples},
        answer=tuple(_answer(compared, fitted, verdicts, what, coverage)),
        tables=(
            TEXTS.table("joint", JOINT_COLUMNS, _joint_rows(compared, scalars, fitted)),
            *([TEXTS.table("fit", FIT_COLUMNS, map(_fit_row, fitted.fitted))] if fitted and fitted.fitted else []),
            *(
                [TEXTS.table("scalars", SCALARS_COLUMNS, [_scalar_row(item, coverage) for item in scalars])]
                if scalars
                else []
            ),
            TEXTS.table("series", SERIES_COLUMNS, [_series_row(compared, item, coverage) for item in readings]),
        ),
        figures=tuple(_figures(compared, fitted, measurement.name, coverage)),
        verdicts=tuple(verdicts),
        files={"differences.csv": lambda: _csv(compared, coverage)},
        provenance={
            "scene": scene.name,
            "scene_hash": scene.content_hash,
            "files": dict(of_files),
            "source": measurement.source,
            "kind": measurement.kind,
            "parameters": dict(measurement.parameters),
            "fit": [item.name for item in to_fit],
            **{"coverage": coverage, "samples": samples, "seed": seed},
            "run": dict(prediction.run.provenance),
        },
    )


def _completed(
    scene: Scene, measurement: Measurement | None, files: Sequence[str], parameters: Sequence[str], fit: Sequence[str]
) -> Measurement:
    """Return the measurement with the files, parameters and fit of the command."""
    if not files and (measurement is None or not measurement.files):
        raise UsageError(
            f"{scene.name} has no file of measured values; allowed: the path of a scene file (a loaded Scene does not"
            " hold it) with [measurement] file = 'NAME.csv', or --file NAME.csv (in Python: files=['NAME.csv'])"
        )
    base = measurement or Measurement(files=())
    declared = dict(base.parameters)
    for text in parameters:
        name, _, number = text.partition("=")
        try:
            declared[name.strip()] = float(number)
        except ValueError:
            raise UsageError(f"parameter = {text!r}; allowed: NAME=UNCERTAINTY, such as stiffness=0.02") from None
    return Measurement(
        files=tuple(map(Path, files)) or base.files,
        source="" if files else base.source,
        kind="measured" if files else base.kind,
        parameters=declared,
        fit=tuple(fit) or base.fit,
    )


def _quantities(readings: Sequence[Reading]) -> list[str]:
    return list(dict.fromkeys(reading.quantity for reading in readings))


def _verdict(
    scene: Scene, compared: Comparison, scalars: Sequence[Scalar], quantity: str, coverage: float, backend: str
) -> Verdict:
    """Return the verdict on all values of a quantity, by the joint statistics of the values and of the pulses."""
    rows = compared.of(quantity)
    values, pulses = _joints(compared, scalars, quantity)
    # two tests: the smaller probability counts twice
    p = values.p if pulses is None else min(1.0, 2.0 * min(values.p, pulses.p))
    scale = float(np.max(np.abs(compared.simulated[rows]))) or 1.0
    outcome = outcome_of(p, coverage, compared.linear) if compared.decides(quantity, coverage) else Outcome.UNDECIDED
    nonlinear = not compared.linear and outcome is Outcome.UNDECIDED
    error, validation = (
        float(np.sqrt(np.mean(part[rows] ** 2))) / scale for part in (compared.error, compared.validation)
    )
    words = quantity.replace("_", " ")
    return Verdict(
        scene=scene.name,
        quantity=quantity,
        backend=backend,
        reference="measurement",
        outcome=outcome,
        sentence=TEXTS(
            "nonlinear" if nonlinear else _SENTENCES[outcome][0],
            quantity=words,
            error=error,
            validation=validation,
            p=p,
        ),
        difference=error,
        scale=scale,
        unit=QUANTITIES[quantity].unit,
        scale_name=f"the largest simulated {words}",
        uncertainty=validation,
        tolerance=coverage * validation,
        meaning="model, parameters and measurement",
    )


def _joints(compared: Comparison, scalars: Sequence[Scalar], quantity: str) -> tuple[Joint, Joint | None]:
    """Return the joint comparisons of the values of a quantity, and of the arrivals and peaks of its pulses."""
    return compared.joint(quantity), joint_of([item for item in scalars if item.reading.quantity == quantity], compared)


def _verdict_on_parameters(
    scene: Scene, fitted: Fit, declared: Joint, coverage: float, backend: str, linear: bool
) -> Verdict:
    """Return the verdict on the fitted parameters: whether the scene's values have their declared uncertainties."""
    outcome, p = outcome_of(declared.p, coverage, linear), declared.p
    names = ", ".join(item.parameter.name for item in fitted.fitted)
    largest = max(fitted.fitted, key=lambda item: abs(item.change) / item.parameter.uncertainty)
    return Verdict(
        scene=scene.name,
        quantity="parameters",
        backend=backend,
        reference="measurement",
        outcome=outcome,
        sentence=TEXTS(_SENTENCES[outcome][1], names=names, p=p),
        difference=abs(largest.change),
        scale=1.0,
        unit=KINDS[largest.parameter.kind].unit,
        scale_name=f"the scene's {largest.parameter.kind}",
        uncertainty=largest.uncertainty,
        tolerance=coverage * largest.parameter.uncertainty,
        meaning="parameters of the scene",
    )


def outcome_of(p: float, coverage: float, linear: bool) -> Outcome:
    """Return PASS, UNDECIDED or MODEL_DIFFERENCE; the limits are those of :data:`BEYOND`.

    Where the simulation is not linear (:attr:`Comparison.linear`), the statistic is at least that of chi-square: such a
    value still shows agreement, but no difference.
    """
    deviations = deviations_of(p)
    if deviations <= coverage:
        return Outcome.PASS
    return Outcome.UNDECIDED if deviations <= coverage + BEYOND or not linear else Outcome.MODEL_DIFFERENCE


def _answer(
    compared: Comparison, fitted: Fit | None, verdicts: Sequence[Verdict], what: Mapping[str, str], coverage: float
) -> Iterator[str]:
    for verdict in verdicts:
        yield verdict.sentence
    if fitted is not None and fitted.undetermined:
        yield TEXTS("undetermined", names=" and ".join(fitted.undetermined))
    elif fitted is not None:
        parts = [TEXTS("fitted-one", name=item.parameter.name, **_interval(item)) for item in fitted.fitted]
        yield TEXTS("fitted", parts="; ".join(parts), level=LEVEL)
        explained = fitted.joint.deviations <= coverage + BEYOND
        before, after = compared.joint(), fitted.joint
        ratios = {"before": before.statistic / before.count, "after": after.statistic / after.count, "p": after.p}
        yield TEXTS("explained" if explained else "unexplained", **ratios)
    share = compared.share_within(coverage)
    yield TEXTS("share", share=share, count=len(compared.error), **what)


def _interval(item: Fitted) -> dict[str, str]:
    """Return the change of a fitted parameter, and the ends of its interval, in words with two digits of its width.

    >>> from dem_bridge.studies.measurement.parameters import Parameter
    >>> stiffness = Parameter(kind="stiffness", place=None, uncertainty=0.01)
    >>> _interval(Fitted(parameter=stiffness, change=0.0203, uncertainty=1.4e-3, low=0.0175, high=0.0231))
    {'amount': "2.03 % +- 0.28 % above the scene's value", 'low': '1.75 %', 'high': '2.31 %'}
    """
    unit = KINDS[item.parameter.kind].unit
    factor, shown = {"": (100.0, " %"), "s": (_MICRO, " µs"), "1": (1.0, "")}.get(unit, (1.0, f" {unit}"))
    half = 0.5 * factor * (item.high - item.low)
    digits = min(max(0, 1 - math.floor(math.log10(half))), 9) if half > 0.0 else 3
    change, low, high = (factor * value for value in (item.change, item.low, item.high))
    side, base = "above" if change >= 0.0 else "below", _BASE.get(item.parameter.kind, "the scene's value")
    return {
        "amount": f"{abs(change):.{digits}f}{shown} +- {half:.{digits}f}{shown} {side} {base}",
        "low": f"{low:.{digits}f}{shown}",
        "high": f"{high:.{digits}f}{shown}",
    }


def _joint_rows(
    compared: Comparison, scalars: Sequence[Scalar], fitted: Fit | None
) -> Iterator[tuple[str | float, ...]]:
    for quantity in _quantities(compared.readings):
        names = quantity.replace("_", " "), f"peaks and arrivals of {quantity.replace('_', ' ')}"
        for name, joint in zip(names, _joints(compared, scalars, quantity), strict=True):
            if joint is not None:
                yield name, float(joint.count), joint.statistic, joint.p
    if fitted is not None and fitted.declared is not None:
        yield "all values, parameters fitted", float(fitted.joint.count), fitted.joint.statistic, fitted.joint.p
        declared = fitted.declared
        yield "fitted parameters, with declared uncertainties", float(declared.count), declared.statistic, declared.p


def _fit_row(item: Fitted) -> tuple[str | float, ...]:
    unit = KINDS[item.parameter.kind].unit or "relative"
    numbers = (item.change, item.uncertainty, item.low, item.high, item.parameter.uncertainty)
    return (item.parameter.name, unit, *numbers)


def _scalar_row(item: Scalar, coverage: float) -> tuple[str | float, ...]:
    factor = _MICRO if item.unit == "s" else 1.0
    numbers = (item.simulated, item.measured, item.error, item.numerical, item.input, item.data, item.validation)
    place = f"{QUANTITIES[item.reading.quantity].axis} {item.reading.place}"
    unit = "µs" if item.unit == "s" else item.unit
    return (item.name, place, unit, *(factor * number for number in numbers), item.word(coverage))


def _series_row(compared: Comparison, reading: Reading, coverage: float) -> tuple[str | float, ...]:
    rows = compared.rows(reading)
    parts = (compared.error, compared.numerical, compared.input, compared.data)
    rms = [float(np.sqrt(np.mean(part[rows] ** 2))) for part in parts]
    worst = float(np.max(np.abs(compared.error[rows]) / compared.validation[rows]))
    share = compared.share_within(coverage, rows)
    unit = QUANTITIES[reading.quantity].unit
    return (reading.label, unit, float(len(reading.value)), *rms, worst, share)


def _figures(compared: Comparison, fitted: Fit | None, name: str, coverage: float) -> Iterator[FigureData]:
    """Return the measured over the simulated series, and their differences with the validation uncertainty."""
    series = [reading for reading in compared.readings if reading.sampled and len(reading.value) > 1]
    if not series:
        return
    shown = [series[k] for k in np.unique(np.linspace(0, len(series) - 1, min(MOST_PANELS, len(series))).astype(int))]
    best = fitted.values if fitted is not None and fitted.fitted else None
    for id, panel in (("measurement-overlay", _overlay), ("measurement-differences", _differences)):
        panels = [panel(compared, reading, best, name, coverage) for reading in shown]
        yield TEXTS.figure(id, panels, name=name, k=f"{coverage:g}")


def _overlay(compared: Comparison, reading: Reading, best: Floats | None, name: str, coverage: float) -> Panel:
    rows = compared.rows(reading)
    x, simulated = _MICRO * reading.time, compared.simulated[rows]
    band = coverage * np.hypot(compared.numerical, compared.input)[rows]
    lines = [
        Series(label=f"simulation +- {coverage:g} (u_num, u_input)", style="band", x=x, y=simulated, bar=band),
        Series(label="simulation", style="black line", x=x, y=simulated),
        Series(label=name, style="mark-2", x=x, y=reading.value, bar=coverage * reading.uncertainty),
    ]
    if best is not None:
        lines.append(Series(label="fitted parameters", style="fit", x=x, y=best[rows]))
    return _panel("overlay", reading, lines)


def _differences(compared: Comparison, reading: Reading, best: Floats | None, name: str, coverage: float) -> Panel:
    rows = compared.rows(reading)
    x, limit = _MICRO * reading.time, coverage * compared.validation[rows]
    lines = [
        Series(label=f"+- {coverage:g} u_val", style="band", x=x, y=np.zeros_like(x), bar=limit),
        Series(label="E = S - D", style="line/0/2", x=x, y=compared.error[rows]),
    ]
    if best is not None:
        after = best[rows] - compared.measured[rows]
        lines.append(Series(label="with fitted parameters", style="fit", x=x, y=after))
    return _panel("differences", reading, lines)


def _panel(id: str, reading: Reading, lines: Sequence[Series]) -> Panel:
    quantity = reading.quantity.replace("_", " ")
    return TEXTS.panel(id, lines, label=reading.label, quantity=quantity, unit=_UNIT[reading.quantity])


def _csv(compared: Comparison, coverage: float) -> str:
    """Return all values as CSV: quantity, place, time, S, D, E and the parts of u_val, in SI."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("quantity", "place", "time_s", "S", "D", "E", "u_num", "u_input", "u_D", "u_val", "outcome"))
    arrays = [compared.simulated, compared.measured, compared.error, compared.numerical, compared.input]
    columns = [array.tolist() for array in (*arrays, compared.data, compared.validation)]
    places = [(item.quantity, item.place, time) for item in compared.readings for time in item.time.tolist()]
    for place, *numbers in zip(places, *columns, compared.words(coverage), strict=True):
        writer.writerow((*place, *numbers))
    return text.getvalue()
