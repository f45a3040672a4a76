"""What pyproject.toml cannot say: the folder ``configs`` beside the package is installed inside it."""

from setuptools import find_packages, setup

setup(
    packages=[*find_packages(include=["pacnerf_lpo*"]), "pacnerf_lpo.configs"],
    package_dir={"pacnerf_lpo.configs": "configs"},
)
