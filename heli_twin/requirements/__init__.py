"""Requirements: what a flight must do, as signal temporal logic over the signals of its log, and by how much it does.

`file.py` reads them from TOML, `parser.py` a formula from text, `formula.py` computes its robustness; `signals.py`
takes the signals from a log; `judge.py` gives the verdicts.
"""

from heli_twin.requirements.file import Requirement, RequirementError, requirements_of, table_of
from heli_twin.requirements.judge import Decisive, Verdict, decisive, judge

__all__ = [
    "Decisive",
    "Requirement",
    "RequirementError",
    "Verdict",
    "decisive",
    "judge",
    "requirements_of",
    "table_of",
]
