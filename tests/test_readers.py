"""Every reader of files that others may have written goes through `sim/model/files.py`."""

import ast
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]
PRODUCT: Final = ("flows", "tasks", "producers", "sim", "oracles", "deployments")
READERS: Final = frozenset(
    {
        *(
            "open",
            "read_text",
            "read_bytes",
            "copyfile",
            "copy",
            "copy2",
            "copytree",
            "ZipFile",
            "ParquetFile",
            "read_table",
        ),
        *("safe_load", "safe_load_all", "load", "loadtxt", "genfromtxt", "fromfile", "memory_map"),
    }
)
"""Names of functions that open a path or decode content without limits."""
BOUND: Final = frozenset({"copy", "load", "open", "read_table"})
"""Names that mean something else as methods of values: they count behind the name of a module or a path alone."""
MODULES: Final = frozenset({"shutil", "json", "np", "pickle", "yaml", "pq", "os", "io", "Image", "tarfile", "gzip"})

ALLOWED: Final[dict[str, tuple[int, str]]] = {
    "flows/cli/benchmark.py": (1, "files of the installation"),
    "flows/cli/init.py": (3, "files of the installation"),
    "flows/export/export.py": (1, "an archive that was opened as a regular file"),
    "flows/export/mcap/bag.py": (3, "a bag that was just written"),
    "flows/failure/report.py": (2, "a film that was just drawn, and a file of the installation"),
    "flows/failure/small_map.py": (1, "a picture that was just written"),
    "flows/publication/bag.py": (2, "an archive that is written, and one that was opened as a regular file"),
    "flows/publication/card.py": (1, "a file of the installation"),
    "flows/results/address.py": (2, "metadata that was just written"),
    "flows/results/kept_report.py": (3, "the user's cache of reports, one of them through the mechanism"),
    "flows/run/reporting.py": (1, "this process' log"),
    "flows/analysis/minimize.py": (1, "a picture that was just drawn"),
    "deployments/explorer/comparison_page.py": (1, "a picture that was just drawn"),
    "deployments/explorer/outputs.py": (1, "a member whose size was looked at"),
    "oracles/page/call.py": (3, "a file of the installation, and a page that was just written"),
    "oracles/page/film.py": (1, "a film that was just drawn"),
    "oracles/page/report.py": (3, "files of the installation"),
    "sim/kernels/numba_target.py": (1, "the user's cache of kernels"),
    "sim/kernels/numeric.py": (2, "files of the installation"),
    "sim/model/files.py": (2, "the mechanism"),
    "sim/model/parquet.py": (4, "the mechanism's part for tables"),
    "sim/model/archive.py": (1, "the mechanism's part for archives"),
    "sim/nav2/parameter_files/built_in.py": (1, "files of the installation"),
    "sim/nav2/parameter_files/declared.py": (1, "files of the installation"),
    "sim/nav2/parameter_files/releases.py": (1, "files of the installation"),
    "sim/plug_ins/snapshot.py": (1, "copies in the user's cache, compared with their digests"),
    "sim/scenario/language/declaring.py": (1, "files of the installation"),
    "sim/scenario/language/grammar.py": (1, "files of the installation"),
    "sim/scenario/programs/cgroup.py": (4, "/sys/fs/cgroup, and an id that Docker wrote"),
    "sim/scenario/programs/containers.py": (1, "/proc"),
    "sim/scenario/programs/folders.py": (2, "copies that were just made, and namespaces in /proc"),
    "sim/nodes/channel.py": (1, "a folder that was just made"),
    "sim/scenario/programs/guard.py": (1, "/proc"),
    "sim/scenario/programs/resources.py": (1, "/proc"),
    "sim/scenario/programs/process.py": (2, "logs that were just opened for writing"),
    "sim/world/map_file.py": (1, "a picture whose bytes the mechanism read"),
    "tasks/engine/child.py": (1, "the empty device"),
    "tasks/engine/dask_client.py": (1, "a stream"),
    "tasks/engine/dask_worker.py": (1, "the parent process"),
    "tasks/keys/code_digest.py": (2, "files of the installation, and the user's cache with its digest"),
    "tasks/keys/source.py": (1, "files of the installation, and copies of plug-ins"),
    "tasks/prefect/api_server.py": (1, "a file of the installation"),
    "tasks/prefect/containers.py": (1, "a scalar of a file within the limits"),
    "tasks/prefect/manifests.py": (2, "files of the installation"),
    "tasks/store/folder_files.py": (1, "the store's own opener: no pipes, no waiting"),
    "tasks/store/remote_files.py": (1, "the user's cache of manifests"),
    "tasks/store/source_files.py": (1, "files of the installation"),
}
"""Modules to how many direct readers they have, and why."""


def test_product_reads_files_of_others_through_one_opener() -> None:
    found = {
        path.relative_to(ROOT).as_posix(): calls
        for folder in PRODUCT
        for path in sorted((ROOT / folder).rglob("*.py"))
        if (calls := direct_readers(path.read_text(encoding="utf-8")))
    }
    assert {module: len(calls) for module, calls in found.items()} == {
        module: count for module, (count, _) in ALLOWED.items()
    }, found


def test_direct_readers_are_found_by_module_path_and_name() -> None:
    text = """
from pathlib import Path
from vastflow.sim.model.files import read_bytes, read_text
content = read_bytes(path), read_text(path), snapshot.load(key), values.copy()
open(path, "wb"), Path(path).open("ab"), os.open(path, os.O_WRONLY | os.O_CREAT)
"""
    assert direct_readers(text) == []
    for call in (
        "open(path)",
        "path.read_bytes()",
        "(a / b).open()",
        "json.load(file)",
        "shutil.copytree(a, b)",
        "pq.read_table(a)",
    ):
        assert direct_readers(text + call) == [call]


def direct_readers(text: str) -> list[str]:
    """Return calls that open a path by themselves, but for writing."""
    calls = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call)]
    return [ast.unparse(call) for call in calls if _reads(call.func) and not _writes(call)]


def _reads(function: ast.expr) -> bool:
    if isinstance(function, ast.Name):  # others are imported from the mechanism, which the import layers hold
        return function.id in {"open", "ZipFile", "ParquetFile", "copyfile", "copytree"}
    if (
        not isinstance(function, ast.Attribute)
        or function.attr not in READERS
        or ast.unparse(function.value) == "files"
    ):
        return False
    owner = function.value
    if function.attr in BOUND:
        is_path = function.attr == "open" and (
            isinstance(owner, ast.BinOp) or ast.unparse(owner).endswith(("path", "Path(path)"))
        )
        return is_path or ast.unparse(owner) in MODULES
    return True


def _writes(call: ast.Call) -> bool:
    given = [*call.args, *(keyword.value for keyword in call.keywords)]
    modes = {str(each.value) for each in given if isinstance(each, ast.Constant)}
    return not modes.isdisjoint(("wb", "ab", "w", "a", "wb+", "xb")) or any(
        "O_WRONLY" in ast.unparse(each) for each in given
    )
