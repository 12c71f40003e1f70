"""Claims that set one controller against another with the same seeds: Fig. 6, height, coupling.

Source: Kunz, Huck, Summers, ECC 2013, section III and Fig. 6.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from heli_twin.paper.cases import ATTITUDE, ATTITUDES, CASES, LAWS, THRUST_DEFICITS, at_attitude, weak
from heli_twin.paper.flights import Flights
from heli_twin.paper.gains import gains_of
from heli_twin.paper.verdicts import SMALL_HEADING_RAD, Claim, all_of, below, in_words, smaller
from heli_twin.reporting.intervals import mean_interval
from heli_twin.reporting.words import interval, metric, number

DEGREES = 180.0 / np.pi
HEADING_CAUSE = (
    "the coupled model turns to mend errors in x, y, in proportion to speed and error, and its heading pays; a wrong"
    " plant.yaw_gain makes no such difference"
)
MOTION_CAUSE = (
    "at this speed and in this wind that turning mends next to nothing; with trajectory.rate=2 and"
    " disturbances.gust.strength=0.5 it takes a third off the errors in x, y, and heading errs five times as much"
)


def comparison(flights: Flights) -> Iterator[Claim]:
    """Every claim of this kind, in the paper's order."""
    yield from _plane(flights)
    yield from _heading(flights)
    yield from _height(flights)
    yield from _coupling(flights)


def in_plane(flights: Flights, case: str) -> float:
    """Root mean square error in the plane over all flights of a case, m."""
    return float(np.hypot(flights.rms(case, "x"), flights.rms(case, "y")))


def elsewhere(flights: Flights, one: str, other: str) -> str:
    """Say how two laws compare on helicopters with a slower and a faster attitude."""
    frequencies = sorted((*ATTITUDES, ATTITUDE))
    errors = np.array([[in_plane(flights, at_attitude(c, w)) for w in frequencies] for c in (one, other)])
    texts = [" / ".join(number(100.0 * e) for e in row) for row in errors]
    order = set(np.sign(errors[0] - errors[1]).tolist())
    verdict = "the same order" if len(order) == 1 else "not the same order everywhere"
    at = " / ".join(map(str, frequencies))
    return f" With attitude at {at} rad/s: {texts[0]} against {texts[1]} cm rms in the plane, {verdict}."


def judged(flights: Flights, cases: Sequence[str], claim: Claim) -> Claim:
    """A claim that is not comparable when a flight it rests on failed: survivors alone would flatter."""
    for case in cases:
        if failed := flights.failed(case):
            why = f"{failed} of {len(flights.rows[case])} flights failed: {CASES[case].label}."
            return claim._replace(verdict="not comparable", why=why)
    return claim


def _plane(flights: Flights) -> Iterator[Claim]:
    mpc, stiff, pid, rules = (
        gains_of(case)[0] for case in ("circle", "circle_riccati", "circle_flat", "circle_flat_zn")
    )
    told = "without the planned inputs the PID trails behind a moving point"
    slow = f"the rules give {rules[0]:.2g} stick/m in x, the loop bears {pid[0]:.2g}"
    soft = (
        f"weights and Q_f = Q leave the MPC {mpc[0]:.2g} stick/m and {mpc[1]:.2g} stick s/m in x, "
        f"the PID was tuned to {pid[0]:.2g} and {pid[1]:.2g}"
    )
    hard = f"the cost beyond its horizon gives the MPC {stiff[0]:.2g} stick/m and {stiff[1]:.2g} stick s/m in x"
    brakes = "its derivative of the measured velocity brakes a moving reference; " + told
    for text, one, other, cause in (
        ("PID by feedback only, derivative of the measured velocity", "circle", "circle_pid", brakes),
        ("PID by feedback only, derivative of the error", "circle", "circle_error", told),
        ("PID by feedback only, nose north", "fixed", "fixed_pid", told),
        ("PID with the planned inputs, Z-N gains", "circle", "circle_flat_zn", slow),
        ("PID with the planned inputs, fine-tuned", "circle", "circle_flat", soft),
        ("the same PID, MPC with a Riccati terminal weight", "circle_riccati", "circle_flat", hard),
    ):
        claim = _better(flights, one, other, ("x", "y"), f"Fig. 6: MPC better than PID in x, y: {text}", cause)
        told_too = one in LAWS and other in LAWS and claim.verdict != "not comparable"
        yield claim._replace(why=claim.why + elsewhere(flights, one, other)) if told_too else claim


