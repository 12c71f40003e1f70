"""The tracker loses its rigid body and reports NaN."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Unit, doc

from controllers.signals import Pose


@dataclass(frozen=True, slots=True)
class PoseNan:
    """Poses of NaN for a while."""

    kind: Literal["pose_nan"] = "pose_nan"
    start: Annotated[float, Ge(0), Unit("s"), doc("first bad frame")] = 5.0
    duration: Annotated[float, Ge(0), Unit("s"), doc("how long the poses are bad")] = 0.1

    def pose(self, pose: Pose) -> Pose | None:
        """Return NaN during the fault, the pose itself otherwise."""
        bad = self.start <= 1e-9 * pose.stamp < self.start + self.duration
        return Pose(pose.stamp, np.full(3, np.nan), np.full(4, np.nan)) if bad else pose
