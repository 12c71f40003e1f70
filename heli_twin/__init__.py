"""A digital twin of a 28 g coaxial helicopter and the lab it flies in.

An `Experiment` is a value that determines a flight; `fly` flies it and returns a `Result`; its log, an MCAP file, is
read by `read_log`. `load` makes an experiment from a preset or a TOML file, and changes of single fields:

    from heli_twin import Experiment, fly, fly_several, load, load_several, load_study, plot, read_log, run

    result = fly("lab")                                   # a preset, or a TOML file
    result = fly(load("lab", ["trajectory=hover", "plant.mass=0.030"]))
    print(result.outcome, result.summary()["max_abs_error"], result.path)

    result = fly(Experiment(seed=3), log_dir=None)        # the log stays in memory: result.log

    room = fly_several(load_several("swap4"))             # several helicopters in one room, a Several

    log = read_log(result.path)                           # NumPy columns of every topic
    print(log.topics, log.truth.seconds[-1], log.truth.position - log.reference.position)

    rows = run("mass")                                    # a shipped study: an Arrow table, one row a flight
    rows = run(load_study("mine.toml", ["replicates=5"])) # or one of yours, or a `Study` made here

    figure = plot("A.mcap", "B.mcap", what="tracking")    # matplotlib, without a window; a notebook shows it

A mistake of the caller's is a `HeliTwinError` whose message says what to do: an `ExperimentError` names the field of
an experiment, a `LogError` the log. How a flight ended is data: `result.outcome`.

Where to look next: `heli-twin guide` has a page on each subject; `help(Experiment)` and `heli-twin show` tell every
field with its unit; `controllers.laws` and its neighbours hold the families to which you can add a member;
`heli_twin.exchange.arrow_tables` turns a log into Arrow tables.

What `__all__` names is public. Everything else may change.
"""

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from heli_twin.errors import HeliTwinError
    from heli_twin.experiment import Experiment
    from heli_twin.experiment.several import Several
    from heli_twin.experiment.several_text import load_several
    from heli_twin.experiment.text import load
    from heli_twin.experiment.tree import ExperimentError
    from heli_twin.mission import Result, fly
    from heli_twin.plots import plot
    from heli_twin.recording import Log, LogError, read_log
    from heli_twin.several.fly import fly_several
    from heli_twin.studies.run import run
    from heli_twin.studies.study import Study, load_study

__all__ = [
    "Experiment",
    "ExperimentError",
    "HeliTwinError",
    "Log",
    "LogError",
    "Result",
    "Several",
    "Study",
    "fly",
    "fly_several",
    "load",
    "load_several",
    "load_study",
    "plot",
    "read_log",
    "run",
]

_HOME = {
    "Experiment": "heli_twin.experiment",
    "ExperimentError": "heli_twin.experiment.tree",
    "HeliTwinError": "heli_twin.errors",
    "Log": "heli_twin.recording",
    "LogError": "heli_twin.recording",
    "Result": "heli_twin.mission",
    "Several": "heli_twin.experiment.several",
    "Study": "heli_twin.studies.study",
    "fly": "heli_twin.mission",
    "fly_several": "heli_twin.several.fly",
    "load": "heli_twin.experiment.text",
    "load_several": "heli_twin.experiment.several_text",
    "load_study": "heli_twin.studies.study",
    "plot": "heli_twin.plots",
    "read_log": "heli_twin.recording",
    "run": "heli_twin.studies.run",
}
"""The module of each public name; it is imported when the name is first used, so that the command line starts fast."""


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'heli_twin' has no attribute '{name}'")
    value = globals()[name] = getattr(import_module(_HOME[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def _check_the_ground_station() -> None:
    """Raise ImportError if another package called `controllers` would be imported instead of the one beside this."""
    spec = find_spec("controllers")
    here = Path(__file__).resolve().parents[1]
    if spec is None or spec.origin is None:
        raise ImportError(f"heli_twin needs the package 'controllers' in {here}: install it again", name=__name__)
    there = Path(spec.origin).resolve()
    if there.parent != here / "controllers":
        shadow = there.parent if there.name == "__init__.py" else there
        raise ImportError(
            f"{shadow} hides the package 'controllers' of heli_twin, which is in {here}: rename it", name=__name__
        )


_check_the_ground_station()
