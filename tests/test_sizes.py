"""Files, functions and classes stay of a size and a shape that a person can take in, and imports form no cycle.

An exception is named with its reason. What is counted of a function: signature and docstring, too.
"""

import ast
import statistics
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "pacnerf_lpo"
FILE, FUNCTION, ARGUMENTS = 500, 60, 8
TYPICAL_FILE, TYPICAL_FUNCTION = 150, 30
"""Lines of the median file, and of a function of which nine in ten are no longer."""
COMMAND = "the options of a command, most of it their signature and help"
LONG = {
    "commands/benchmark.py:run": COMMAND,
    "commands/diagnose.py:run": COMMAND,
    "commands/init.py:run": COMMAND,
}
CONFIGURED = "keys of a section of the configuration, each set by name in YAML"
KERNEL = "arrays of a kernel, which Taichi takes one by one"
MANY_ARGUMENTS = {
    "commands/benchmark.py:run": COMMAND,
    "commands/diagnose.py:run": COMMAND,
    "commands/init.py:run": COMMAND,
    "commands/synthesize.py:run": COMMAND,
    "data/video_data.py:VideoData.__init__": CONFIGURED,
    "mpm/physics.py:Physics.__init__": CONFIGURED,
    "outer_loop.py:OuterLoop.__init__": CONFIGURED,
    "phases/static_grid.py:StaticGridModule.__init__": CONFIGURED,
    "mpm/simulator.py:Simulator.__init__": "settings of the public engine, each given by its name",
    "mpm/kernels.py:passes": KERNEL,
}
LIGHTNING = ("on_", "training_step", "configure_optimizers", "setup", "train_dataloader", "log_metrics", "forward")
"""What its callers, Lightning and torch, ask a class to override begins so."""


@cache
def trees() -> dict[str, ast.Module]:
    """Every file of the package, by its path in it."""
    return {path.relative_to(PACKAGE).as_posix(): ast.parse(path.read_text()) for path in PACKAGE.rglob("*.py")}


def functions(tree: ast.AST, within: str = "") -> Iterator[tuple[str, ast.FunctionDef]]:
    """Functions with their names, those of a class as ``Class.method``."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.ClassDef):
            yield from functions(node, f"{node.name}.")
        elif isinstance(node, ast.FunctionDef):
            yield within + node.name, node
            yield from functions(node)
        else:
            yield from functions(node, within)


def lines(node: ast.FunctionDef) -> int:
    assert node.end_lineno is not None
    return node.end_lineno - node.lineno + 1


def arguments(node: ast.FunctionDef) -> int:
    every = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    return sum(one.arg not in ("self", "cls") for one in every)


def every_function() -> Iterator[tuple[str, ast.FunctionDef]]:
    for path, tree in trees().items():
        for name, node in functions(tree):
            yield f"{path}:{name}", node


def test_files_are_short():
    counts = {path.relative_to(PACKAGE): len(path.read_text().splitlines()) for path in PACKAGE.rglob("*.py")}
    assert {path: count for path, count in counts.items() if count > FILE} == {}
    assert statistics.median(counts.values()) <= TYPICAL_FILE


def test_functions_are_short():
    sizes = {name: lines(node) for name, node in every_function()}
    long = {name for name, size in sizes.items() if size > FUNCTION}
    assert long - set(LONG) == set()
    assert set(LONG) - long == set(), "exceptions that are none any more"
    assert sorted(sizes.values())[int(0.9 * len(sizes))] <= TYPICAL_FUNCTION


def test_functions_have_few_arguments():
    many = {name for name, node in every_function() if arguments(node) > ARGUMENTS}
    assert many - set(MANY_ARGUMENTS) == set()
    assert set(MANY_ARGUMENTS) - many == set(), "exceptions that are none any more"


def statements(node: ast.FunctionDef) -> list[ast.stmt]:
    """Of the body, without its docstring."""
    return [one for one in node.body if not (isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant))]


def test_classes_are_abstract_or_final():
    """What a subclass overrides is abstract, or a hook: a method that only returns a default."""
    classes = {
        node.name: node for tree in trees().values() for node in ast.walk(tree) if isinstance(node, ast.ClassDef)
    }
    bases = {name: [b.id for b in node.bases if isinstance(b, ast.Name)] for name, node in classes.items()}
    methods = {name: {n: f for n, f in functions(node) if "." not in n} for name, node in classes.items()}

    def ancestors(name: str) -> Iterator[str]:
        for base in bases.get(name, ()):
            if base in classes:
                yield base
                yield from ancestors(base)

    overridden = []
    for name, own in methods.items():
        for method in own:
            if method == "__init__" or method.startswith(LIGHTNING):
                continue
            above = next((methods[base][method] for base in ancestors(name) if method in methods[base]), None)
            if above is None or any("abstractmethod" in ast.unparse(one) for one in above.decorator_list):
                continue
            body = statements(above)
            if len(body) > 1 or (body and not isinstance(body[0], (ast.Return, ast.Pass))):
                overridden.append(f"{name}.{method}")
    assert overridden == []


def test_imports_form_no_cycle():
    """Of modules, at import: what is imported for types alone, or inside a function, does not count."""
    modules = {path.removesuffix(".py").removesuffix("/__init__").replace("/", "."): path for path in trees()}
    graph: dict[str, set[str]] = {}
    for module, path in modules.items():
        found = set()
        for node in trees()[path].body:
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("pacnerf_lpo"):
                home = (node.module or "").removeprefix("pacnerf_lpo").removeprefix(".")
                for one in node.names:
                    inner = f"{home}.{one.name}".removeprefix(".")
                    found.add(inner if inner in modules else home)
        graph[module] = (found & set(modules)) - {module}
    order: list[str] = []
    while ready := [module for module in graph if module not in order and graph[module] <= set(order)]:
        order += ready
    assert sorted(set(graph) - set(order)) == []
