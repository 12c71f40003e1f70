"""The paper's claims: judged by rule from flights alone, on a page that holds together."""

import re
import shlex
import xml.etree.ElementTree as ElementTree
from base64 import b64decode
from html.parser import HTMLParser

import numpy as np
import pytest

from controllers.detailed_model import DetailedModel
from controllers.laws.ltv_mpc import LtvMpc
from controllers.laws.pid import Pid
from controllers.model import Model
from heli_twin.errors import HeliTwinError
from heli_twin.experiment.text import load
from heli_twin.identification.fit import AxisFit, Parameter
from heli_twin.identification.identify import Identified
from heli_twin.metrics.margins import Margins
from heli_twin.paper import robustness
from heli_twin.paper.beyond import beyond_table, bound_curve
from heli_twin.paper.cases import CASES
from heli_twin.paper.causes import causes
from heli_twin.paper.claims import claims, timing_claims
from heli_twin.paper.figures import figures
from heli_twin.paper.flights import Flights
from heli_twin.paper.gains import feedback_gains, gains_of
from heli_twin.paper.host import Host
from heli_twin.paper.page import flown_table
from heli_twin.paper.robustness import margin_tasks, measure_margins, robustness_table
from heli_twin.paper.verdicts import all_of, apart, below, exact, explains, fitted, smaller, within
from heli_twin.paper.write import write_paper
from heli_twin.recording.log import Timings
from heli_twin.reporting.intervals import Interval
from heli_twin.reporting.svg import write_svg

NO, YES, FITTED, NEITHER = "not reproduced", "reproduced", "fitted", "not comparable"
UNKNOWN = Interval(1.0, np.nan, np.nan, 1)
SLOW_PID = "Fig. 6: MPC better than PID in x, y: PID by feedback only, derivative of the measured"
SEEDS = 6
AXES = ("x", "y", "z", "yaw")


@pytest.mark.parametrize(
    ("low", "high", "verdict"),
    [(0.6, 1.9, YES), (0.4, 1.0, NO), (1.0, 2.1, NO), (3.0, 4.0, NO), (np.nan, np.nan, NEITHER)],
)
def test_the_whole_interval_has_to_be_near_the_papers_number(low, high, verdict):
    assert within(Interval(1.0, low, high, 8), 1.0, 2.0) == verdict


def test_a_number_without_scatter_is_judged_by_itself():
    assert within(exact(2.4), 2.5, 1.2) == YES
    assert within(exact(2.0), 2.5, 1.2) == NO
    assert within(exact(np.nan), 2.5, 1.2) == NEITHER


@pytest.mark.parametrize(
    ("found", "verdict"), [(Interval(1, 0.5, 1.9, 8), YES), (Interval(1, 0.5, 2.1, 8), NO), (UNKNOWN, NEITHER)]
)
def test_a_limit_holds_for_the_whole_interval(found, verdict):
    assert below(found, 2.0) == verdict


@pytest.mark.parametrize(
    ("found", "sign", "verdict"),
    [
        (Interval(1, 0.5, 2, 8), 1.0, YES),
        (Interval(-1, -2, -0.5, 8), -1.0, YES),
        (Interval(1, 0.5, 2, 8), -1.0, NO),
        (Interval(1, -0.1, 2, 8), 1.0, NO),
        (UNKNOWN, 1.0, NEITHER),
    ],
)
def test_an_offset_is_on_its_side_of_zero(found, sign, verdict):
    assert apart(found, sign) == verdict


def test_smaller_means_significantly_smaller_with_the_same_seeds():
    seeds = np.random.default_rng(1).uniform(1.0, 3.0, 8)
    assert smaller(0.5 * seeds, seeds)[0] == YES
    assert smaller(seeds, 0.5 * seeds)[0] == NO
    assert smaller(0.99 * seeds, seeds)[0] == NO, "certain, but not worth speaking of"
    assert smaller(seeds[::-1] - 0.1, seeds)[0] == NO, "lost in the scatter"
    assert smaller(0.5 * seeds[:1], seeds[:1])[0] == NEITHER, "one seed has no interval"


