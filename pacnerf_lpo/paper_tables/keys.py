"""The key of a result: a hash of the resolved configuration, of the data it uses, and of the package's version."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any

import yaml

from pacnerf_lpo import __version__
from pacnerf_lpo.cli import PhaseCLI, quieten_lightning
from pacnerf_lpo.data.digest import data_digest
from pacnerf_lpo.data.video_module import VideoData
from pacnerf_lpo.mpm.physics import Physics

SECTIONS_OF_THE_BEGINNING = ("seed_everything", "data", "physics", "phases", "trainer")


class ConfigReader:
    """Resolves command lines of ``fit`` to complete configurations; the parser is made once."""

    def __init__(self) -> None:
        self._cli: PhaseCLI | None = None

    def read(self, words: Sequence[str]) -> dict[str, Any]:
        """Every value of the configuration that options of ``fit`` give, those that nobody set included. Raises
        UserInputError where they do not fit.
        """
        words = list(words)
        if self._cli is None:
            quieten_lightning()
            self._cli = PhaseCLI(words, VideoData, Physics)
        else:
            self._cli.parse_arguments(self._cli.parser, words)
        return yaml.safe_load(self._cli.dump())


def run_key(config: Mapping[str, Any]) -> str:
    """The key of the results of a run with a resolved configuration.

    The rounds are left out, because the results after every round are kept; so are the places of run, data and truth.
    """
    kept = deepcopy(dict(config))
    kept.pop("truth")
    for name in ("run_dir", "rounds"):
        kept["outer_loop"].pop(name)
    return _key(kept)


def beginning_key(config: Mapping[str, Any]) -> str:
    """The key of static grids, velocity and first identification: whatever comes after them is left out.

    It is the key of a run that goes no further, and says which runs can start from it.
    """
    kept = {name: deepcopy(config[name]) for name in SECTIONS_OF_THE_BEGINNING}
    kept["phases"].pop("correction", None)
    return _key(kept)


def _key(config: dict[str, Any]) -> str:
    config["data"]["root"] = data_digest(config["data"])
    content = json.dumps([__version__, config], sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()[:16]
