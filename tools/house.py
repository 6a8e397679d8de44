"""The house in figures: what a machine can count of "one concept, one home", each beside its limit and its aim.

`python tools/house.py` prints them, and fails where a figure is beyond its limit, with the places; `--list` gives all
places. `--walk talk.wav --subject calm --results results` counts what one run of `cospeech generate` calls.
"""

import argparse
import ast
import re
import sys
from collections import defaultdict
from itertools import combinations
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

# The rooms of src/cospeech from the ground up: a module imports from its own room and from those before it.
ORDER = [
    *("errors", "files", "skeleton", "rotation", "body", "clip", "track"),
    *("face", "speech", "formats", "capture"),
    *("learning", "split"),
    *("posenet", "people", "gestures", "matching", "synthesis"),
    *("evaluation", "render", "study", "demo", "commands", "cli"),
]
# Rooms that do not know each other.
STRANGERS = [{room, other} for room in ("posenet", "people") for other in ("gestures", "matching")]

# Figure: (limit, aim). None may grow beyond its limit; who makes one smaller lowers its limit, until it is the aim.
LIMITS = {
    "files that name velocity_gan": (4, 3),  # a model's name stands in the registry, and in what is generated from it
    "csv.writer": (1, 1),  # one table writer
    "ddof": (1, 1),  # one deviation over seeds
    "constants stated twice": (20, 0),
    "import circles": (0, 0),  # groups of modules, not of lines
    "arrows upward": (0, 0),
    "top-level modules": (9, 9),
    "folders of more than 14 modules": (0, 0),
    "names of modules that occur twice": (0, 0),
    "functions of more than 8 arguments": (26, 0),
    "functions of more than 60 lines": (2, 0),
    "files of more than 300 lines": (19, 0),
    "scripts of more than 40 lines": (0, 0),
    "fmt: skip": (1, 0),  # formatter configured, not switched off
    "noqa: E731": (0, 0),
    "lines in src": (33350, 28070),  # 5 % fewer than before
}
METHODS = [("gestures/chapter4", "gestures/ha2g")]  # siblings: their modules may be called alike
# Names whose likeness is no common fact: what fits into memory, the keys and version of one's own file, ...
GENERIC = {"AT_ONCE", "BATCH", "BLOCK", "CHUNK", "FLOOR", "JOINTS", "KEYS", "SCHEMA", "VERSION"}


def read(root):
    """{path below root: text} of all files of this project's own code."""
    folders = ("src", "workflow", "config", "tools", "benchmarks", "tests")
    found = [f for folder in folders for f in (root / folder).rglob("*") if f.suffix in (".py", ".smk", ".yaml")]
    own = [f for f in sorted(found) if "node_modules" not in f.parts and not f.is_symlink()]
    return {f.relative_to(root).as_posix(): f.read_text("utf-8") for f in own}


def figures(root=ROOT):
    """{name of a figure: the places that it counts}, named as in LIMITS."""
    texts = read(root)
    code = {path: text for path, text in texts.items() if not path.endswith(".yaml")}
    shipped = {path: text for path, text in texts.items() if path.startswith(("src/", "workflow/", "config/"))}
    trees = {path: ast.parse(text) for path, text in shipped.items() if path.endswith(".py")}
    modules = {path.removeprefix("src/cospeech/"): tree for path, tree in trees.items() if path.startswith("src/")}
    arrows = {module: set(imported(tree, modules)) for module, tree in modules.items()}
    functions = [(path, f) for path, tree in trees.items() for f in ast.walk(tree) if isinstance(f, FUNCTION)]
    scripts = {path: text for path, text in code.items() if path.startswith("workflow/scripts/")}
    name = re.compile(r"\bvelocity_gan\b")
    return {
        "files that name velocity_gan": [path for path, text in shipped.items() if name.search(text)],
        "csv.writer": lines_with("csv.writer", shipped),
        "ddof": lines_with("ddof", shipped),
        "constants stated twice": stated_twice(trees),
        "import circles": [" <-> ".join(circle) for circle in circles(arrows)],
        "arrows upward": upward(arrows),
        "top-level modules": [module for module in modules if "/" not in module and module != "__init__.py"],
        "folders of more than 14 modules": crowded(modules),
        "names of modules that occur twice": called_alike(modules),
        "functions of more than 8 arguments": [at(path, f) for path, f in functions if arguments(f) > 8],
        "functions of more than 60 lines": [at(path, f) for path, f in functions if f.end_lineno - f.lineno >= 60],
        "files of more than 300 lines": longer(300, code),
        "scripts of more than 40 lines": longer(40, scripts),
        "fmt: skip": lines_with("# fmt: skip", code),
        "noqa: E731": lines_with("# noqa: E731", code),
        "lines in src": [line for path in modules for line in shipped[f"src/cospeech/{path}"].splitlines()],
    }


FUNCTION = (ast.FunctionDef, ast.AsyncFunctionDef)


def at(path, node):
    """Where a function stands."""
    return f"{path}:{node.lineno} {node.name}"


def arguments(function):
    """How many arguments a function takes, itself (self, cls) not counted."""
    names = [a.arg for a in function.args.posonlyargs + function.args.args + function.args.kwonlyargs]
    return len(names) - (names[:1] in (["self"], ["cls"]))


def lines_with(word, texts):
    """The lines that hold a word."""
    own = "tools/house.py"  # it names what it counts
    numbered = ((p, i, line) for p, text in texts.items() if p != own for i, line in enumerate(text.splitlines(), 1))
    return [f"{path}:{number}" for path, number, line in numbered if word in line]


def longer(most, texts):
    """The files of more than so many lines."""
    return [f"{path} ({len(text.splitlines())})" for path, text in texts.items() if len(text.splitlines()) > most]


