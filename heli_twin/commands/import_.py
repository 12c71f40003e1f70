"""`heli-twin import`: a motion-capture recording becomes a log."""

import sys
from argparse import ArgumentParser, Namespace, _SubParsersAction
from typing import TYPE_CHECKING

from heli_twin.commands import command, file_path, say

if TYPE_CHECKING:
    from heli_twin.exchange.cleaning import Clean
    from heli_twin.exchange.formats import Take

SUSPICIOUS_SHARE = 0.1
"""Share of poses that cannot all be outliers."""


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "import",
        run,
        "turn a motion-capture recording into a log",
        "Turn a recording of poses into a log that replay, reestimate and identify take. Read as exported, and\n"
        "recognised by their content: OptiTrack Motive CSV, Vicon Tracker and Nexus CSV, Qualisys 6D TSV, TUM, EuRoC,\n"
        "ROS 2 bags in MCAP, and any table of columns, whose fields are\n"
        "time and arrival, x y z (m), yaw (rad) or qw qx qy qz (body to world), and the commands ux uy uz uyaw\n"
        "(fraction of full stick), as many of them as are known. Our world is north-west-up, our body nose-port-up.\n"
        "Lost frames, rows of zeros, repeated times, late rows and half turns are cleaned, counted and reported.\n"
        "A command counts from the time of its row on. The log has no truth, and no reference unless a trajectory\n"
        "is given.",
        "  heli-twin import take.csv\n"
        "  heli-twin import take.csv --commands sent.csv      # then calibrate and identify can use it\n"
        "  heli-twin import take.csv --list\n"
        "  heli-twin import poses.csv --map time=t,x=px,y=py,z=pz,yaw=heading,ux=0 --units mm\n"
        "  heli-twin import poses.csv controller.model.b_z=17.5 mocap.latency=0.008 --out flight.mcap",
    )
    parser.add_argument("poses", type=file_path, metavar="RECORDING", help="the recording")
    parser.add_argument(
        "overrides", nargs="*", default=[], metavar="path.to.field=value", help="what is known of that flight"
    )
    parser.add_argument(
        "--map",
        default="",
        metavar="FIELD=COLUMN[*FACTOR],...",
        help="for a table: the columns by name or number, with a factor; 0 or a number with a point is a constant",
    )
    parser.add_argument("--body", default="", help="name of the body, where the recording has several")
    parser.add_argument("--frame", default="", help="its axes: zup, yup, ned or enu (default: what the format says)")
    parser.add_argument("--units", default="", help="of its lengths: m, mm, cm, in or ft (default: what the file says)")
    parser.add_argument("--rate", type=float, default=0.0, metavar="HZ", help="where the time column counts frames")
    parser.add_argument(
        "--rotation", default="", choices=["euler", "vector"], help="what Vicon's RX RY RZ are (default: euler)"
    )
    parser.add_argument(
        "--commands",
        type=file_path,
        metavar="FILE.csv",
        help="the sent commands, where the cameras know none: columns time (s, on their clock), ux, uy, uz, uyaw",
    )
    parser.add_argument("--unchecked", action="store_true", help="import what no helicopter in a room can have left")
    parser.add_argument("--list", action="store_true", help="show what is recognised, and import nothing")
    parser.add_argument("--out", type=file_path, metavar="RUN.mcap", help="the log (default: beside the recording)")


def run(parsed: Namespace) -> int:
    """Import it."""
    from heli_twin.exchange.formats import ImportRefused, Options
    from heli_twin.exchange.import_poses import Reading, import_poses, read_recording, recognised

    options = Options(parsed.body, parsed.rotation, parsed.map)
    if parsed.rate and not 1.0 <= parsed.rate <= 10_000.0:
        raise ImportRefused(f"--rate {parsed.rate:g} is no rate of cameras: 1 to 10000 Hz")
    reading = Reading(options, parsed.frame, parsed.units, parsed.rate, not parsed.unchecked, parsed.commands)
    if parsed.list:
        say(f"{parsed.poses}: {recognised(parsed.poses).TITLE}")
        take, recording = read_recording(parsed.poses, reading)
        say(f"bodies: {', '.join(take.bodies) or 'one without a name'}")
        _report(take, recording, parsed.frame)
        return 0
    out = parsed.out or parsed.poses.with_suffix(".mcap")
    imported = import_poses(parsed.poses, out, reading, parsed.overrides)
    say(f"wrote {out}")
    _report(imported.take, imported.recording, parsed.frame)
    if imported.refused > SUSPICIOUS_SHARE * len(imported.recording.time):
        print(
            f"the estimator refused {imported.refused} poses: are they in m and rad, and is the world north-west-up?",
            file=sys.stderr,
        )
    return 0


def _report(take: "Take", recording: "Clean", frame: str) -> None:
    """Print what a recording holds and what was wrong with it."""
    from heli_twin.exchange.frames import FRAMES

    seconds = recording.time[-1] - recording.time[0]
    body = f" of {take.body}" if take.body else ""
    say(
        f"{take.title}: {len(recording.time)} poses{body} at {recording.rate:.1f} Hz, {seconds:.2f} s,"
        f" {recording.lost} rows without one, {len(recording.command_time)} commands"
    )
    say(f"axes in the file: {FRAMES[frame or take.frame].text}")
    for note in take.notes:
        say(f"assumed: {note}")
    for blemish in recording.blemishes:
        say(f"{blemish.rows:>8} {blemish.text}, first at {blemish.first_s:.2f} s")
