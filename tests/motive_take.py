"""A flown log as OptiTrack Motive would export it, and its commands as a ground station would write them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from heli_twin.exchange.frames import FRAMES
from heli_twin.recording import Log

HEADER = """Format Version,1.23,Take Name,01,Rotation Type,Quaternion,Length Units,Millimeters,Coordinate Space,Global

,Type,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body
,Name,heli,heli,heli,heli,heli,heli,heli
,ID,7264,7264,7264,7264,7264,7264,7264
,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position
Frame,Time (Seconds),X,Y,Z,W,X,Y,Z
"""


def motive_take(log: Log, path: Path, every: int = 1, gaps: Sequence[tuple[float, float]] = ()) -> Path:
    """Write the poses: y up, millimetres, six digits, time from the first frame on, and empty cells in gaps (s, s)."""
    frame = FRAMES["yup"]
    stamps, first = np.unique(log.pose.stamp, return_index=True)
    time = 1e-9 * (stamps - stamps[0])[::every]
    position = 1e3 * (log.pose.position[first] @ frame.R_ours_world)[::every]
    ours = Rotation.from_quat(log.pose.quat_wxyz[first], scalar_first=True)
    theirs = Rotation.from_matrix(frame.R_ours_world.T) * ours * Rotation.from_matrix(frame.R_ours_body)
    rows = []
    for i, (t, q, p) in enumerate(zip(time, theirs.as_quat()[::every], position, strict=True)):
        lost = any(begin <= t < end for begin, end in gaps)
        rows.append(f"{i},{t:.6f}," + (",,,,,," if lost else ",".join(f"{v:.6f}" for v in (*q, *p))))
    path.write_text(HEADER + "\n".join(rows) + "\n")
    return path


def commands_of(log: Log, path: Path) -> Path:
    """Write the sent commands on the clock of `motive_take`."""
    since = 1e-9 * (log.sent.time - log.pose.stamp.min())
    rows = (",".join(map(repr, (t, *u))) for t, u in zip(since.tolist(), log.sent.u.tolist(), strict=True))
    path.write_text("time,ux,uy,uz,uyaw\n" + "\n".join(rows) + "\n")
    return path
