"""One module per command; the arguments and the docstring of its function ``run`` are the command line and its help."""

from collections.abc import Callable, Sequence


def call(run: Callable[..., None], name: str, words: Sequence[str]) -> int:
    """Call ``run``, a typed function with a Google docstring, with the words that follow the name of a command; returns
    the exit status. Its argument ``run_dir`` may be given as the scene. Raises UserInputError where words do not fit.
    """
    from inspect import getdoc

    from jsonargparse import ArgumentError, ArgumentParser

    from pacnerf_lpo.config_errors import HelpFormatter, cause_of, explain
    from pacnerf_lpo.scene_folder import run_directory

    description = (getdoc(run) or "").split("\n\nArgs:")[0]
    parser = ArgumentParser(prog=name, description=description, formatter_class=HelpFormatter, exit_on_error=False)
    parser.add_function_arguments(run, as_positional=True)
    try:
        config = parser.parse_args(_spelled_out(run, words))
    except ArgumentError as error:
        raise explain(error, parser, []) from error
    try:
        values = vars(parser.instantiate(config))
    except ValueError as error:  # a wrong value inside an object is the user's mistake, whatever wraps it
        raise cause_of(error) from None
    if "run_dir" in values:
        values["run_dir"] = run_directory(values["run_dir"])
    run(**values)
    return 0


def _spelled_out(run: Callable[..., None], words: Sequence[str]) -> list[str]:
    """Options as the parser wants them: ``--data-root`` is ``--data_root``, a switch is true, a list may be words."""
    from inspect import signature

    kinds = {name: one.annotation for name, one in signature(run).parameters.items()}
    kinds = {name: kind.__name__ if type(kind) is type else str(kind) for name, kind in kinds.items()}
    options: list[list[str]] = [[]]
    for word in words:
        name, equals, value = word.removeprefix("--").partition("=")
        if word.startswith("--"):
            options.append(["--" + name.replace("-", "_"), *([value] if equals else [])])
        else:
            options[-1].append(word)
    result = options[0]
    if result and next(iter(kinds.values()), "").startswith("list[str]"):
        result = [str(result)]
    for option, *values in options[1:]:
        kind = kinds.get(option.removeprefix("--"), "")
        if kind == "bool" and not values:
            values = ["true"]
        if kind.startswith(("list[str]", "list[float]")) and values and not values[0].startswith("["):
            values = [str(values) if kind.startswith("list[str]") else f"[{', '.join(values)}]"]
        if len(values) == 1 and values[0].startswith("-"):  # a value, such as a negative number or an axis -z
            option, values = f"{option}={values[0]}", []
        result += [option, *values]
    return result
