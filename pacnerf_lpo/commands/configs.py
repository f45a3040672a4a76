"""``pacnerf-lpo configs``: the configurations that the package ships."""

from collections.abc import Sequence

from jsonargparse import ArgumentError, ArgumentParser

from pacnerf_lpo.config_errors import HelpFormatter, explain
from pacnerf_lpo.named_configs import config_names, find_config, summary

NAME = "pacnerf-lpo configs"
DESCRIPTION = """List the configurations that --config, --overlay and --candidates know by name, or show one of them.

examples:
  pacnerf-lpo configs
  pacnerf-lpo configs effects
  pacnerf-lpo configs scenes/torus > my_scene.yaml"""


def run(words: Sequence[str]) -> int:
    """Run the command with the words after ``configs``; returns its exit status. Raises UserInputError where there is
    no such configuration, or there are too many words.
    """
    parser = ArgumentParser(prog=NAME, description=DESCRIPTION, formatter_class=HelpFormatter, exit_on_error=False)
    parser.add_argument("name", type=str | None, nargs="?", help="One to print, or a folder of them to list.")
    try:
        name = parser.parse_args(list(words)).name
    except ArgumentError as error:
        raise explain(error, parser, []) from error
    listed = [known for known in config_names() if name is None or known.startswith(f"{name.rstrip('/')}/")]
    if not listed:
        print(find_config(name, NAME).read_text(encoding="utf-8"), end="")
    width = max(map(len, listed), default=0)
    for known in listed:
        print(f"{known:<{width}}  {summary(known)}")
    return 0
