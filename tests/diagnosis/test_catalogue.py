"""Which effects are tried on which model, and how a list of candidates is read."""

import pytest
import yaml

from pacnerf_lpo.diagnosis.catalogue import Candidate, as_config, read_candidates, whole_catalogue
from pacnerf_lpo.errors import UserInputError
from pacnerf_lpo.identification.study import divide
from pacnerf_lpo.mpm.effects import Effect, GroundFriction, LinearDrag, Magnus, QuadraticDrag
from pacnerf_lpo.mpm.materials import DruckerPrager, NeoHookean
from pacnerf_lpo.render.camera_faults import (
    CameraShift,
)


def names(material, views=(3, 7), installed=()):
    return [candidate.name for candidate in whole_catalogue(material, views, installed)]


def test_camera_faults_are_tried_view_by_view():
    found = names(NeoHookean())
    assert {"CameraShift@3", "CameraShift@7", "LinearDrag"} <= set(found)
    assert "CameraShift" not in found


def test_effects_without_meaning_for_a_material_are_left_out():
    assert "Cohesion" not in names(NeoHookean())
    assert "Cohesion" in names(DruckerPrager())


def test_what_the_model_has_is_not_tried_again_and_one_ground_is_enough():
    found = names(NeoHookean(), installed=[LinearDrag(0.5), GroundFriction(0.2)])
    assert not {"LinearDrag", "GroundFriction", "Adhesion"} & set(found)
    assert "QuadraticDrag" in found


def test_alternatives_of_kind_and_joint_components_are_known():
    found = {candidate.name: candidate for candidate in whole_catalogue(NeoHookean(), (0,), ())}
    assert [found[name].discrete for name in ("GroundFriction", "YieldStress", "LinearDrag")] == [True, True, False]
    push = found["UniformForce"]
    assert push.joint and len(push.trials()) == 2
    assert all(sum(value != 0 for value in trial.values()) == 1 for trial in push.trials())
    own = Candidate("Magnus", divide(Magnus(), ("a", "b")))  # each throw has its own coefficient, tried at all sizes
    assert own.components == 2
    assert [tuple(trial.values()) for trial in own.trials()] == [(0.002, 0), (0, 0.002), (0.02, 0), (0, 0.02)]


def test_a_list_of_candidates_is_read_and_written(tmp_path):
    entries = [as_config(LinearDrag(), {"drag": 0.5}), as_config(CameraShift(view=3), CameraShift(view=3).null)]
    path = tmp_path / "candidates.yaml"
    path.write_text(yaml.safe_dump(entries))
    found = read_candidates(path, NeoHookean(), [])
    assert [candidate.name for candidate in found] == ["LinearDrag", "CameraShift@3"]
    assert found[0].effect.guess == {"drag": 0.5}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("- class_path: Magnus\n- class_path: LinearDragg\n", ", line 2: effects: there is no LinearDragg; a class of"),
        ("- class_path: LinearDragg\n", "did you mean LinearDrag?"),
        ("- class_path: LinearDrag\n  init_args: {drga: 1}\n", ", line 2: unknown key effects.init_args.drga; did you"),
        ("- class_pth: LinearDrag\n", ", line 1: unknown key effects.class_pth; did you mean effects.class_path?"),
        (
            "- class_path: LinearDrag\n  init_arg: {drag: 1}\n",
            "unknown key effects.init_arg; did you mean effects.init_args?",
        ),
        (
            "- class_path: tests.diagnosis.test_catalogue.LinearDarg\n",
            "has no attribute 'LinearDarg'; see its file; did you mean LinearDrag?",
        ),
        ("- class_path: LinearDrag\n  init_args: {drag: fast}\n", ", line 2: effects.drag: expected float, got fast"),
        ("- class_path: LinearDrag\n  init_args: {drag: -1e9}\n", ": LinearDrag: drag = -1e+09 1/s is not a possible"),
        ("{", ", line 1: not valid YAML"),
        ("", ": not a list of effects; write for each of them a line `- class_path: NAME`"),
        ("candidates: []\n", ": not a list of effects"),
        ("- class_path: Cohesion\n", "Cohesion"),
        (
            "- class_path: LinearDrag\n- class_path: LinearDrag\n  init_args: {drag: 1}\n",
            "LinearDrag is listed 2 times; results are told by the name of a class, so write one for each, such as "
            "`class Other(LinearDrag)` with other defaults",
        ),
    ],
)
def test_a_wrong_list_is_one_clear_line(tmp_path, content, said):
    path = tmp_path / "candidates.yaml"
    path.write_text(content)
    with pytest.raises(UserInputError) as refused:
        read_candidates(path, NeoHookean(), [])
    message = str(refused.value)
    assert said in message and "\n" not in message and "Parser" not in message
    assert message.startswith(str(path)) or "Cohesion" in said


def test_a_missing_list_is_named(tmp_path):
    with pytest.raises(UserInputError, match=r"nothing\.yaml: no such file"):
        read_candidates(tmp_path / "nothing.yaml", NeoHookean(), [QuadraticDrag()])


class Later(LinearDrag):
    """With a number that is given and not fitted, and not kept as an attribute."""

    def __init__(self, drag: float = 0.0, onset: float = 0.1):
        Effect.__init__(self, {"drag": drag}, {"onset": onset})


def test_a_given_number_is_written_with_the_coefficients():
    assert as_config(Later(onset=0.3), {"drag": 0.5})["init_args"] == {"drag": 0.5, "onset": 0.3}


class MuchLater(Later):
    """Another value of it."""

    def __init__(self, drag: float = 0.0, onset: float = 0.4):
        super().__init__(drag, onset)


def test_a_class_with_another_given_number_competes_beside_the_first(tmp_path):
    path = tmp_path / "candidates.yaml"
    path.write_text(
        "".join(f"- class_path: tests.diagnosis.test_catalogue.{name}\n" for name in ("Later", "MuchLater"))
    )
    found = {one.name: one.effect.constants for one in read_candidates(path, NeoHookean(), [])}
    assert found == {"Later": {"onset": 0.1}, "MuchLater": {"onset": 0.4}}
