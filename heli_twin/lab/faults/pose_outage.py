"""The cameras lose the helicopter for a while."""

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Unit, doc

from controllers.signals import Pose


@dataclass(frozen=True, slots=True)
class PoseOutage:
    """No pose at all for a while; 0.3 s is what occlusion costs in the field (PX4-Autopilot #8758)."""

    kind: Literal["pose_outage"] = "pose_outage"
    start: Annotated[float, Ge(0), Unit("s"), doc("first lost frame")] = 5.0
    duration: Annotated[float, Ge(0), Unit("s"), doc("how long the helicopter is out of sight")] = 0.3

    def pose(self, pose: Pose) -> Pose | None:
        """Return None during the outage, the pose itself otherwise."""
        return None if self.start <= 1e-9 * pose.stamp < self.start + self.duration else pose
