"""The shadow of calibrated helicopters: false alarms on quiet flights, and how soon a fault is told."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hidden_twins import calibrated, hidden

from heli_twin.calibration.output import as_toml
from heli_twin.experiment import Experiment
from heli_twin.experiment.text import changed, load
from heli_twin.mission import fly
from heli_twin.validation.band import DEFAULT
from heli_twin.validation.shadow import Alarm, from_log, watched
from heli_twin.workers.fleet import fleet

LAWS = ["controller=detailed_mpc", "estimator=detailed_kalman"]
BEGIN_S = 12.0
FAULTS = {
    "motor_loss": ["faults.motor_loss=on", f"faults.motor_loss.start={BEGIN_S}", "faults.motor_loss.duration=20"],
    "servo_weak": ["faults.servo_weak=on", f"faults.servo_weak.start={BEGIN_S}", "faults.servo_weak.duration=20"],
    # From the start half the capacity and twice the resistance: the shadow learns the first six seconds as normal.
    "battery": [
        "plant.effects.battery=on",
        "plant.effects.battery.capacity=0.05",
        "plant.effects.battery.resistance=0.6",
    ],
}
PLANS = ("hover", "circle", "lemniscate")


def alarms(experiment: Experiment, path: Path, what: tuple[str, list[str], int]) -> tuple[float, list]:
    """Seconds watched, and the events of one flight that leave the band."""
    plan, fault, seed = what
    flight = changed(experiment, [f"trajectory={plan}", "duration=30", f"seed={seed}", *fault])
    alarm = Alarm(DEFAULT, 1.0)
    messages = from_log(fly(flight, log_dir=None).log)
    events = [e for seen in watched(load(str(path), LAWS), messages) for e in alarm.events(seen) if e.event == "left"]
    return alarm.seconds, events


@pytest.mark.long
@pytest.mark.parametrize(("lab", "seed"), [("lab_simple", 330), ("lab", 331)])
def test_quiet_flights_are_quiet_and_faults_are_told_soon(lab, seed, tmp_path):
    experiment, path = hidden(lab, seed), tmp_path / "calibration.toml"
    path.write_text(as_toml(calibrated(experiment, anyway=True)))
    quiet = [(PLANS[i % 3], [], 5000 + i) for i in range(24)]
    faulty = [(plan, fault, 6000) for fault in FAULTS.values() for plan in PLANS]
    with fleet() as run:
        rows = list(run(partial(alarms, experiment, path), quiet + faulty))
    told, hours = [e for _, events in rows[:24] for e in events], sum(s for s, _ in rows[:24]) / 3600.0
    print(f"\n{lab}: {len(told)} false alarms in {60 * hours:.1f} min at a stated rate of 1 an hour")
    assert len(told) <= 1, told
    delays = {}
    for (plan, fault, _), (_, events) in zip(faulty, rows[24:], strict=True):
        name = next(key for key, value in FAULTS.items() if value == fault)
        begin = 0.0 if name == "battery" else BEGIN_S
        first = next((e for e in events if e.time > begin), None)
        delays.setdefault(name, []).append(first.time - begin if first else np.inf)
        print(f"  {name} on {plan}: {f'{delays[name][-1]:.2f} s, {first.statistic}' if first else 'not told'}")
    assert max(delays["motor_loss"]) < 1.0
    # In hover the sticks hardly move: half a gain shows slowly.
    assert np.median(delays["servo_weak"]) < 3.0
    assert np.median(delays["battery"]) < 25.0
