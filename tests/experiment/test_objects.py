"""An object that is handed over flies as it is, or is refused in one sentence; NumPy's values are welcome."""

from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

import numpy as np
import pytest
from annotated_types import Gt

from controllers.estimators.kalman import Kalman
from controllers.flatness import FlatOutput
from controllers.laws.ltv_mpc import LtvMpc
from controllers.laws.pid import Pid
from controllers.markers import Named
from controllers.model import Model
from controllers.signals import Command
from controllers.trajectories.hover import Hover
from controllers.trajectories.takeoff_and_landing import TakeoffAndLanding
from controllers.trajectories.waypoints import Waypoints
from heli_twin.cli import main
from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment, Volume
from heli_twin.experiment.text import changed, load
from heli_twin.experiment.tree import ExperimentError, canonical_json, from_json, toml_of
from heli_twin.lab.compute import Modelled
from heli_twin.lab.disturbances.bias import Bias
from heli_twin.lab.disturbances.gust import Gust
from heli_twin.lab.faults.pose_outage import PoseOutage
from heli_twin.lab.mocap import Vicon
from heli_twin.lab.plant.mujoco import MuJoCo
from heli_twin.lab.radio import Dsm2
from heli_twin.mission import fly
from heli_twin.reanalysis.refly import refly

CALLS: list[str] = []


class HoldsThrust:
    def __init__(self, spec):
        self.spec = spec

    def step(self, now, estimate, reference):
        CALLS.append("step")
        return Command(now, np.array(self.spec.model.u_hover))

    def explain(self, command):
        return command


@dataclass(frozen=True, slots=True)
class Mine:
    """Holds the thrust."""

    kind: Literal["mine"] = "mine"
    period: Annotated[float, Gt(0)] = 0.02
    model: Model = field(default_factory=Model)

    @property
    def steps(self):
        return 1

    def start(self):
        return HoldsThrust(self)


@dataclass(frozen=True, slots=True)
class MyPid(Pid):
    def start(self):
        return HoldsThrust(self)


@dataclass(frozen=True)
class MyMpc(LtvMpc):
    def start(self):
        return HoldsThrust(self)


@dataclass(frozen=True, slots=True)
class MyHover(Hover):
    def flat(self, t):
        CALLS.append("flat")
        rest = np.zeros((len(t), 4))
        return FlatOutput(rest + np.array([0, 0, 1.3, 0]), rest, rest)


@dataclass(frozen=True)
class MyPlant(MuJoCo):
    def start(self, x):
        CALLS.append("plant")
        return MuJoCo(mass=0.03).start(x)


@dataclass(frozen=True)
class MyKalman(Kalman):
    def start(self, model):
        CALLS.append("estimator")
        return Kalman(gate=5.0).start(model)


@dataclass(frozen=True)
class MyBias(Bias):
    def start(self, rng):
        CALLS.append("disturbance")
        return Bias(x=0.7)


@dataclass(frozen=True)
class MyOutage(PoseOutage):
    def __getattribute__(self, name):
        if name == "start":
            CALLS.append("fault")
        return super().__getattribute__(name)


@dataclass(frozen=True)
class MyVicon(Vicon):
    def start(self, rng):
        CALLS.append("mocap")
        return Vicon(latency=0.02).start(rng)


@dataclass(frozen=True)
class MyRadio(Dsm2):
    def start(self, rng):
        CALLS.append("radio")
        return Dsm2().start(rng)


@dataclass(frozen=True)
class MyCompute(Modelled):
    def latency_ns(self, rng):
        CALLS.append("compute")
        return 0


OWN = {
    "controller": [Mine(), MyPid(), MyMpc()],
    "trajectory": [MyHover(), TakeoffAndLanding(flight=MyHover())],
    "plant": [MyPlant()],
    "estimator": [MyKalman()],
    "disturbances": [(MyBias(),), (Bias(), MyBias()), (Named("mine", MyBias()),)],
    "faults": [(MyOutage(),)],
    "mocap": [MyVicon()],
    "radio": [MyRadio()],
    "compute": [MyCompute()],
}
EACH = [(name, value) for name, values in OWN.items() for value in values]


