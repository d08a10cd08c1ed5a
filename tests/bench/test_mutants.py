"""The lines that `bench.mutants` breaks are there, and so are the tests that should notice."""

from pathlib import Path

from bench.mutants.catalogue import MUTANTS

ROOT = Path(__file__).parents[2]


def test_lines_and_tests_are_there():
    gone = [
        mutant.name
        for mutant in MUTANTS
        if (ROOT / mutant.path).read_text(encoding="utf-8").count(mutant.before) != 1
        or mutant.before == mutant.after
        or not (ROOT / mutant.tests).is_file()
    ]
    assert len(MUTANTS) >= 30
    assert len(gone) <= 3, gone
