"""The proof that planned helicopters keep apart and arrive: hundreds of flights, each flown once and written down.

`python tests/room_proof.py RESULTS.jsonl` flies what the file does not have yet, prints a line a flight, and then the
table; stopped, it goes on where it was. `python tests/room_proof.py RESULTS.jsonl table` only prints the table.
Flights of other code than this are flown again. 59 flights without a failure are 95 % sure of 95 %.
"""

import hashlib
import json
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[1]
APART_M = 0.30
"""Nobody comes nearer, in the plane."""
LABS = {"lab": (), "lab_simple": ("base=lab_simple", "controller.terminal=riccati", "controller.R=[2,2,2,2]")}
FIRST_DRAW = {8: 44_000, 4: 45_000}
"""Of the random flights of so many: none of them was looked at while the planner was written."""
SPEED = 1.4
"""Greatest wished speed of random flights, m/s: plans may fly at 1 m/s north and 1 m/s west, 1.4 in between."""
SHORT = {8: (), 4: ("scenario.acceleration=1.2",)}
"""Of four, which have short ways and hardly reach that speed: more than the usual 1 m/s^2."""


class Case(NamedTuple):
    """One flight."""

    group: str
    preset: str
    overrides: tuple[str, ...]
    seconds: tuple[float, ...]
    """Durations to try: a flight in which all have arrived needs no more."""
    down: str = ""
    """Who does not arrive, since it lands in an emergency."""


def cases() -> list[Case]:
    """Return all flights, of each group by turns, so that what has been flown tells of all groups."""
    return [case for row in zip_longest(*groups()) for case in row if case]


def groups() -> Iterator[list[Case]]:
    """Yield the flights of each group."""
    for ships, flights, seconds in ((8, 60, (7.0, 25.0)), (4, 20, (5.0, 15.0))):
        first = FIRST_DRAW[ships]
        for lab, words in LABS.items():
            for loss in (0.0, 0.3):
                draws, first = range(first, first + flights), first + flights
                yield [
                    Case(
                        f"{ships} at random, {lab}, loss {loss:g}",
                        "swap8",
                        (
                            "scenario=random",
                            f"scenario.ships={ships}",
                            f"scenario.speed={SPEED}",
                            *SHORT[ships],
                            f"scenario.draw={draw}",
                            f"seed={draw}",
                            f"network.loss={loss}",
                            *words,
                        ),
                        seconds,
                    )
                    for draw in draws
                ]
    for lab, words in LABS.items():
        yield [
            Case(f"swaps, {lab}", preset, (f"network.loss={loss}", "seed=77", *words), (8.0, 20.0))
            for preset in ("pair", "swap4", "swap8")
            for loss in (0.0, 0.3)
        ]
    yield [
        Case("messages lost for a while", preset, (f"network.outage={outage}", "network.outage_start=1.2"), (9.0, 25.0))
        for preset in ("swap4", "swap8")
        for outage in (0.1, 0.5, 1.0, 2.0)
    ]
    for what, fault in FAILURES.items():
        yield [Case(what, *words) for words in crowds(fault)]


FAILURES = {
    "one whose cameras fail": ("faults.pose_outage.duration=60", "faults.pose_outage.start={start:g}"),
    "one that lands in an emergency": ("supervisor.low_voltage={volts:g}",),
}
"""Of one helicopter, by name. The battery sags by a hundredth of a volt in the first seconds."""


def crowds(faults: tuple[str, ...]) -> Iterator[tuple[str, tuple[str, ...], tuple[float, ...], str]]:
    """Yield flights in which one in a crowd cannot go on: preset, overrides, duration, and who lands."""
    for i in range(16):
        preset, ships = ("swap8", "abcdefgh") if i % 4 else ("swap4", "abcd")
        ship = ships[i % len(ships)]
        of_one = [f"ships.{ship}.{fault.format(start=1.5 + 0.12 * i, volts=3.943 + 0.0002 * i)}" for fault in faults]
        yield preset, (f"seed={900 + i}", f"network.loss={0.3 * (i % 2):g}", *of_one), (8.0,), ship


