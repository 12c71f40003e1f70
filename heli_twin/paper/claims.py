"""The paper's claims, each with its number, ours, and a verdict by rule. Only the paper's numbers are written here.

Source: Kunz, Huck, Summers, ECC 2013, section III and Figs. 3-5; those about two controllers are in `comparison`.
"""

from collections.abc import Iterator

import numpy as np

from controllers.model import Model
from heli_twin.identification.fit import Parameter
from heli_twin.identification.identify import Identified
from heli_twin.lab.disturbances.bias import Bias
from heli_twin.metrics.tracking import milliseconds
from heli_twin.paper.cases import CASES, SIMULATED_DELAYS_MS, simulated
from heli_twin.paper.comparison import DEGREES, comparison, judged
from heli_twin.paper.flights import Flights
from heli_twin.paper.host import Host
from heli_twin.paper.verdicts import (
    APPROXIMATE_FACTOR,
    IDENTIFIED_FACTOR,
    SAME_ORDER_FACTOR,
    SMALL_HEADING_RAD,
    SMALL_SCATTER_RAD,
    Claim,
    Verdict,
    all_of,
    apart,
    below,
    exact,
    fitted,
    within,
)
from heli_twin.recording.log import Timings
from heli_twin.reporting.intervals import Interval, failure_interval, mean_interval, median_interval
from heli_twin.reporting.words import interval, number, percent
from heli_twin.studies.columns import COMPLETED

CM = 100.0
"""Centimetres in a metre."""
SIMULATED_MAX_M = (0.025, 0.025)
"""m, x and y: "approximately 2.5 cm"."""
HOVER_MAX_M, CIRCLE_MAX_M = (0.055, 0.04), (0.04, 0.085)
"""m, x and y: largest deviations on the testbed."""
SOLVE_MS = (5.0, 7.0)
PERIOD_MS = 20.0
SIMULATED = simulated(40)
"""The case that is shown as Fig. 3."""
FITTED_GUST = (
    "Fitted: the strength of the gust, which the paper does not print, was chosen because it gives this error."
)
TESTBED_CASES = ("hover", "circle", "pirouette", "wheel", "turning")


def claims(flights: Flights, found: Identified | None) -> Iterator[Claim]:
    """Every claim that flights and identification decide, in the paper's order."""
    yield _parameters(found)
    yield from _simulation(flights)
    yield from _testbed(flights)
    yield from comparison(flights)


def largest(flights: Flights, case: str, axis: str) -> Interval:
    """Median over the seeds of the largest error of a flight; of a flight without chance its own."""
    values = flights.values(case, f"max_abs_error.{axis}")
    return exact(float(values[0])) if CASES[case].once else median_interval(values)


def _simulation(flights: Flights) -> Iterator[Claim]:
    cases = [*(simulated(delay) for delay in SIMULATED_DELAYS_MS), "simulated_undelayed"]
    x, y = (largest(flights, SIMULATED, axis) for axis in "xy")
    near = all_of([within(a, paper, APPROXIMATE_FACTOR) for a, paper in zip((x, y), SIMULATED_MAX_M, strict=True)])
    why = f"Fitted: {fitted_delay(flights)}"
    text = "Fig. 3, simulated circle: largest deviation in x / y"
    yield judged(flights, cases, Claim(text, _pair(SIMULATED_MAX_M), _two(x, y), fitted(near), why))
    yield _heading(flights, SIMULATED, "Fig. 3, simulated circle: heading tracked very well")


def fitted_delay(flights: Flights) -> str:
    """Say how the delay of the simulation came about, with the errors of other delays."""

    def pair(case: str) -> str:
        return " / ".join(number(CM * largest(flights, case, axis).value, 2) for axis in "xy") + " cm"

    delays = ", ".join(f"{delay} ms: {pair(simulated(delay))}" for delay in SIMULATED_DELAYS_MS)
    return (
        "the paper does not print what its simulation contained. Poses 40 ms old, taken for new, were chosen because"
        f" they give its error ({delays}; no delay: {pair('simulated_undelayed')})."
    )


def _testbed(flights: Flights) -> Iterator[Claim]:
    hover = _maxima(flights, "hover", HOVER_MAX_M, "Fig. 4, hover: largest deviation in x / y")
    yield hover._replace(verdict=fitted(hover.verdict), why=f"{FITTED_GUST} {hover.why}")
    yield _offset(flights)
    yield _maxima(flights, "circle", CIRCLE_MAX_M, "Fig. 5, circle: largest deviation in x / y")
    yield _heading(flights, "circle", "Fig. 5, circle: heading tracked very well")
    cases = [name + tail for name in TESTBED_CASES for tail in ("", "_pid")]
    flown = [(row["outcome"] != COMPLETED, seed) for case in cases for seed, row in enumerate(flights.rows[case])]
    failed, seeds = (np.array(column) for column in zip(*flown, strict=True))
    rate = failure_interval(failed, seeds)
    yield Claim(
        "Hover, circle, pirouette, ferris wheel and pirouette on a circle are flown",
        "all",
        f"{percent(rate)} failed",
        "reproduced" if rate.value == 0.0 else "not reproduced",
        f"{len(flown)} flights by MPC and PID; one that crashes, leaves the room or diverges has failed.",
    )


