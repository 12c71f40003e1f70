"""The ledger of claims: each row has evidence that exists, and what is called validated has a witness outside."""

from pathlib import Path

import pytest

from heli_twin.cli import main
from heli_twin.credibility import Ledger, read_ledger
from heli_twin.credibility.ledger import FACTORS, LEDGER, STATUSES, not_found
from heli_twin.credibility.page import credibility_page, summary
from heli_twin.errors import HeliTwinError

ROOT = Path(__file__).parents[2]


def changed(tmp_path: Path, old: str, new: str) -> Path:
    text = LEDGER.read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "ledger.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return path


def test_all_evidence_exists_and_asks_its_witness() -> None:
    assert not_found(read_ledger(), ROOT) == []


def test_what_is_not_validated_says_so() -> None:
    statuses = [claim.status for claim in read_ledger().claims]
    assert set(statuses) == set(STATUSES)
    assert all(claim.missing for claim in read_ledger().claims if claim.status == "not validated")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "::test_daqp_agrees_with_every_answer",
            "::test_gone",
            "tests/controllers/test_proxqp.py has no test 'test_gone'",
        ),
        ("tests/controllers/test_proxqp.py", "tests/gone.py", "there is no file tests/gone.py"),
        ("study:seeds", "study:gone", "no study 'gone' is shipped"),
        ("command:paper", "command:gone", "there is no command 'gone'"),
        ("log:tests/experiment/past/physics3.mcap", "log:gone.mcap", "there is no file gone.mcap"),
        ("study:seeds", "word of mouth", "'word of mouth' is no evidence: begin it with one of test:, proof:"),
        ('mark = "daqp"', 'mark = "qpoases"', "no evidence mentions qpoases, the mark of its witness"),
        ("proof:tests/studies/test_rare", "test:tests/studies/test_rare", "is a proof: write proof:"),
    ],
)
def test_evidence_that_does_not_exist_is_told(old: str, new: str, words: str, tmp_path: Path) -> None:
    (trouble,) = {t.partition("': ")[2] for t in not_found(read_ledger(changed(tmp_path, old, new)), ROOT)}
    assert words in trouble


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('witness = "daqp"', "", "is called validated without a witness outside this code: name one of paper, daqp"),
        ('status = "verified"', 'status = "validated"', "is called validated without a witness outside this code"),
        ('status = "verified"', 'status = "certain"', "has status 'certain': write one of validated, verified"),
        ('evidence = ["study:seeds", "command:paper"]', "", "has no evidence: name what shows it"),
        ('missing = "The strength', 'nothing = "The strength', "is fitted: say in `missing` what would show it"),
        ("[factors.validation]", "[factors.trust]", "the factor 'validation' of the standard has no row"),
        ("level = 1", "level = 5", "factors.data_pedigree.level = 5: write 0, 1, 2, 3 or 4"),
        (
            'missing = "Measured data',
            'nothing = "Measured data',
            "is at level 1: say in `missing` what the next one needs",
        ),
        ("[[claims]]", "[[claims", "cannot read the ledger"),
        ('claim = "The solver', 'nothing = "The solver', "has no claim: write a text"),
    ],
)
def test_a_row_that_is_not_whole_is_refused_in_one_sentence(old: str, new: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(HeliTwinError) as refusal:
        read_ledger(changed(tmp_path, old, new))
    assert words in str(refusal.value)
    assert len(str(refusal.value)) < 500


def test_all_factors_of_the_standard_are_assessed() -> None:
    assert sorted(factor.name for factor in read_ledger().factors) == sorted(FACTORS)
    assert len(FACTORS) == 11


def test_the_command_prints_it_and_writes_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["credibility"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "not validated" in printed
    assert summary(read_ledger()) in printed
    assert main(["credibility", "--out", str(tmp_path / "page.html")]) == 0
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert page.count("<details>") > 20
    assert "daqp.solve" not in page
    assert "def test_daqp_agrees_with_every_answer" in page
    assert "pytest -m long tests/studies/test_rare_event.py" in page
    assert main(["credibility", "--out", str(tmp_path / "page.txt")]) == 2
    assert "ends in .html" in capsys.readouterr().err


def test_without_the_projects_source_evidence_is_named(tmp_path: Path) -> None:
    ledger: Ledger = read_ledger()
    page = credibility_page(ledger, tmp_path)
    assert "<details>" not in page
    assert all(claim.text.replace("'", "&#x27;") in page for claim in ledger.claims)
