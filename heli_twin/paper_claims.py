"""The paper's claims, each with its number, ours, and a verdict by rule. Only the paper's numbers are written here.

Source: Kunz, Huck, Summers, ECC 2013, section III and Figs. 3-6.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from controllers.model import Model
from controllers.signals import Array
from heli_twin.disturbances.bias import Bias
from heli_twin.identification import Identified
from heli_twin.identification_fit import Parameter
from heli_twin.metrics import milliseconds
from heli_twin.paper_flights import CASES, WEAK, Flights
from heli_twin.paper_verdicts import (
    APPROXIMATELY,
    CLOSE,
    LITTLE,
    ORDER,
    Claim,
    Verdict,
    all_of,
    apart,
    below,
    exact,
    in_words,
    smaller,
    within,
)
from heli_twin.recording.log import Timings
from heli_twin.studies.inference import Interval, mean_interval, median_interval, wilson
from heli_twin.studies.report.words import interval, metric, number, percent

CM, DEGREES = 100.0, 180.0 / np.pi
SIMULATED_CIRCLE = (0.025, 0.025)
"""m, x and y: "approximately 2.5 cm"."""
HOVER, CIRCLE = (0.055, 0.04), (0.04, 0.085)
"""m, x and y: largest deviations on the testbed."""
SOLVE_MS = (5.0, 7.0)
PERIOD_MS = 20.0
FLOWN = ("hover", "circle", "pirouette", "wheel", "turning")


def claims(flights: Flights, found: Identified | None) -> Iterator[Claim]:
    """Every claim that flights and identification decide, in the paper's order."""
    yield from _simulation(flights)
    yield from _testbed(flights)
    yield from _comparison(flights)
    yield from _height(flights)
    yield from _coupling(flights)
    yield _parameters(found)


def _judged(flights: Flights, cases: Sequence[str], claim: Claim) -> Claim:
    """A claim that is not comparable when a flight it rests on failed: survivors alone would flatter."""
    for case in cases:
        if failed := flights.failed(case):
            why = f"{failed} of {len(flights.rows[case])} flights failed: {CASES[case].label}."
            return claim._replace(verdict="not comparable", why=why)
    return claim


def largest(flights: Flights, case: str, axis: str) -> Interval:
    """Median over the seeds of the largest error of a flight; of a flight without chance its own."""
    values = flights.values(case, f"max_abs_error.{axis}")
    return exact(float(values[0])) if CASES[case].once else median_interval(values)


def _simulation(flights: Flights) -> Iterator[Claim]:
    x, y = (largest(flights, "simulated", axis) for axis in "xy")
    undelayed = [number(CM * largest(flights, "simulated_undelayed", axis).value, 2) for axis in "xy"]
    verdict = all_of(*(within(a, paper, APPROXIMATELY) for a, paper in zip((x, y), SIMULATED_CIRCLE, strict=True)))
    why = (
        "With poses 40 ms old that are taken for new; the paper does not print what its simulation contained, "
        f"and without any delay the same one deviates by {' / '.join(undelayed)} cm."
    )
    claim = Claim(
        "Fig. 3, simulated circle: largest deviation in x / y", _pair(SIMULATED_CIRCLE), _two(x, y), verdict, why
    )
    yield _judged(flights, ["simulated", "simulated_undelayed"], claim)
    yield _heading(flights, "simulated", "Fig. 3, simulated circle: heading tracked very well")


def _testbed(flights: Flights) -> Iterator[Claim]:
    yield _maxima(flights, "hover", HOVER, "Fig. 4, hover: largest deviation in x / y")
    yield _offset(flights)
    yield _maxima(flights, "circle", CIRCLE, "Fig. 5, circle: largest deviation in x / y")
    yield _heading(flights, "circle", "Fig. 5, circle: heading tracked very well")
    cases = [name + tail for name in FLOWN for tail in ("", "_pid")]
    rate = wilson(sum(map(flights.failed, cases)), sum(len(flights.rows[case]) for case in cases))
    yield Claim(
        "Hover, circle, pirouette, ferris wheel and pirouette on a circle are flown",
        "all",
        f"{percent(rate)} failed",
        "reproduced" if rate.value == 0.0 else "not reproduced",
        f"{rate.n} flights by MPC and PID, none but completed ones count.",
    )