def test_a_claim_of_several_numbers_is_as_good_as_its_worst():
    assert all_of([YES, YES]) == YES
    assert all_of([YES, NO]) == NO
    assert all_of([YES, NO, NEITHER]) == NEITHER


def test_a_cause_explains_when_the_two_come_together():
    assert explains(1.0, 0.4) == explains(1.0, -0.4) == "yes"
    assert explains(1.0, 0.6) == "no"
    assert explains(1.0, -5.0) == "turns round", "a rival made five times worse explains nothing"
    assert explains(-1.0, 0.0) == explains(np.nan, 0.0) == explains(1.0, np.nan) == "unknown"


def test_a_cause_has_to_explain_both_taken_away_and_given_to_the_rival():
    assert explains(1.0, 0.1, -0.2) == "yes"
    assert explains(1.0, 0.1, 0.9) == "no"
    assert explains(1.0, 0.1, -0.9) == "turns round"


def test_a_number_that_a_value_was_chosen_for_is_not_called_reproduced():
    assert [fitted(verdict) for verdict in (YES, NO, NEITHER)] == [FITTED, NO, NEITHER]
    assert all_of([YES, FITTED]) == FITTED
    assert all_of([NO, FITTED]) == NO


def test_the_gains_of_a_pid_are_its_own():
    law = Pid()
    own = [(law.p_x, law.d_x), (law.p_y, law.d_y), (law.p_z, law.d_z), (law.p_yaw, law.d_yaw)]
    # The first step integrates one period already, after its output: the gains are exact but for rounding.
    np.testing.assert_allclose(feedback_gains(law), own, atol=1e-9)


def test_a_riccati_terminal_weight_makes_the_mpc_stiffer():
    assert (feedback_gains(LtvMpc(terminal="riccati"))[:2, 0] > 2 * feedback_gains(LtvMpc())[:2, 0]).all()


def pretended(folder=None, **worse):
    """Flights that were never flown: small errors with some scatter, those of some cases scaled."""
    rows = {}
    for number, (name, case) in enumerate(CASES.items()):
        rng = np.random.default_rng(number)
        rows[name] = []
        for _ in case.seeds(SEEDS):
            row = {f"max_abs_error.{axis}": 0.02 * rng.uniform(0.9, 1.1) for axis in AXES}
            row |= {"max_abs_error.position": 0.03 * rng.uniform(0.9, 1.1)}
            row |= {f"mse.{axis}": 1e-4 * rng.uniform(0.9, 1.1) for axis in (*AXES, "position")}
            row |= {"rms.u_yaw": 0.05 * rng.uniform(0.9, 1.1), "step.u_yaw": 0.05 * rng.uniform(0.9, 1.1)}
            row |= {"bias.yaw": 0.001, "spread.yaw": 0.002}
            row |= {f"std.u_{axis}": 0.08 * rng.uniform(0.9, 1.1) for axis in "xy"}
            row |= {"mean.u_x": -0.05 * rng.uniform(0.9, 1.1), "mean.u_y": -0.02 * rng.uniform(0.9, 1.1)}
            rows[name].append(
                {key: worse.get(name, 1.0) * value for key, value in row.items()} | {"outcome": "completed"}
            )
    return Flights(folder, rows)


def verdict_of(flights, start):
    return next(claim for claim in claims(flights, None) if claim.claim.startswith(start))


