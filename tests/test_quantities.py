"""Values as YAML and a person read them."""

import pytest
import yaml

from pacnerf_lpo.quantities import yaml_list, yaml_number


@pytest.mark.parametrize("value", [1e-5, -2.5e-7, 3e20, 0.25, 12.0])
def test_a_number_is_read_as_a_number(value):
    assert yaml.safe_load(yaml_number(value)) == pytest.approx(value)
    assert yaml.safe_load(yaml_list([0.0, value], digits=4)) == [0.0, pytest.approx(value)]