def _maxima(flights: Flights, case: str, paper: tuple[float, float], text: str) -> Claim:
    x, y = (largest(flights, case, axis) for axis in "xy")
    verdict = all_of(within(x, paper[0], ORDER), within(y, paper[1], ORDER))
    ratios = " and ".join(number(a.value / b, 2) for a, b in zip((x, y), paper, strict=True))
    why = (
        f"Median of {x.n} flights against the paper's one, {ratios} times its numbers; "
        f"intervals within a factor of {ORDER:g} count as the same order."
    )
    return _judged(flights, [case], Claim(text, _pair(paper), _two(x, y), verdict, why))


def _heading(flights: Flights, case: str, text: str) -> Claim:
    yaw = largest(flights, case, "yaw")
    why = f"The paper prints no number; below {DEGREES * LITTLE:g} deg at all times is taken for it."
    claim = Claim(text, "very well", interval(yaw, DEGREES, "deg"), below(yaw, LITTLE), why)
    return _judged(flights, [case], claim)


def _offset(flights: Flights) -> Claim:
    """The integral states answer a steady push with a steady input."""
    push, model = Bias(), Model()
    wanted = (-push.x / model.b_x, -push.y / model.b_y)
    u_x, u_y = (mean_interval(flights.values("hover", f"mean.{name}")) for name in ("u_x", "u_y"))
    why = f"The steady push of {push.x:g} and {push.y:g} m/s\u00b2 asks for {wanted[0]:.3f} / {wanted[1]:.3f} of full stick."
    verdict = all_of(apart(u_x, wanted[0]), apart(u_y, wanted[1]))
    text = "Fig. 4, hover: a steady disturbance offsets the inputs u_x / u_y"
    ours = f"{interval(u_x)} / {interval(u_y)}"
    return _judged(flights, ["hover"], Claim(text, "offset, no number", ours, verdict, why))


def _comparison(flights: Flights) -> Iterator[Claim]:
    for text, mpc, pid in (
        ("Fig. 6, circle: MPC better than PID in x / y (PID by feedback only, the paper's)", "circle", "circle_pid"),
        ("The same with the nose north", "fixed", "fixed_pid"),
        (
            "The same against a PID with the MPC's reference inputs and Ziegler-Nichols gains",
            "circle",
            "circle_flat_zn",
        ),
        ("The same, its gains fine-tuned on the twin", "circle", "circle_flat"),
        ("The same, the MPC with a Riccati terminal weight", "circle_riccati", "circle_flat"),
    ):
        yield _better(flights, mpc, pid, ("x", "y"), text)
    yield _better(
        flights, "circle", "circle_pid", ("yaw",), "Fig. 6, circle: MPC better than PID in heading (feedback only)"
    )
    yield _better(flights, "fixed", "fixed_pid", ("yaw",), "The same with the nose north")
    yield _better(
        flights, "circle", "circle_flat", ("yaw",), "The same, nose along the path, PID with reference inputs"
    )
    for tail, where in (("circle", "along the path"), ("fixed", "north")):
        cases = (tail, f"{tail}_pid")
        rms = [mean_interval(np.sqrt(flights.values(case, "mse.yaw"))) for case in cases]
        ours = " / ".join(interval(a, DEGREES, "deg") for a in rms)
        why = f"Negligible is taken for below {DEGREES * LITTLE:g} deg rms; the PID is by feedback only."
        verdict = all_of(*(below(a, LITTLE) for a in rms))
        claim = Claim(f"Heading errors negligible, MPC / PID, nose {where}", "negligible", ours, verdict, why)
        yield _judged(flights, cases, claim)


def _better(flights: Flights, one: str, other: str, axes: Sequence[str], text: str) -> Claim:
    """Whether the first has the smaller mean squared error on all axes."""
    found: list[tuple[Verdict, Interval]] = []
    cells: list[str] = []
    for axis in axes:
        name = f"mse.{axis}"
        a, b, scale = flights.values(one, name), flights.values(other, name), metric(name)
        found.append(smaller(a, b))
        means = f"{number(scale.factor * float(a.mean()))} against {number(scale.factor * float(b.mean()))}"
        cells.append(f"{axis}: {means}, difference {interval(found[-1][1], scale.factor, scale.unit)}")
    words = " / ".join(dict.fromkeys(in_words(difference) for _, difference in found))
    why = f"{CASES[one].label} against {CASES[other].label}, same {found[0][1].n} seeds, mean squared error: {words}."
    verdict = all_of(*(verdict for verdict, _ in found))
    return _judged(flights, [one, other], Claim(text, "smaller", "; ".join(cells), verdict, why))


