"""Tests that pass with the code broken prove nothing: the nearest tests have to notice random one-token mutations.

`MUTATIONS=60 MUTATED=controllers pytest -m long tests/test_mutations.py -s` mutates 60 places of one room and prints
the table of `tests/mutants.py`; `MUTATION_SEED` chooses others.
"""

import os
import subprocess
import sys

import mutants
import pytest

COUNT, SEED = os.environ.get("MUTATIONS", "40"), os.environ.get("MUTATION_SEED", "0")


@pytest.mark.long
@pytest.mark.parametrize("room", os.environ.get("MUTATED", " ".join(mutants.ROOMS)).split())
def test_the_tests_notice_nineteen_of_twenty_mutations(room):
    # In a process of its own: a mutant is imported in a fork of one that has not imported the original.
    words = [sys.executable, mutants.__file__, room, COUNT, SEED]
    table = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=True).stdout
    print(table)
    outcomes = [line.split()[0] for line in table.splitlines() if line.startswith(("killed", "SURVIVES"))]
    assert outcomes
    assert outcomes.count("SURVIVES") <= 0.05 * len(outcomes), table


@pytest.mark.long
def test_every_equivalent_mutation_is_one():
    every = {file: {m.after for m in mutants.mutations(mutants.ROOT / file)} for file, _ in mutants.EQUIVALENT}
    assert [(file, after) for file, after in mutants.EQUIVALENT if after not in every[file]] == []


def test_every_mutated_module_has_tests():
    for room in mutants.ROOMS:
        for path in mutants.modules(room):
            file = path.relative_to(mutants.ROOT).as_posix()
            tests = mutants.nearest_tests(file)
            assert all((mutants.ROOT / test).exists() for test in tests), file
            assert tests or not list(mutants.mutations(path)), file