def imported(tree, modules):
    """The modules of the library that one module imports, at its top or inside functions."""
    for node in ast.walk(tree):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        for name in names:
            first, *below = name.split(".")
            if first == "cospeech":
                tails = ("/".join(below[:depth]) for depth in range(len(below), 0, -1))  # a module, or a name in one
                candidates = (file for tail in tails for file in (f"{tail}.py", f"{tail}/__init__.py"))
                yield from [file for file in candidates if file in modules][:1]


def room(module):
    """The folder or file right below src/cospeech that a module lies in."""
    return module.split("/")[0].removesuffix(".py")


def upward(arrows):
    """Imports from a room that stands above one's own, or from a room that this one shall not know."""
    height = {name: number for number, name in enumerate(ORDER)}  # what has no place there stands above all others

    def above(its, mine):
        return its != mine and height.get(its, len(ORDER)) > height.get(mine, -1)

    pairs = [(module, other) for module, others in arrows.items() for other in sorted(others)]
    rooms = [(module, other, room(module), room(other)) for module, other in pairs]
    return [f"{m} -> {o}" for m, o, mine, its in rooms if above(its, mine) or {mine, its} in STRANGERS]


def circles(arrows):
    """Groups of modules, each of which reaches all others of its group by imports."""

    def reach(start):
        seen, queue = set(), [start]
        while queue:
            new = arrows.get(queue.pop(), set()) - seen
            seen |= new
            queue += new
        return seen

    reached = {module: reach(module) for module in arrows}
    groups = {tuple(sorted(o for o in reached[m] if m in reached[o])) for m in arrows if m in reached[m]}
    return sorted(groups)


def constants(tree):
    """[(name, value as source text, line)] of the capital names that a module assigns, element by element."""
    for node in tree.body:
        if not isinstance(node, (ast.Assign, ast.AnnAssign)):
            continue
        for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
            pairs = [(target, node.value)]
            if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                pairs = zip(target.elts, node.value.elts, strict=False)
            for name, value in pairs:
                if isinstance(name, ast.Name) and name.id.isupper() and value is not None:
                    yield name.id, value, node.lineno


def stated_twice(modules):
    """Groups of constants that state one fact: one name with one value or three common words, or one list of words."""
    alike = defaultdict(set)  # {what is the same: its places}
    for module, tree in modules.items():
        for name, value, line in constants(tree):
            leaves = [node.value for node in ast.walk(value) if isinstance(node, ast.Constant)]
            words = {leaf.lower() for leaf in leaves if isinstance(leaf, str)}
            facts = [f"{name} = {ast.unparse(value)}"] + [(name, *three) for three in combinations(sorted(words), 3)]
            if isinstance(value, (ast.Tuple, ast.List, ast.Set)) and len(words) == len(value.elts) > 2:
                facts.append(frozenset(words))
            for fact in facts if name not in GENERIC else ():
                alike[fact].add((module, f"{module}:{line} {name}"))
    neighbours = defaultdict(set)
    for places in alike.values():
        if len({module for module, _ in places}) > 1:
            for place in places:
                neighbours[place] |= places
    return [", ".join(place for _, place in group) for group in circles(neighbours)]


def crowded(modules):
    """Folders with more than 14 modules of their own, __init__ not counted."""
    folders = defaultdict(int)
    for module in modules:
        folders[Path(module).parent.as_posix()] += not module.endswith("__init__.py")
    return [f"{folder} ({count})" for folder, count in folders.items() if count > 14 and folder != "."]


def called_alike(modules):
    """Names of modules that occur twice, but for those of sibling methods."""
    homes = defaultdict(list)
    for module in modules:
        folder = Path(module).parent.as_posix()
        siblings = next((method for method in METHODS if folder in method), (folder,))
        homes[Path(module).name].append((siblings[0], module))
    del homes["__init__.py"]
    return [", ".join(m for _, m in found) for found in homes.values() if len({home for home, _ in found}) > 1]


def report(counted, everything=False, out=sys.stdout):
    """Print all figures, the places of those that grew, and three lines of summary; returns the exit status."""
    grown = [name for name, (limit, _) in LIMITS.items() if len(counted[name]) > limit]
    loose = [name for name, (limit, _) in LIMITS.items() if len(counted[name]) < limit]
    print(f"{'now':>6} {'limit':>6} {'aim':>6}", file=out)
    for name, (limit, aim) in LIMITS.items():
        now = len(counted[name])
        print(f"{now:6} {limit:6} {aim:6}  {name}{'  TOO MANY' if name in grown else ''}", file=out)
        if name != "lines in src" and (everything or name in grown):
            print(*(f"{'':24}{place}" for place in counted[name]), sep="\n", file=out)
    reached = [name for name, (_, aim) in LIMITS.items() if len(counted[name]) <= aim]
    print(f"aims reached: {len(reached)} of {len(LIMITS)}", file=out)
    print(f"limits in tools/house.py to lower: {', '.join(loose) or 'none'}", file=out)
    print(f"grown beyond their limit: {', '.join(grown) or 'none'}", file=out)
    return 1 if grown else 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--list", action="store_true", help="say where each figure counts")
    parser.add_argument("--walk", metavar="AUDIO", help="count what `cospeech generate` calls for this sound")
    parser.add_argument("--subject", default="calm")
    parser.add_argument("--model", default="resync")
    parser.add_argument("--results", default="results")
    options = parser.parse_args()
    if options.walk:
        from walk import walk

        return walk(options.walk, options.subject, options.model, options.results)
    return report(figures(), options.list)


if __name__ == "__main__":
    sys.exit(main())