def flown(case: Case) -> dict[str, Any]:
    """Fly, and return what is written down."""
    from heli_twin.experiment.several_text import load_several
    from heli_twin.several.fly import fly_several

    began = time.process_time()
    for seconds in case.seconds:
        several = load_several(case.preset, (*case.overrides, f"duration={seconds:g}"))
        summary = fly_several(several, log_dir=None).summary()
        if summary["arrived"] == len(summary["ships"]):
            break
    ships = summary["ships"]
    return {
        "least": summary["least_distance_in_plane"],
        "planned": summary["least_planned"],
        "promised": several.coordination.distance,
        "arrived": summary["arrived"],
        "ships": len(ships),
        "time": summary["time_to_goal"],
        "outcomes": {name: ship["outcome"] for name, ship in ships.items() if ship["outcome"] != "completed"},
        "cpu": time.process_time() - began,
    }


def trouble(case: Case, result: dict[str, Any]) -> str:
    """Return what is wrong with a flight, empty for nothing."""
    if result["least"] < APART_M:
        return f"{result['least']:.3f} m apart"
    # Plans are compared every 20 ms: to within the solver's tolerance.
    if result["planned"] < result["promised"] - 1e-6:
        return f"plans {result['planned']:.4f} m apart"
    if case.down:
        return "" if result["outcomes"] == {case.down: "landed"} else f"outcomes {result['outcomes']}"
    return "" if result["arrived"] == result["ships"] else f"{result['arrived']} of {result['ships']} arrived"


def key_of_code() -> str:
    """Return a digest of all that decides a flight."""
    files = [file for room in ("controllers", "heli_twin", "models") for file in sorted((ROOT / room).rglob("*"))]
    text = b"".join(file.read_bytes() for file in files if file.suffix in (".py", ".toml", ".xml"))
    return hashlib.sha256(text).hexdigest()[:16]


def results_of(path: Path, key: str) -> dict[str, dict[str, Any]]:
    """Return the results of this code that a file has, by the name of the case; a line half-written is left out."""
    rows: dict[str, dict[str, Any]] = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        with suppress(ValueError):
            row = json.loads(line)
            if row["code"] == key:
                rows[row["case"]] = row
    return rows


def prove(path: Path, only: str = "", code: str = "") -> dict[Case, dict[str, Any]]:
    """Fly what a file does not have yet, print a line for each, and return the results.

    Args:
        path: The file of results.
        only: Beginning of the groups to fly.
        code: Digest of the code whose results count; this code if not given.
    """
    key = code or key_of_code()
    known, wanted = results_of(path, key), [case for case in cases() if case.group.startswith(only)]
    results: dict[Case, dict[str, Any]] = {}
    for number, case in enumerate(wanted, 1):
        name = " ".join((case.preset, *case.overrides))
        if name not in known:
            known[name] = {"code": key, "case": name, **flown(case)}
            with path.open("a", encoding="utf-8") as file:
                # After a line that was cut off, a new one.
                file.write("\n" + json.dumps(known[name]))
            result = known[name]
            when = f"{result['time']:.1f} s" if result["time"] else f"{result['arrived']} arrived"
            print(
                f"[{number}/{len(wanted)}] {case.group}, {name}: {result['least']:.3f} m, plans"
                f" {result['planned']:.3f} m, {when} ({result['cpu']:.0f} s CPU) {trouble(case, result).upper()}",
                flush=True,
            )
        results[case] = known[name]
    return results


def table(results: dict[Case, dict[str, Any]]) -> str:
    """Return a table with a line a group."""
    lines = [
        "| flights | flown | least apart, m | plans, m | all there, mean and last, s | failures |",
        "|---|--:|--:|--:|--:|---|",
    ]
    for group in dict.fromkeys(case.group for case in results):
        rows = [(case, result) for case, result in results.items() if case.group == group]
        least, plans = (min(result[what] for _, result in rows) for what in ("least", "planned"))
        times = [result["time"] for _, result in rows if result["time"]]
        there = f"{sum(times) / len(times):.1f}, {max(times):.1f}" if times else ""
        wrong = "; ".join(why for case, result in rows if (why := trouble(case, result)))
        lines.append(f"| {group} | {len(rows)} | {least:.3f} | {plans:.3f} | {there} | {wrong or 'none'} |")
    return "\n".join(lines)


def main(path: str, what: str = "") -> int:
    """Fly and print the table; return 1 if a flight failed."""
    if what == "table":
        known = results_of(Path(path), key_of_code())
        results = {case: known[name] for case in cases() if (name := " ".join((case.preset, *case.overrides))) in known}
    else:
        results = prove(Path(path))
    print(table(results))
    return int(any(trouble(case, result) for case, result in results.items()))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
