"""`heli-twin import`: a motion-capture recording becomes a log."""

import sys
from argparse import ArgumentParser, Namespace, _SubParsersAction
from pathlib import Path

from heli_twin.commands import command

SUSPICIOUS = 0.1
"""Share of poses that cannot all be outliers."""


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "import",
        run,
        "turn a motion-capture recording into a log",
        "Turn a CSV file of poses into a log that replay, reestimate and identification take.\n"
        "Fields: time and arrival (s), x y z (m), yaw (rad) or qw qx qy qz (body to world), and the commands\n"
        "ux uy uz uyaw (fraction of full stick) where they are known. World is north-west-up, body is x to the nose,\n"
        "y to port, z up. A row without a pose is a lost frame, or a command between two frames; a command counts\n"
        "from the time of its row on. The log has no truth, and no reference unless a trajectory is given.",
        "  heli-twin import poses.csv\n"
        "  heli-twin import poses.csv --map time=t,x=px*0.001,y=py*0.001,z=pz*0.001,yaw=heading\n"
        "  heli-twin import poses.csv controller.model.b_z=17.5 mocap.latency=0.008 --out flight.mcap",
    )
    parser.add_argument("poses", type=Path, metavar="POSES.csv", help="the recording; its first line names the columns")
    parser.add_argument("overrides", nargs="*", metavar="path.to.field=value", help="what is known of that flight")
    parser.add_argument(
        "--map", default="", metavar="FIELD=COLUMN[*FACTOR],...", help="where the columns have other names or units"
    )
    parser.add_argument(
        "--out", type=Path, metavar="RUN.mcap", help="the log (default POSES.mcap beside the recording)"
    )


def run(parsed: Namespace) -> int:
    """Import it."""
    from heli_twin.exchange.import_poses import import_poses
    from heli_twin.exchange.pose_csv import parse_map

    out = parsed.out or parsed.poses.with_suffix(".mcap")
    found = import_poses(parsed.poses, parse_map(parsed.map), out, parsed.overrides)
    print(
        f"wrote {out}: {len(found.stamp)} poses, {found.lost} rows without one, {len(found.command_time)} commands,"
        f" {1e-9 * (found.stamp[-1] - found.stamp[0]):.2f} s"
    )
    if found.refused > SUSPICIOUS * len(found.stamp):
        print(
            f"the estimator refused {found.refused} poses: are they in m and rad, and is the world north-west-up?",
            file=sys.stderr,
        )
    return 0
