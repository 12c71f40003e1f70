"""Times of the parts: `pytest tests/benchmarks --benchmark-only`. Nothing here can fail for being slow.

Run it on an idle machine; `--benchmark-json FILE` keeps every round. Flights, solvers and commands are in `court.py`.
"""

import subprocess
from collections.abc import Iterator

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from controllers.detailed_model import ESTIMATED_STATES
from controllers.laws import closed_after, preview_of
from controllers.laws.detailed_mpc import DetailedMpc
from controllers.laws.external import External
from controllers.laws.ltv_mpc import LtvMpc
from controllers.model import GRAVITY
from controllers.reference import ReferencePreview
from controllers.signals import Estimate, Reference
from controllers.trajectories.circle import Circle

PERIOD = 20_000_000
STEPS = 500


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    with threadpool_limits(limits=1):
        yield


def circle(law: LtvMpc | DetailedMpc) -> list[tuple[Estimate, Reference]]:
    """What a controller is given on the circle, with estimation errors of the size the lab has."""
    preview, rng = preview_of(law, Circle(), PERIOD, 0), np.random.default_rng(0)
    further = np.array([s.name == "thrust_acceleration" for s in ESTIMATED_STATES]) * GRAVITY
    scatter = np.array([0.01, 0.01, 0.002, 0.01, 0.02, 0.02, 0.01, 0.1])
    given = []
    for k in range(STEPS):
        reference = preview(k * PERIOD, law.steps)
        x = reference.x[0] + scatter * rng.standard_normal(8)
        given.append(
            (Estimate(k * PERIOD, x, np.zeros(4), np.zeros((4, 3)), k * PERIOD, 0, further, 0 * further), reference)
        )
    return given


@pytest.mark.parametrize("law", [LtvMpc(), LtvMpc(coupling="full"), DetailedMpc()], ids=["removed", "full", "detailed"])
def test_control_step_on_the_circle(benchmark, law):
    given, controller = circle(law), law.start()
    upcoming = iter(given * 20)

    def step() -> None:
        estimate, reference = next(upcoming)
        controller.step(estimate.stamp, estimate, reference)

    benchmark.pedantic(step, rounds=5000, warmup_rounds=100)
    benchmark.extra_info["p99_ms"] = 1e3 * np.percentile(benchmark.stats.stats.data, 99)


def test_infeasible_starts(benchmark):
    """Random starts, nine in ten of them outside the velocity limits; look at the maximum."""
    law, rng = LtvMpc(), np.random.default_rng(0)
    reference = ReferencePreview(Circle(), law.model, PERIOD, 0)(0, law.steps)
    spread = np.array([2, 2, 2, 6, 6, 6, 4, 40])

    def start() -> tuple[tuple, dict]:
        x = spread * rng.uniform(-1.0, 1.0, 8)
        return (law.start(), Estimate(0, x, np.zeros(4), np.zeros((4, 3)), 0, 0)), {}

    benchmark.pedantic(lambda controller, estimate: controller.step(0, estimate, reference), setup=start, rounds=1000)


@pytest.mark.parametrize("steps", [1, 19])
def test_control_step_of_another_process(benchmark, steps, tmp_path):
    """What asking a program costs: one in C that reads every number and answers with a hover at once."""
    (tmp_path / "hover.c").write_text(HOVER_C)
    subprocess.run(["cc", "-O2", "hover.c", "-o", "hover"], cwd=tmp_path, check=True)
    law = External(command=(str(tmp_path / "hover"),), steps=steps)
    preview = ReferencePreview(Circle(), law.model, PERIOD, 0)
    given = [(k * PERIOD, preview(k * PERIOD, steps)) for k in range(STEPS)]
    upcoming = iter(given * 20)
    with closed_after(law.start()) as controller:

        def step() -> None:
            now, reference = next(upcoming)
            controller.step(now, Estimate(now, reference.x[0], np.zeros(4), np.zeros((4, 3)), now, 0), reference)

        benchmark.pedantic(step, rounds=5000, warmup_rounds=100)
    benchmark.extra_info["p99_ms"] = 1e3 * np.percentile(benchmark.stats.stats.data, 99)


HOVER_C = r"""
#include <stdio.h>
int main(void) {
    double now, number;
    int steps, i;
    scanf("heli_twin 1 %lf %d 8 4 0", &number, &steps);
    for (i = 0; i < 12; i++) scanf("%lf", &number);
    for (printf("heli_twin 1\n"), fflush(stdout); scanf("%lf", &now) == 1; fflush(stdout)) {
        for (i = 1; i < 36 + 12 * steps; i++) scanf("%lf", &number);
        printf("%.0f 0 0 0.545 0\n", now);
    }
    return 0;
}
"""
