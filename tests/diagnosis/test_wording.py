from __future__ import annotations

import pytest
from pacnerf_lpo.diagnosis.statistics.residual_force import Law, Term

from pacnerf_lpo.diagnosis import wording

DRAG = Term("velocity", -1.5, "1/s", -1.7, -1.3, 1.0, 0.9)


@pytest.mark.parametrize(
    ("law", "sentence"),
    [
        (Law([DRAG], 0.8), "It looks like -1.5 1/s times (velocity), which explains 80% of it."),
        (Law([DRAG], 0.1), "No simple law describes that force; the nearest, -1.5 1/s times (velocity), explains 10%"),
        (Law([], 0.0), "No simple law describes that force: it follows neither place nor velocity."),
    ],
)
def test_a_force_is_said_to_look_like_a_law_only_where_that_explains_it(law: Law, sentence: str):
    found = wording.force(0.52, 0.4, law)
    assert found[0] == "A smooth force on the body would remove 52% of what is left, and 40% in the views kept aside."
    assert "nothing in the views kept aside" in wording.force(0.52, -0.1, law)[0]
    assert found[1].startswith(sentence)


def test_what_remains_is_told_as_a_length_not_as_a_square():
    said = wording.nearest(["UniformForce"], 0.88, wording.times(12.25))
    assert said.startswith(
        "Nearest comes uniform force, which removes 88% of the held-out error; what remains is 3.5 times"
    )
    said = wording.nearest(["UniformForce", "InitialSpin"], 0.3, wording.MORE_THAN_HALF)
    assert said.startswith("Nearest come uniform force and initial spin, which together remove 30%")