@pytest.mark.parametrize(("family", "own"), EACH, ids=[f"{name}{i}" for i, (name, _) in enumerate(EACH)])
def test_an_own_object_flies_and_its_log_is_never_read_as_something_else(family, own, tmp_path, capsys) -> None:
    CALLS.clear()
    experiment = Experiment(duration=0.2, **{family: own})
    result = fly(experiment, log_dir=tmp_path)
    assert CALLS
    assert getattr(result.experiment, family) == own or family == "disturbances"
    assert result.summary()["outcome"] == "completed"
    # The log says whose class it was; so no digest is that of a built-in, and nothing takes it for one.
    log = result.log
    assert '"own_class":"M' in log.experiment
    for read in (lambda: from_json(log.experiment), lambda: refly(log), lambda: changed(experiment, ["seed=1"])):
        with pytest.raises(
            ExperimentError, match=rf"{family}.* is of a class of its user's own, 'M\w+, source "
        ) as caught:
            read()
        assert len(str(caught.value)) < 500
    assert main(["refly", str(result.path)]) == 2
    assert "is of a class of its user's own" in capsys.readouterr().err
    file = tmp_path / "own.toml"
    file.write_text(toml_of(experiment))
    with pytest.raises(ExperimentError, match=r"is of a class of its user's own"):
        load(str(file))


def test_a_member_of_heli_twin_may_take_the_place_of_an_own_one() -> None:
    own = Experiment(controller=MyPid(p_x=1.0), disturbances=(MyBias(),))
    assert changed(own, ["controller=pid", "disturbances.bias=off"]) == Experiment(controller=Pid(), disturbances=())
    for override in ("controller.p_x=2", "controller.model.b_x=2", "disturbances.bias.x=1"):
        with pytest.raises(ExperimentError, match=r"its user's own, 'My"):
            changed(own, [override])


def test_the_same_class_gives_the_same_digest_and_another_one_another() -> None:
    texts = [canonical_json(Experiment(controller=law)) for law in (Pid(), MyPid(), MyPid())]
    assert texts[0] != texts[1] == texts[2]


@dataclass(frozen=True)
class NoSteps:
    kind: str = "mine"
    period: float = 0.02
    model: Model = field(default_factory=Model)


@dataclass
class NotFrozen(Pid.__mro__[1]):
    kind: str = "mine"


@dataclass(frozen=True)
class NoKind(Hover):
    kind: int = 3


@dataclass(frozen=True)
class Odd(Pid):
    gains: np.ndarray = field(default_factory=lambda: np.zeros(3))


REFUSALS = [
    (
        {"controller": NoSteps()},
        "controller is of the class NoSteps, which has no start: it needs kind, model, period, s",
    ),
    ({"controller": NotFrozen()}, "controller is of the class NotFrozen: make it a dataclass that is frozen"),
    ({"controller": HoldsThrust(None)}, "controller is of the class HoldsThrust: make it a dataclass"),
    ({"controller": Pid}, "controller is the class Pid: give an object of it, Pid()"),
    ({"controller": "pid"}, "controller is of the class str: "),
    ({"controller": Odd()}, "controller is of the class Odd, which has a field of an unsupported type"),
    (
        {"controller": replace(Mine(), period=-1.0)},
        "controller.period = -1.0: it must be greater than 0; the default is",
    ),
    ({"controller": replace(Mine(), period=1e-12)}, "controller.period = 0 s is too short: the least is 0.001 s"),
    ({"controller": Mine(model=3)}, "controller.model is of the class int: it has to be a Model"),
    ({"trajectory": NoKind()}, "trajectory is of the class NoKind, which has no kind that is a text"),
    ({"trajectory": None}, "trajectory is of the class NoneType: "),
    ({"volume": Model()}, "volume is of the class Model: it has to be a Volume"),
    ({"disturbances": (Named("gust", MyBias()), Gust())}, None),
    ({"faults": PoseOutage()}, "faults: "),
    ({"seed": "7"}, "seed = '7': it must be a valid integer; the default is 0"),
    ({"seed": True}, "seed = True: it must be a valid integer"),
    ({"duration": np.nan}, "duration = nan is not a finite number"),
    ({"duration": 1 + 2j}, "duration = '(1+2j)': it must be a valid number"),
    ({"volume": Volume(height=np.array([1.0, 2.0]))}, "volume.height = [1.0, 2.0]: it must be a valid number"),
]


