"""`pytest tests/benchmarks --benchmark-only -k court`: one table, and `court.json` beside it. It fails for no time.

To release, copy `.benchmarks/court.json` to `tests/benchmarks/release.json`: the next court is compared with it.
"""

from pathlib import Path

from tests.benchmarks import court

ROOT = Path(__file__).parents[2]


def test_court(benchmark, tmp_path, capsys):
    found = benchmark.pedantic(court.measure, args=(tmp_path,), rounds=1)
    step = court.control_step(tmp_path)
    out = ROOT / ".benchmarks" / "court.json"
    out.parent.mkdir(exist_ok=True)
    out.write_text(court.as_json(*found, step))
    with capsys.disabled():
        print(f"\n{court.table(*found, step)}\n{out}")
