"""Which library code a script runs, as one number, so that a rule is rerun when that code is edited.

Snakemake watches a rule's script but not the package that it imports.
"""

import ast
import hashlib
from functools import cache
from pathlib import Path

import cospeech

SCRIPTS = Path(__file__).parent / "scripts"


def library_code(script):
    """Digest of all the code of this project that a script runs, and of the data that lies with it.

    The same wherever the project and the library lie: a copy of the project does not rerun what was made elsewhere.
    """
    digest = hashlib.sha256()
    for file in library_files(script):
        digest.update(f"{_name(file)}\0".encode() + file.read_bytes())
    return digest.hexdigest()[:16]


def library_files(script):
    """The project's modules that a script imports, directly or through others, and the data files of their packages.

    Imports inside functions count. A data file belongs to the innermost package that it lies in.
    """
    root = Path(cospeech.__file__).parent
    modules, queue = set(), [SCRIPTS / script]
    while queue:
        found = {file for name in _imports(queue.pop()) for file in _files(name, root)}
        queue += found - modules
        modules |= found
    folders = {module.parent for module in modules}
    return sorted(modules | {file for file, home in _data(root) if home in folders}, key=_name)


def _name(file):
    """A file's path below the folder that holds the package, or below workflow/."""
    package = Path(cospeech.__file__).parent
    return file.relative_to(package.parent if package in file.parents else SCRIPTS.parent).as_posix()


@cache
def _imports(file):
    """Dotted names of the modules that one file imports, and of what it imports from them."""
    names = set()
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


def _files(name, root):
    """The project's files that importing a dotted name runs: packages' __init__.py and the module, if it is one."""
    first, *below = name.split(".")
    if first != root.name:
        return {file for file in [SCRIPTS / f"{first}.py"] if file.is_file()}
    folders = [root.joinpath(*below[:depth]) for depth in range(len(below) + 1)]
    candidates = [folder / "__init__.py" for folder in folders] + [folders[-1].with_suffix(".py")]
    return {file for file in candidates if file.is_file()}


@cache
def _data(root):
    """[(data file, innermost package folder around it)] of the package."""
    files = [f for f in sorted(root.rglob("*")) if f.is_file() and f.suffix != ".py" and "__pycache__" not in f.parts]
    return [(f, next(p for p in f.parents if (p / "__init__.py").is_file())) for f in files]