@pytest.mark.parametrize(
    ("start", "worse", "verdict"),
    [
        ("Fig. 3, simulated circle: largest", {"simulated40": 1.25}, FITTED),
        ("Fig. 3, simulated circle: largest", {"simulated40": 2.0}, NO),
        ("Fig. 3, simulated circle: heading", {"simulated40": 1.0}, YES),
        ("Fig. 3, simulated circle: heading", {"simulated40": 3.0}, YES),
        ("Fig. 3, simulated circle: heading", {"simulated40": 10.0}, NO),
        ("Fig. 4, hover: largest", {"hover": 2.0}, FITTED),
        ("Fig. 4, hover: largest", {"hover": 9.0}, NO),
        ("Fig. 4, hover: a steady", {"hover": 1.0}, YES),
        ("Fig. 4, hover: a steady", {"hover": -1.0}, NO),
        ("Fig. 5, circle: largest", {"circle": 3.0}, YES),
        ("Fig. 5, circle: largest", {"circle": 1.0}, NO),
        (
            SLOW_PID,
            {"circle_pid": 5.0},
            YES,
        ),
        (
            SLOW_PID,
            {"circle_pid": 0.5},
            NO,
        ),
        ("Fig. 6: PID better than MPC in z: thrust 10", {"weak10": 9.0}, YES),
        ("Fig. 6: PID better than MPC in z: thrust 10", {"weak10_pid": 9.0}, NO),
        ("... for want of an integral in z: MPC that cancels the push beats PID, thrust 5", {"weak5_pid": 2.0}, YES),
        ("... for want of an integral in z: MPC that cancels the push beats PID, thrust 5", {"weak5_free": 2.0}, NO),
        ("Coupling removed: less actuation of the yaw, pirouette", {"turning_full": 2.0}, YES),
        ("Coupling removed: less actuation of the yaw, pirouette", {"turning_full": 1.0}, NO),
    ],
)
def test_the_verdict_follows_the_flights(start, worse, verdict):
    assert verdict_of(pretended(**worse), start).verdict == verdict


def test_a_failed_flight_makes_a_comparison_void_and_is_told():
    flights = pretended(circle_pid=5.0)
    flights.rows["circle_pid"][2]["outcome"] = "crashed"
    claim = verdict_of(flights, SLOW_PID)
    assert claim.verdict == NEITHER
    assert f"1 of {SEEDS} flights failed" in claim.why
    flights.rows["wheel_pid"][0]["outcome"] = "left_volume"
    assert verdict_of(flights, "Hover, circle, pirouette").verdict == NO


def identified(**changes):
    def parameter(name):
        value = changes.get(name, getattr(Model(), name))
        return Parameter(value, 0.9 * value, 1.1 * value)

    def fit(axis):
        k = None if axis == "z" else parameter(f"k_{axis}")
        return AxisFit(parameter(f"b_{axis}"), k, Parameter(0.03, 0.02, 0.04), 0.0, (), (), ())

    return Identified({axis: fit(axis) for axis in AXES}, ("a",), 60.0)


@pytest.mark.parametrize(
    ("changes", "verdict"), [({}, YES), ({"b_z": 18.8}, YES), ({"b_z": 19.0}, NO), ({"k_yaw": 5.0}, NO)]
)
def test_every_parameter_has_to_be_found(changes, verdict):
    assert next(claims(pretended(), identified(**changes))).verdict == verdict


FREE = Host("a processor", 1.0, 0.3, 2)
BUSY = Host("a processor", 0.5, 12.5, 2)
CROWDED = Host("a processor", 0.97, 12.5, 2)
"""It had a processor, in its turn, but shared its caches."""


