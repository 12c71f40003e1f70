"""Makes `rtamt_verdicts.jsonl`: random formulas, random signals, and the robustness that RTAMT computes of them.

RTAMT needs packages of its own time: run this in an environment made for it alone.

    python3 -m venv /tmp/rtamt && /tmp/rtamt/bin/pip install rtamt==0.4.10
    /tmp/rtamt/bin/python tests/requirements/rtamt_verdicts.py > tests/requirements/rtamt_verdicts.jsonl

A line holds the formula in our words, the signals x and y, sampled each second, and RTAMT's robustness at each sample;
the words "inf" and "-inf" stand for what JSON lacks.
"""

import json
import logging
import random

import rtamt


def formula(rng: random.Random, depth: int) -> str:
    if depth == 0 or rng.random() < 0.1:
        sign = rng.choice(["<", "<=", ">", ">="])
        return f"({rng.choice('xy')} {sign} {rng.randint(0, 9)})"
    kind = rng.choice(["not", "and", "or", "implies", "until", "always", "eventually", "always", "eventually"])
    start = rng.randint(0, 3)
    interval = rng.choice(["", f"[{start},{start + rng.randint(0, 6)}]"])
    one, other = formula(rng, depth - 1), formula(rng, depth - 1)
    if kind == "not":
        return f"(not {one})"
    if kind in ("always", "eventually"):
        return f"({kind}{interval} {one})"
    return f"({one} {kind}{interval if kind == 'until' else ''} {other})"


def robustness(text: str, signals: dict[str, list[float]]) -> list[float]:
    spec = rtamt.StlDiscreteTimeSpecification()
    for name in signals:
        spec.declare_var(name, "float")
    spec.spec = f"out = {text}"
    spec.parse()
    times = list(range(len(signals["x"])))
    return [value for _, value in spec.evaluate({"time": times, **signals})]


def main() -> None:
    logging.disable(logging.WARNING)
    rng = random.Random(20261126)
    for _ in range(1000):
        text, n = formula(rng, rng.randint(1, 4)), rng.randint(2, 14)
        signals = {name: [float(rng.randint(-9, 18)) for _ in range(n)] for name in "xy"}
        values = [v if abs(v) < float("inf") else str(v) for v in robustness(text, signals)]
        ours = text.replace("[", "[ ").replace(",", "s,").replace("]", "s]")
        print(json.dumps({"formula": ours, "x": signals["x"], "y": signals["y"], "robustness": values}))


if __name__ == "__main__":
    main()
