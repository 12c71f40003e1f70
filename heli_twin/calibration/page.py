"""`calibration.html`: the parameters against the prior, correlations, residuals, and prediction against flight."""

import html
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from controllers.signals import Array
from heli_twin.calibration import noise
from heli_twin.calibration.calibrate import EFFECTS, Calibrated
from heli_twin.calibration.data import BIN_STEPS, BINS, CHANNELS, STEP_S
from heli_twin.calibration.parameters import NAMES, POSITIVE, SPREAD
from heli_twin.calibration.structure import WORST_CORRELATION, WORST_MEMORY
from heli_twin.calibration.unknowns import FIXED
from heli_twin.reporting.figure import Curve, Dots, Figure, Heat, Panel, Table
from heli_twin.reporting.html_page import Section, html_page, table_section
from heli_twin.reporting.svg import write_svg
from heli_twin.whole_file import write_whole

SHOWN_WINDOWS = 4
"""Windows of prediction and flight that are shown."""
BIN_S = BIN_STEPS * STEP_S
Z_95 = 1.959964
STYLE = " section svg { max-width: 100%; height: auto; }"


def write_page(calibrated: Calibrated, path: Path) -> None:
    """Write the page; it needs no network."""
    sections = [
        table_section(_verdict(calibrated)),
        table_section(_parameters(calibrated)),
        *map(
            _drawn, (_against_prior(calibrated), _correlations(calibrated), _residuals(calibrated), _flight(calibrated))
        ),
        table_section(_noise(calibrated)),
    ]
    question = (
        f"What do {calibrated.seconds:.0f} s of {len(calibrated.logs)} flights tell of this helicopter, and what not?"
    )
    write_whole(path, html_page("Calibration", question, sections, style=STYLE).encode())


def _drawn(figure: Figure) -> Section:
    with TemporaryDirectory() as folder:
        file = Path(folder) / f"{figure.name}.svg"
        write_svg(figure, file)
        drawing = file.read_text(encoding="utf-8")
    # The names in one drawing must not meet those in another.
    drawing = drawing[drawing.index("<svg") :].replace('id="', f'id="{figure.name}-')
    drawing = drawing.replace('href="#', f'href="#{figure.name}-').replace("url(#", f"url(#{figure.name}-")
    return Section(figure.title, f"<p>{html.escape(figure.sentence)}</p>{drawing}")


def _verdict(calibrated: Calibrated) -> Table:
    known, form = calibrated.parameters, calibrated.structure
    untold = [name for name in NAMES if name in known and not known[name].told]
    channel, statistic, ratio = form.worst
    rows = [
        ("flights", ", ".join(Path(log).name for log in calibrated.logs)),
        ("told", f"{sum(k.told for k in known.values())} of {len(known)} parameters"),
        ("not told: the prior speaks", ", ".join(untold) or "none"),
        ("effects that it has", ", ".join(calibrated.kept) or "none"),
        ("effects that are left out", ", ".join(name for name in EFFECTS if name not in calibrated.kept) or "none"),
        (
            "form of the twin",
            f"{'explains these flights' if ratio <= 1.0 else 'is wrong'}: worst residual {channel}, {statistic},"
            f" {ratio:.2f} of its limit",
        ),
        ("taken as given", f"mass {calibrated.mass:g} kg, inertia about the port axis"),
        *(("remark", text) for text in calibrated.remarks),
    ]
    return Table("Verdict", "What the flights tell, and how far the twin explains them.", ("", ""), rows)


def _parameters(calibrated: Calibrated) -> Table:
    rows = [
        (name, f"{k.value:.4g}", f"{k.low:.4g} to {k.high:.4g}", k.unit, "" if k.told else "not told: the prior speaks")
        for name, k in calibrated.parameters.items()
    ]
    return Table(
        "Parameters",
        f"Ratios and sums that flights can tell, with 95 % intervals: {calibrated.fit.wider:g} times those of the fit's"
        " covariance alone.",
        ("parameter", "value", "95 % interval", "unit", ""),
        rows,
    )


def _free(calibrated: Calibrated) -> list[int]:
    return [i for i in range(len(NAMES)) if calibrated.fit.problem.spread[i] > FIXED]


def _against_prior(calibrated: Calibrated) -> Figure:
    fit, free = calibrated.fit, _free(calibrated)
    mean = (fit.state.theta - fit.problem.prior)[free] / SPREAD[free]
    half = Z_95 * fit.deviation[free] / SPREAD[free]
    names = [NAMES[i] + (" (log)" if POSITIVE[i] else "") for i in free]
    n = len(free)
    believed = Dots("prior, 95 %", names, np.zeros(n), np.full(n, -Z_95), np.full(n, Z_95), color=7)
    told = Dots("calibrated, 95 %", names, mean, mean - half, mean + half, color=0)
    panel = Panel("", "standard deviations of the prior", "", [believed, told])
    return Figure(
        "prior",
        "Against the prior",
        "Distances from what was believed. Where a blue interval is as long as the grey one, the flights tell nothing.",
        [panel],
    )