def _heading(flights: Flights) -> Iterator[Claim]:
    (mpc, _), (pid, _) = (gains_of(case)[3] for case in ("circle", "circle_flat"))
    quiet = [DEGREES * flights.rms(case, "yaw") for case in ("circle_exact", "circle_flat_exact")]
    noise = (
        f"the MPC answers the noise of the cameras' orientation with {mpc:.2g} stick/rad, the PID with {pid:.2g}; "
        f"without that noise they err by {quiet[0]:.2f} and {quiet[1]:.2f} deg rms"
    )
    slow = "its integral is all that answers a steady turn"
    turn = "the PID's derivative brakes the planned turn until its integral has caught up"
    pairs = (
        ("PID by feedback only, nose along the path", "circle", "circle_pid", turn),
        ("PID by feedback only, derivative of the error, nose along the path", "circle", "circle_error", slow),
        ("PID by feedback only, nose north", "fixed", "fixed_pid", noise),
        ("PID with the planned inputs, nose along the path", "circle", "circle_flat", noise),
    )
    for text, one, other, cause in pairs:
        yield _better(flights, one, other, ("yaw",), f"Fig. 6: MPC better than PID in heading: {text}", cause)
    for text, one, other, _ in pairs:
        rms = [mean_interval(np.sqrt(flights.values(case, "mse.yaw"))) for case in (one, other)]
        ours = " / ".join(interval(a, DEGREES) for a in rms) + " deg rms"
        why = f"Below {DEGREES * SMALL_HEADING_RAD:g} deg rms is taken for negligible; the paper prints no number."
        verdict = all_of([below(a, SMALL_HEADING_RAD) for a in rms])
        claim = Claim(f"Fig. 6: heading errors negligible, MPC / PID: {text}", "negligible", ours, verdict, why)
        yield judged(flights, (one, other), claim)


def _height(flights: Flights) -> Iterator[Claim]:
    yield _better(flights, "circle_pid", "circle", ("z",), "Fig. 6: PID better than MPC in z: thrust as both believe")
    for share in THRUST_DEFICITS:
        text = f"Fig. 6: PID better than MPC in z: thrust {100 * share:g} % below what both believe"
        yield _better(flights, weak(share, "_pid"), weak(share), ("z",), text)
    for share in THRUST_DEFICITS:
        text = f"... for want of an integral in z: MPC that cancels the push beats PID, thrust {100 * share:g} % low"
        claim = _better(flights, weak(share, "_free"), weak(share, "_pid"), ("z",), text)
        yield claim._replace(paper="its reason")


def _coupling(flights: Flights) -> Iterator[Claim]:
    for where, removed, full in (("circle", "circle", "circle_full"), ("pirouette circle", "turning", "turning_full")):
        yield _activity(flights, where, removed, full)
        for what, axes, cause in (("motion", ("x", "y"), MOTION_CAUSE), ("heading", ("yaw",), HEADING_CAUSE)):
            text = f"Coupling removed: {what} significantly better, {where}"
            yield _better(flights, removed, full, axes, text, cause)


def _activity(flights: Flights, where: str, removed: str, full: str) -> Claim:
    """The claim on the activity of the yaw input."""
    a, b = flights.values(removed, "step.u_yaw"), flights.values(full, "step.u_yaw")
    verdict, difference = smaller(a, b)
    level = [float(flights.values(case, "rms.u_yaw").mean()) for case in (removed, full)]
    ours = f"step {number(float(a.mean()))} against {number(float(b.mean()))}, difference {interval(difference)}"
    why = (
        f"Change of u_yaw per control step, rms, {number(100 * difference.value / float(b.mean()), 2)} % from full "
        f"to removed coupling: {in_words(difference, b)}; rms of u_yaw itself {level[0]:.4f} against {level[1]:.4f}."
    )
    claim = Claim(f"Coupling removed: less actuation of the yaw, {where}", "less", ours, verdict, why)
    return judged(flights, (removed, full), claim)


def _better(flights: Flights, one: str, other: str, axes: Sequence[str], text: str, cause: str = "") -> Claim:
    """The claim that the first case has the smaller mean squared error on all axes, with its cause."""
    cells: list[str] = []
    found = {axis: smaller(flights.values(one, f"mse.{axis}"), flights.values(other, f"mse.{axis}")) for axis in axes}
    for axis, (_, difference) in found.items():
        scale = metric(f"mse.{axis}")
        a, b = (scale.factor * float(flights.values(case, f"mse.{axis}").mean()) for case in (one, other))
        cells.append(
            f"{axis}: {number(a)} against {number(b)}, difference {interval(difference, scale.factor, scale.unit)}"
        )
    words = {axis: in_words(found[axis][1], flights.values(other, f"mse.{axis}")) for axis in axes}
    outcome = ", ".join(f"{axis} {word}" for axis, word in words.items())
    why = f"{CASES[one].label} against {CASES[other].label}, same seeds: {outcome}{'; ' if cause else ''}{cause}."
    verdict = all_of([verdict for verdict, _ in found.values()])
    return judged(flights, (one, other), Claim(text, "smaller", "; ".join(cells), verdict, why))