def _height(flights: Flights) -> Iterator[Claim]:
    yield _better(
        flights, "circle_pid", "circle", ("z",), "Fig. 6, circle: PID better than MPC in z, thrust as believed"
    )
    for share in WEAK:
        name = f"weak{100 * share:.0f}"
        text = f"PID better than MPC in z, thrust {100 * share:g} % below what both believe"
        yield _better(flights, f"{name}_pid", name, ("z",), text)
    for share in WEAK:
        name = f"weak{100 * share:.0f}"
        text = f"... because of the missing integral: the MPC that cancels it is better than PID, {100 * share:g} %"
        claim = _better(flights, f"{name}_free", f"{name}_pid", ("z",), text)
        yield claim._replace(paper="the reason it gives")


def _coupling(flights: Flights) -> Iterator[Claim]:
    for where, removed, full in (("circle", "circle", "circle_full"), ("pirouette circle", "turning", "turning_full")):
        a, b = flights.values(removed, "step.u_yaw"), flights.values(full, "step.u_yaw")
        verdict, difference = smaller(a, b)
        level = [flights.values(case, "rms.u_yaw").mean() for case in (removed, full)]
        ours = f"step {number(a.mean())} against {number(b.mean())}, difference {interval(difference)}"
        why = (
            f"Change of u_yaw per control step: {in_words(difference)}, "
            f"by {number(100 * abs(difference.value) / float(b.mean()), 2)} %; rms of u_yaw {level[0]:.4f} against {level[1]:.4f}."
        )
        text = f"Coupling removed: no unwanted yaw actuation, {where}"
        yield _judged(flights, [removed, full], Claim(text, "less", ours, verdict, why))
        yield _better(flights, removed, full, ("x", "y"), f"Coupling removed: motion significantly better, {where}")
        yield _better(flights, removed, full, ("yaw",), f"The same for the heading, {where}")


def parameter_rows(found: Identified) -> Iterator[tuple[str, float, Parameter, Verdict]]:
    """Name, (27), ours and verdict of each identified parameter."""
    for name, p in found.parameters.items():
        paper = getattr(Model(), name)
        yield name, paper, p, within(exact(abs(p.value)), abs(paper), CLOSE)


def _parameters(found: Identified | None) -> Claim:
    text = "The model (27) is identified by least squares from flights"
    if found is None:
        return Claim(text, "(27)", "-", "not comparable", "No identification was flown.")
    rows = list(parameter_rows(found))
    off = {name: abs(p.value / paper - 1.0) for name, paper, p, _ in rows}
    worst = max(off, key=lambda name: off[name])
    why = f"Flown on a helicopter that has (27); {number(100 * (CLOSE - 1), 2)} % is close enough; see the table of parameters."
    return Claim(
        text, "(27)", f"furthest: {worst}, {number(100 * off[worst], 2)} %", all_of(*(row[3] for row in rows)), why
    )


def timing_claims(timing: Timings, processor: str) -> Iterator[Claim]:
    """The claims about computing time: measured on this host, different every time."""
    solve, step = milliseconds(timing.solve_ns), milliseconds(timing.control_step_ns)
    p50, p99 = solve["p50"] or np.nan, solve["p99"] or np.nan
    ours = f"median {number(p50)} ms, 99 % {number(p99)} ms"
    yield Claim(
        "Solve time of one QP",
        f"{SOLVE_MS[0]:g} to {SOLVE_MS[1]:g} ms",
        ours,
        "not comparable",
        f"{number(SOLVE_MS[0] / p50, 2)} to {number(SOLVE_MS[1] / p50, 2)} times faster in the median, but by another solver "
        f"(ProxQP for CVXGEN) on another processor ({processor}).",
    )
    whole = step["p99"] or np.nan
    yield Claim(
        "Solved well within the sampling period",
        f"{PERIOD_MS:g} ms",
        f"whole control step: median {number(step['p50'] or np.nan)} ms, 99 % {number(whole)} ms",
        below(exact(whole), 0.5 * PERIOD_MS),
        f"Linearising, condensing and solving take {number(100 * whole / PERIOD_MS, 2)} % of the period in the 99th percentile; "
        "half of it counts as well within.",
    )


def _pair(paper: tuple[float, float]) -> str:
    return " / ".join(f"{CM * value:.1f}" for value in paper) + " cm"


def _two(x: Interval, y: Interval) -> str:
    return f"{interval(x, CM)} / {interval(y, CM)} cm"