def _correlations(calibrated: Calibrated) -> Figure:
    free = _free(calibrated)
    covariance = calibrated.fit.covariance[np.ix_(free, free)]
    scale = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(scale, scale)
    at = np.arange(len(free), dtype=np.float64) + 1.0
    pairs = sorted(
        ((abs(correlation[i, j]), i, j) for i in range(len(free)) for j in range(i)),
        reverse=True,
    )[:5]
    text = ", ".join(f"{NAMES[free[i]]} and {NAMES[free[j]]} {correlation[i, j]:+.2f}" for _, i, j in pairs)
    numbers = ", ".join(f"{k} {NAMES[i]}" for k, i in enumerate(free, 1))
    panel = Panel("posterior correlation", "parameter", "parameter", [Heat(at, at, correlation, "", diverging=True)])
    return Figure("correlations", "Correlations", f"Strongest: {text}. Numbers: {numbers}.", [panel])


def _residuals(calibrated: Calibrated) -> Figure:
    form = calibrated.structure
    panels = [
        Panel(
            f"{channel}: past {form.memory[channel]:.1f} of {WORST_MEMORY:g}, commands"
            f" {form.correlation[channel]:.1f} of {WORST_CORRELATION:g}",
            "lag (s)",
            "autocorrelation",
            [
                Curve(
                    "whitened residual", BIN_S * np.arange(len(curve), dtype=np.float64), curve, style="steps", color=2
                )
            ],
        )
        for channel, curve in form.curves.items()
    ]
    return Figure(
        "residuals",
        "Residuals",
        "Autocorrelation of what is left over, whitened: of a right twin only lag 0 is not zero. The titles have the"
        " statistics in units of their 95 % values, and their limits.",
        panels,
    )


def _flight(calibrated: Calibrated) -> Figure:
    count = len(calibrated.fit.problem.log_of)
    shown = np.unique(np.linspace(0, count - 1, min(SHOWN_WINDOWS, count)).round().astype(int))
    panels: list[Panel] = []
    for i, channel in enumerate(CHANNELS):
        factor, unit = (100.0, "cm") if i < 3 else (np.degrees(1.0), "deg")
        pieces = [_window(calibrated, int(w), at, i) for at, w in enumerate(shown)]
        t, seen, twin = (np.concatenate(column) for column in zip(*pieces, strict=True))
        panels.append(
            Panel(
                channel,
                "time in the windows (s)",
                unit,
                [
                    Curve("flight", t, factor * seen, style="steps", color=0),
                    Curve("twin", t, factor * twin, style="dashes", color=1),
                ],
            )
        )
    return Figure(
        "flight",
        "Prediction against flight",
        f"{len(shown)} windows of 2 s, one behind the other: the twin flies each in open loop from a fitted first"
        " state; what differs slowly in x and y is wind.",
        panels,
    )


def _window(calibrated: Calibrated, window: int, place: int, channel: int) -> tuple[Array, Array, Array]:
    """Time, poses and prediction of one channel of a window, about the window's mean; NaN where there is no pose."""
    problem = calibrated.fit.problem
    seen = np.where(problem.present[window], problem.y[window, :, channel], np.nan)
    middle = float(np.nanmean(seen))
    twin = np.where(problem.present[window], calibrated.fit.predicted[window, :, channel], np.nan)
    # The curve of one window does not lead into the next.
    seen[-1] = twin[-1] = np.nan
    return BIN_S * (np.arange(BINS, dtype=np.float64) + BINS * place), seen - middle, twin - middle


def _noise(calibrated: Calibrated) -> Table:
    units = ("m/s", "s", "rad/s^2", "m", "m", "rad", "m/s^2", "rad/s^2", "rad")
    deviation = np.sqrt(np.diag(calibrated.fit.eta_covariance))
    rows = [
        (name, f"{value:.3g} {unit}", f"{100 * d:.0f} %")
        for name, value, unit, d in zip(
            noise.COMPONENTS, np.exp(calibrated.fit.state.eta), units, deviation, strict=True
        )
    ]
    return Table(
        "Noise",
        "Wind, cameras, and small accelerations that stand for the timing of single commands: standard deviations.",
        ("", "value", "known to"),
        rows,
    )