def test_a_busy_host_is_named_beside_measured_times():
    ms = np.full(100, 1_000_000)
    assert not any("busy" in claim.why for claim in timing_claims(Timings(ms, 3 * ms, ms // 4), FREE))
    solve, period = timing_claims(Timings(ms, 3 * ms, ms // 4), BUSY)
    assert "The host was busy" in solve.why
    assert (period.verdict, "The host was busy" in period.why) == (YES, True), "in time even so"
    assert [*timing_claims(Timings(ms, 30 * ms, ms), BUSY)][1].verdict == NEITHER, "late, but not of itself"
    assert CROWDED.busy
    assert not Host("a processor", 1.0, None, 2).busy
    assert "50 % of the time" in BUSY.sentence()
    assert "12.5 on 2 processors" in BUSY.sentence()


def test_another_solver_on_another_machine_is_not_comparable():
    ms = np.full(100, 1_000_000)
    solve, period = timing_claims(Timings(ms, 3 * ms, ms // 4), FREE)
    assert solve.verdict == NEITHER
    assert "20 to 28 times" in solve.why
    assert period.verdict == YES
    assert [*timing_claims(Timings(ms, 30 * ms, ms), FREE)][1].verdict == NO


@pytest.mark.parametrize("case", CASES)
def test_the_command_flies_the_same(case):
    words = shlex.split(CASES[case].command(2.5))[2:]
    preset = words.pop(0) if "=" not in words[0] else None
    assert load(preset, words) == CASES[case].experiment(0, 2.5)


def test_no_flights_no_paper(tmp_path):
    with pytest.raises(HeliTwinError, match="at least one seed"):
        write_paper(tmp_path, 0)


@pytest.fixture(scope="module")
def paper(tmp_path_factory):
    """One short flight of everything."""
    folder = tmp_path_factory.mktemp("paper")
    return folder, write_paper(folder, 1, duration=2.1, alone=True)


def test_a_heading_that_swings_is_not_tracked_very_well():
    flights = pretended()
    flights.rows["simulated40"][0]["spread.yaw"] = np.radians(3.2)
    claim = verdict_of(flights, "Fig. 3, simulated circle: heading")
    assert claim.verdict == NO
    assert "limit cycle" in claim.why
    flights.rows["simulated40"][0]["spread.yaw"] = np.radians(0.9)
    assert verdict_of(flights, "Fig. 3, simulated circle: heading").verdict == YES


def test_fitted_is_said_beside_the_numbers():
    assert "Fitted" in verdict_of(pretended(), "Fig. 3, simulated circle: largest").why
    assert "Fitted" in verdict_of(pretended(), "Fig. 4, hover: largest").why
    other = verdict_of(pretended(simulated30=0.1), "Fig. 3, simulated circle: largest").why
    assert other != verdict_of(pretended(), "Fig. 3, simulated circle: largest").why, "errors of other delays are told"


def answer(flights, cause):
    return next(row[-1] for row in causes(flights).rows if row[1] == cause)


def test_causes_are_matched_as_well_as_removed():
    worse = {"circle": 4.0, "circle_even": 1.0, "circle_flat_soft": 4.0}
    assert answer(pretended(**worse), "low gains of the MPC") == "yes"
    assert answer(pretended(**worse | {"circle_flat_soft": 1.0}), "low gains of the MPC") == "no"
    assert answer(pretended(**worse | {"circle_even": 0.01}), "low gains of the MPC") == "turns round"
    assert answer(pretended(circle=4.0, circle_flat_zn=100.0), "gains of the PID above Z-N") == "turns round"


def test_the_pid_with_the_gains_of_the_mpc_has_them():
    ours, mpc = gains_of("circle_flat_soft"), gains_of("circle")
    for axis in (0, 1, 3):
        np.testing.assert_allclose(ours[axis], mpc[axis], rtol=0.01)


def test_a_winner_on_one_helicopter_alone_is_told():
    same = verdict_of(pretended(circle_pid=5.0, circle_pid_at10=5.0, circle_pid_at18=5.0), SLOW_PID).why
    assert "the same order." in same
    assert "not the same order everywhere" in verdict_of(pretended(circle_pid=5.0, circle_pid_at10=0.1), SLOW_PID).why


def test_laws_with_the_same_loop_share_its_margins():
    loops = {
        task.id: {
            "outcome": "completed",
            "gain": 2.35,
            "delay": np.inf,
            "peak_sensitivity": 1.5,
            "worst_sensitivity": 2,
        }
        for task in margin_tasks()
    }
    loops["margins-circle_riccati-twin"] = {"outcome": "unstable"}
    rows = {row[0]: row for row in robustness_table(pretended(), loops).rows}
    assert rows["MPC"][4].startswith("gain 2.35, delay no limit, Ms 1.50")
    assert rows["MPC, Riccati terminal weight"][4] == "unstable"
    assert rows["PID + feed-forward"][4] == rows["PID, feedback only"][4] != "not measured"
    assert rows["MPC"][4] == rows["MPC"][5]


def test_a_loop_without_margins_is_a_row_and_no_trouble(monkeypatch):
    def unstable(experiment, helicopter):
        raise HeliTwinError(f"no margins on the {helicopter}")

    task = next(task for task in margin_tasks() if task.score == "believed")
    monkeypatch.setattr(robustness, "law_margins", unstable)
    assert measure_margins(task).row == {"outcome": "unstable", "outcome_text": "no margins on the believed"}
    loops = {"x": Margins(2.0, 0.1, 1.5, 3.0), "yaw": Margins(1.5, 0.05, 2.5, 9.0)}
    monkeypatch.setattr(robustness, "law_margins", lambda experiment, helicopter: loops)
    row = measure_margins(task).row
    assert [row[name] for name in ("outcome", "gain", "peak_sensitivity", "worst_sensitivity")] == [
        "completed",
        2,
        1.5,
        2.5,
    ]


def test_a_law_on_the_bound_has_one_times_the_bound():
    curve = bound_curve(DetailedModel(), 0)
    assert (np.diff(curve.stick) > 0).all()
    assert (np.diff(curve.error) < 0).all()
    flights = pretended()
    for row in flights.rows["hover_detailed"]:
        row |= {"std.u_x": 0.09, "max_abs_error.x": curve.at(0.09), "std.u_y": 9.0}
    row = beyond_table(flights).rows[2]
    assert row[:2] == ["lab_simple", "detailed model"]
    assert row[4] == "1 / -", "beyond the curve nothing is said"


def text_of(flights):
    """What the tables without intervals say of flights."""
    return [causes(flights), flown_table(flights, SEEDS, 30.0)]


def test_every_flight_counts_and_nothing_is_typed_in():
    said = text_of(pretended())
    assert text_of(pretended()) == said
    for case in CASES:
        assert text_of(pretended(**{case: 1.37})) != said, case


def test_one_seed_compares_nothing(paper):
    verdicts = {claim.claim: claim.verdict for claim in paper[1]}
    assert all(verdict == NEITHER for claim, verdict in verdicts.items() if "better" in claim)
    assert verdicts["Hover, circle, pirouette, ferris wheel and pirouette on a circle are flown"] == YES


class Page(HTMLParser):
    """What a browser would look for."""

    VOID = ("meta", "link", "img", "wbr")

    def __init__(self):
        super().__init__()
        self.open, self.ids, self.links, self.images = [], [], [], []

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        if tag not in self.VOID:
            self.open.append(tag)
        self.ids += [found["id"]] if "id" in found else []
        self.links += [found["href"]] if "href" in found else []
        self.images += [found["src"]] if "src" in found else []

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_the_page_is_whole(paper):
    folder, found = paper
    text = (folder / "paper.html").read_text()
    page = Page()
    page.feed(text)
    assert page.open == []
    assert len(set(page.ids)) == len(page.ids)
    for link in page.links:
        assert link == "data:," or (link[1:] in page.ids if link.startswith("#") else (folder / link).exists()), link
    # It begins with the figures.
    titles = re.findall(r"<h2>(.*?)</h2>", text)
    assert titles[0].startswith("Fig")
    assert titles.index("Verdicts") > 2
    drawn = {path.read_bytes() for path in folder.glob("*.svg")}
    assert {b64decode(image.removeprefix("data:image/svg+xml;base64,")) for image in page.images} == drawn
    for svg in drawn:
        assert ElementTree.fromstring(svg).tag.endswith("svg")
    assert text.count('class="reproduced"') == sum(claim.verdict == YES for claim in found)
    assert "nan" not in re.sub(r'src="[^"]*"', "", text)


def test_every_curve_has_a_log_to_replay_and_to_fly_again(paper):
    text = (paper[0] / "paper.html").read_text()
    for action in ("replay", "refly"):
        logs = set(re.findall(rf"heli-twin {action} (\S+?\.mcap)", text))
        assert {
            f"{paper[0]}/logs/{case}-seed0.mcap" for case in ("simulated40", "hover", "circle", "circle_pid")
        } < logs
        assert all(paper[0].joinpath(log).exists() for log in logs)


def test_figures_are_the_same_bytes_every_time(paper, tmp_path):
    drawn = {shown.figure.name: shown.figure for shown in figures(pretended(paper[0]))}
    for name in ("fig4", "height"):
        for copy in ("a.svg", "b.svg"):
            write_svg(drawn[name], tmp_path / copy)
        assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