def _maxima(flights: Flights, case: str, paper: tuple[float, float], text: str) -> Claim:
    x, y = (largest(flights, case, axis) for axis in "xy")
    verdict = all_of([within(x, paper[0], SAME_ORDER_FACTOR), within(y, paper[1], SAME_ORDER_FACTOR)])
    ratios = " and ".join(number(a.value / b, 2) for a, b in zip((x, y), paper, strict=True))
    why = (
        f"Median over {x.n} flights against the paper's one, {ratios} times its numbers; "
        f"intervals within a factor of {SAME_ORDER_FACTOR:g} count as the same order."
    )
    return judged(flights, [case], Claim(text, _pair(paper), _two(x, y), verdict, why))


def _heading(flights: Flights, case: str, text: str) -> Claim:
    yaw = largest(flights, case, "yaw")
    bias, spread = (float(flights.values(case, f"{name}.yaw").mean()) for name in ("bias", "spread"))
    why = (
        f"The paper prints no number; below {DEGREES * SMALL_HEADING_RAD:g} deg at all times, with a scatter below "
        f"{DEGREES * SMALL_SCATTER_RAD:g} deg rms in flight, is taken for it. "
        f"On average {DEGREES * bias:.2f} deg off, with a scatter of {DEGREES * spread:.2f} deg."
    )
    if CASES[case].once and spread >= SMALL_SCATTER_RAD:
        why += " Nothing in this flight is random: the heading is in a limit cycle, for which the delay is long enough."
    verdict = all_of([below(yaw, SMALL_HEADING_RAD), below(exact(spread), SMALL_SCATTER_RAD)])
    claim = Claim(text, "very well", interval(yaw, DEGREES, "deg"), verdict, why)
    return judged(flights, [case], claim)


def _offset(flights: Flights) -> Claim:
    """The integral states answer a steady push with a steady input."""
    push, model = Bias(), Model()
    wanted = (-push.x / model.b_x, -push.y / model.b_y)
    u_x, u_y = (mean_interval(flights.values("hover", f"mean.{name}")) for name in ("u_x", "u_y"))
    why = (
        f"The steady push of {push.x:g} and {push.y:g} m/s² asks for {wanted[0]:.3f} / {wanted[1]:.3f}; "
        "intervals on that side of zero count."
    )
    verdict = all_of([apart(u_x, wanted[0]), apart(u_y, wanted[1])])
    text = "Fig. 4, hover: a steady disturbance offsets the inputs u_x / u_y"
    ours = f"{interval(u_x)} / {interval(u_y)} stick"
    return judged(flights, ["hover"], Claim(text, "offset", ours, verdict, why))


def parameter_rows(found: Identified) -> Iterator[tuple[str, float, Parameter, Verdict]]:
    """Name, (27), ours and verdict of each identified parameter."""
    for name, p in found.parameters.items():
        paper = getattr(Model(), name)
        # A damping of the wrong sign is not found, whatever its size.
        yield name, paper, p, within(exact(p.value * float(np.sign(paper))), abs(paper), IDENTIFIED_FACTOR)


def _parameters(found: Identified | None) -> Claim:
    text = "Model (27) by least squares from flights"
    if found is None:
        return Claim(text, "(27)", "-", "not comparable", "No identification was flown.")
    rows = list(parameter_rows(found))
    off = {name: abs(p.value / paper - 1.0) for name, paper, p, _ in rows}
    worst = max(off, key=lambda name: off[name])
    ours = f"furthest: {worst}, {number(100 * off[worst], 2)} % off"
    near = f"{100 * (IDENTIFIED_FACTOR - 1):.2g} % counts as found"
    why = f"The twin has (27), poses and commands of its flights find it; {near}."
    return Claim(text, "(27)", ours, all_of([row[3] for row in rows]), why)


def timing_claims(timing: Timings, host: Host) -> Iterator[Claim]:
    """The claims about computing time: measured on this host, different every time."""
    solve, step = milliseconds(timing.solve_ns), milliseconds(timing.control_step_ns)
    p50, p99, whole = (value or np.nan for value in (solve["p50"], solve["p99"], step["p99"]))
    yield Claim(
        "Solve time of one QP",
        f"{SOLVE_MS[0]:g} to {SOLVE_MS[1]:g} ms",
        f"median {number(p50)} ms, 99 % {number(p99)} ms",
        "not comparable",
        f"{number(SOLVE_MS[0] / p50, 2)} to {number(SOLVE_MS[1] / p50, 2)} times faster in the median, "
        f"but by another solver (ProxQP for CVXGEN) on another processor ({host.processor}).{host.warning()}",
    )
    in_time = below(exact(whole), 0.5 * PERIOD_MS)
    yield Claim(
        "Solved well within the sampling period",
        f"{PERIOD_MS:g} ms",
        f"whole control step: median {number(step['p50'] or np.nan)} ms, 99 % {number(whole)} ms",
        # A step that is late on a busy host may be in time on a free one.
        "not comparable" if host.busy and in_time == "not reproduced" else in_time,
        f"Linearising, condensing and solving take {number(100 * whole / PERIOD_MS, 2)} % of the period in the "
        f"99th percentile; half of it counts as well within.{host.warning()}",
    )


def _pair(paper: tuple[float, float]) -> str:
    return " / ".join(f"{CM * value:.1f}" for value in paper) + " cm"


def _two(x: Interval, y: Interval) -> str:
    return f"{interval(x, CM)} / {interval(y, CM)} cm"
