"""Every page of results is made of its JSON, which says when, with which commit and where it was measured."""

import pytest

from validation import pages
from validation.record import RESULTS, made, read


def test_every_file_of_results_has_a_subject():
    found = {path.stem for path in RESULTS.iterdir()}
    assert found == set(pages.measured())
    assert all((RESULTS / f"{subject}.md").is_file() for subject in found)


@pytest.mark.parametrize("subject", pages.measured())
def test_a_page_is_what_its_command_makes(subject: str):
    assert (RESULTS / f"{subject}.md").read_text() == pages.page(subject)


@pytest.mark.parametrize("subject", pages.measured())
def test_a_record_says_when_and_where_it_was_made(subject: str):
    record = read(subject)
    assert all(record[name] for name in ("date", "commit", "machine"))
    assert all(record[name] in pages.page(subject) for name in ("date", "commit", "machine"))


def test_a_measurement_that_begins_now_says_so():
    assert set(made()) == {"date", "commit", "machine"} and all(made().values())
