"""ROS 2 bags in MCAP with poses: `PoseStamped`, `TransformStamped`, `Odometry` and `/tf`.

The stamp of the header is when the cameras saw the pose, the log time when it arrived; a header without a stamp leaves
the log time for both. World and body are x forward, y left, z up (REP 103).
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from heli_twin.exchange.formats import MAX_ROWS, ImportRefused, Options, Take, chosen_body
from heli_twin.recording.foreign_bag import BagMessage, bag_messages
from heli_twin.terminal_text import clean

TITLE = "ROS 2 bag (MCAP)"
MAX_LATENESS_S = 1.0
"""From the header's stamp to the log time, where both are of one clock."""
_POSE, _TRANSFORM, _ODOMETRY = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/TransformStamped",
    "nav_msgs/msg/Odometry",
)
_TF = "tf2_msgs/msg/TFMessage"


def recognises(head: list[str]) -> bool:
    """Return whether the file begins as MCAP does."""
    return bool(head) and head[0].startswith("\N{REPLACEMENT CHARACTER}MCAP0")


def read(path: Path, options: Options) -> Take:
    """Read a bag.

    Raises:
        HeliTwinError: It is damaged, has no poses, or the body is not in it, or ROS 2 messages cannot be decoded here.
    """
    rows: dict[str, list[list[float]]] = {}
    count = 0
    decode = _decoder()
    for message in bag_messages(path, (_POSE, _TRANSFORM, _ODOMETRY, _TF)):
        if message.encoding != "cdr":
            raise ImportRefused(
                f"{path}: {clean(message.topic, 80)} is encoded as {clean(message.encoding, 20)}, not CDR"
            )
        try:
            poses = list(_poses(message, decode))
        except (ValueError, IndexError, TypeError, KeyError, AssertionError) as error:
            what = f"{clean(message.topic, 80)} is no {message.schema}"
            raise ImportRefused(f"{path}: a message of {what}: {clean(str(error), 80)}") from None
        for body, row in poses:
            count += 1
            if count > MAX_ROWS:
                raise ImportRefused(f"{path} has more than {MAX_ROWS} poses: import it in parts")
            rows.setdefault(body, []).append(row)
    if not rows:
        raise ImportRefused(f"{path} has no poses: they have to be {_POSE}, {_TRANSFORM}, {_ODOMETRY} or {_TF}")
    body = chosen_body(path, list(rows), options.body)
    table = np.array(rows[body], float)
    lateness = np.median(table[:, 1] - table[:, 0])
    return Take(
        title=TITLE,
        time=table[:, 0],
        # Another clock tells nothing of the way of a pose.
        arrival=table[:, 1] if 0.0 <= lateness < MAX_LATENESS_S else None,
        position=table[:, 2:5],
        quat_wxyz=table[:, 5:9],
        body=body,
        bodies=tuple(rows),
    )


def _decoder() -> Any:
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise ImportRefused('ROS 2 messages are read by rosbags: pip install "heli-twin[ros]"') from None
    return get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr


def _poses(message: BagMessage, decode: Any) -> Iterator[tuple[str, list[float]]]:
    """The name of each body in a message, and its row: stamp and arrival (s), position, quaternion."""
    decoded = decode(message.data, message.schema)
    topic = clean(message.topic, 100)
    if message.schema == _TF:
        for transform in decoded.transforms:
            yield f"{topic}:{clean(transform.child_frame_id, 100)}", _of_transform(transform, message.log_time)
    elif message.schema == _TRANSFORM:
        yield topic, _of_transform(decoded, message.log_time)
    else:
        pose = decoded.pose.pose if message.schema == _ODOMETRY else decoded.pose
        yield topic, _row(decoded.header, pose.position, pose.orientation, message.log_time)


def _of_transform(transform: Any, log_time: int) -> list[float]:
    return _row(transform.header, transform.transform.translation, transform.transform.rotation, log_time)


def _row(header: Any, p: Any, q: Any, log_time: int) -> list[float]:
    stamp = header.stamp.sec * 1_000_000_000 + header.stamp.nanosec or log_time
    return [1e-9 * stamp, 1e-9 * log_time, p.x, p.y, p.z, q.w, q.x, q.y, q.z]
