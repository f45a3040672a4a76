"""Which values of a scene file a later configuration changes."""

from __future__ import annotations

from pathlib import Path

import yaml

from pacnerf_lpo.config_layers import scene_changes
from pacnerf_lpo.named_configs import configs_folder

SCENE = {
    "data": {"root": "somewhere"},
    "physics": {"material": {"class_path": "NeoHookean", "init_args": {"E": "1e5"}}, "effects": []},
    "phases": {"static": {"init_args": {"base_spacing": 0.06}}},
}


def written(folder: Path, **contents) -> list[Path]:
    for name, content in contents.items():
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(content))
    return [folder / f"{name}.yaml" for name in contents]


def test_cpu_after_a_scene_says_what_it_changes(tmp_path: Path):
    fit, cpu = (configs_folder() / f"{name}.yaml" for name in ("fit", "cpu"))
    (scene,) = written(tmp_path, scene=SCENE)
    assert scene_changes([fit, cpu, scene]) == []
    assert scene_changes([fit, scene, cpu]) == [
        f"cpu.yaml changes data.image_scale from 1.0 ({scene}) to 0.5",
        f"cpu.yaml changes phases.static.init_args.base_spacing from 0.06 ({scene}) to 0.12",
    ]


def test_another_class_takes_its_arguments_along_and_equal_values_are_none(tmp_path: Path):
    later = {"physics": {"material": {"class_path": "pacnerf_lpo.mpm.materials.VonMises", "init_args": {"E": 3e4}}}}
    equal = {"physics": {"material": {"class_path": "x.NeoHookean", "init_args": {"E": 100000.0}}}}
    added = {"physics": {"effects+": [{"class_path": "LinearDrag"}]}}
    files = written(tmp_path, scene=SCENE, equal=equal, added=added, later=later)
    assert scene_changes(files) == [f"{files[3]} changes physics.material from x.NeoHookean ({files[1]}) to "
                                    "pacnerf_lpo.mpm.materials.VonMises"]  # fmt: skip


def test_the_last_file_that_changed_a_value_is_its_source(tmp_path: Path):
    files = written(
        tmp_path,
        scene=SCENE,
        **{name: {"phases": {"static": {"init_args": {"base_spacing": n}}}} for name, n in (("a", 1), ("b", 2))},
    )
    assert (
        scene_changes(files)[1] == f"{files[2]} changes phases.static.init_args.base_spacing from 1 ({files[1]}) to 2"
    )