@pytest.mark.parametrize(("fields", "said"), REFUSALS, ids=[str(i) for i in range(len(REFUSALS))])
def test_what_is_no_member_is_refused_in_one_sentence(fields, said) -> None:
    experiment = Experiment(**{"duration": 0.1} | fields)
    if said is None:
        assert fly(experiment, log_dir=None).outcome.kind == "completed"
        return
    with pytest.raises(HeliTwinError) as caught:
        fly(experiment, log_dir=None)
    assert str(caught.value).startswith(said)
    assert len(str(caught.value)) < 500


def test_only_an_experiment_flies() -> None:
    for other in ({}, 3, None, Experiment):
        with pytest.raises(ExperimentError, match=r"give an Experiment"):
            fly(other, log_dir=None)


POINTS = ((0.0, 0.0, 1.0, 0.0), (0.5, 0.0, 1.0, 0.0))
NUMPY = [
    ({"seed": np.int64(3)}, {"seed": 3}),
    ({"duration": np.float32(0.5)}, {"duration": 0.5}),
    ({"duration": np.array(0.5)}, {"duration": 0.5}),
    ({"duration": np.int8(1)}, {"duration": 1.0}),
    ({"plant": MuJoCo(mass=np.float64(0.028), servo_lag=np.float32(0.03125))}, {"plant": MuJoCo(servo_lag=0.03125)}),
    ({"controller": LtvMpc(horizon=np.uint16(5), Q=np.ones(10))}, {"controller": LtvMpc(horizon=5, Q=(1.0,) * 10)}),
    ({"controller": LtvMpc(Q=list(np.ones(10)), coupling=np.str_("full"))}, None),
    ({"trajectory": Waypoints(points=np.array(POINTS))}, {"trajectory": Waypoints(points=POINTS)}),
    ({"trajectory": Waypoints(points=[list(p) for p in POINTS])}, {"trajectory": Waypoints(points=POINTS)}),
    (
        {"trajectory": Waypoints(points=POINTS, times=np.linspace(0, 2, 2))},
        {"trajectory": Waypoints(points=POINTS, times=(0.0, 2.0))},
    ),
    ({"disturbances": []}, {"disturbances": ()}),
    ({"disturbances": [Gust(strength=np.float32(0.5)), Bias()]}, {"disturbances": (Bias(), Gust(strength=0.5))}),
    ({"estimator": Kalman(roll_forward=np.bool_(False))}, {"estimator": Kalman(roll_forward=False)}),
    ({"controller": replace(MyPid(), p_x=np.float32(1.5))}, {"controller": MyPid(p_x=1.5)}),
    ({"duration": 1}, {"duration": 1.0}),
]


@pytest.mark.parametrize(("numpy", "python"), NUMPY, ids=[str(i) for i in range(len(NUMPY))])
def test_numpy_values_are_the_same_experiment_with_the_same_digest(numpy, python) -> None:
    short = {"duration": 0.1}
    result = fly(Experiment(**short | numpy), log_dir=None)
    again = fly(Experiment(**short | (python or {"controller": LtvMpc(Q=(1.0,) * 10, coupling="full")})), log_dir=None)
    assert result.flight_digest == again.flight_digest
    assert result.experiment == again.experiment
    assert hash(result.experiment) == hash(again.experiment)


def test_an_experiment_of_pythons_values_is_not_made_again() -> None:
    experiment = load("lab", ["duration=0.1"])
    assert fly(experiment, log_dir=None).experiment is experiment
