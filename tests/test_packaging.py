"""Packaging: contents of the distribution, its names, and its dependencies."""

import ast
import re
import shutil
import subprocess
import sys
import tomllib
from importlib.metadata import distribution, entry_points, packages_distributions, requires, version
from pathlib import Path

import grimp
import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.version import Version
from table import each_row

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / ".package" / "vastflow"
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
README = (ROOT / "README.md").read_text()
CONSTRAINTS = (ROOT / "deployments" / "constraints.txt").read_text()
DOCKERFILE = (ROOT / "deployments" / "Dockerfile").read_text()
LAYERS = ("deployments", "flows", "oracles", "producers", "sim", "tasks")
LAYOUT = {*LAYERS, "campaigns", "docs", "tests", "pyproject.toml", "README.md"}
MADE_HERE = {"build", "dist", "results"}
"""Folders that building and running leave behind; git ignores them."""


SHIPPED_DATA = ("benchmark", "quickstart", "scenarios")
"""Folders of `campaigns` that are installed: what `vastflow benchmark` and `vastflow init` write, and what the names `builtin:…` stand for."""


def package_folders() -> list[Path]:
    return sorted(init.parent for layer in LAYERS for init in (ROOT / layer).rglob("__init__.py"))


def imported_modules(*folders: str) -> set[str]:
    """First names of everything absolute that the files in `folders` import, wherever in a file they do."""
    names = set()
    for folder in folders:
        for file in (ROOT / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text())):
                if isinstance(node, ast.Import):
                    names |= {alias.name for alias in node.names}
                elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                    names.add(node.module)
    return {name.partition(".")[0] for name in names}


def canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def declared(extra: str = "") -> dict[str, Requirement]:
    project = PYPROJECT["project"]
    found = map(Requirement, project["optional-dependencies"][extra] if extra else project["dependencies"])
    return {canonical(requirement.name): requirement for requirement in found}


def readme_line(start: str, end: str) -> str:
    (line,) = [line for line in README.splitlines() if line.startswith(start) and line.endswith(end)]
    return line


def run(*command, **options):
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=1500, check=False, **options)


def test_distribution_has_every_folder_with_an_init_file():
    # A sub-package that is missing from the list still imports here, but is absent from the wheel.
    folders = ["vastflow." + ".".join(folder.relative_to(ROOT).parts) for folder in package_folders()]
    assert sorted(PYPROJECT["tool"]["setuptools"]["packages"]) == sorted(
        ["vastflow", *folders, *(f"vastflow.campaigns.{name}" for name in SHIPPED_DATA)]
    )


def test_package_links_to_every_folder_of_it():
    links = {path: path.resolve() for path in PACKAGE.rglob("*") if path.is_symlink()}
    folders = {PACKAGE / layer: ROOT / layer for layer in LAYERS}
    assert links == folders | {PACKAGE / "campaigns" / name: ROOT / "campaigns" / name for name in SHIPPED_DATA}
    assert [folder for folder in package_folders() if not (folder / "py.typed").is_file()] == []


def test_editable_install_is_a_folder_on_the_path():
    found = run(sys.executable, "-c", "import vastflow, sys; print(vastflow.__file__); print(*sys.path, sep='\\n')")
    assert found.returncode == 0, found.stderr
    file, *places = found.stdout.splitlines()
    assert Path(file).parents[1].as_posix() in places
    assert Path(file).with_name("py.typed").is_file()


def test_package_exports_api_and_version():
    code = (
        "import vastflow; print(vastflow.__version__, *(getattr(vastflow, name).__name__ for name in vastflow.__all__))"
    )
    version, *names = run(sys.executable, "-c", code).stdout.split()
    assert version == PYPROJECT["project"]["version"]
    assert {"execute", "instantiate", "judge", "observe", "run_campaign"} <= {*names}
    assert distribution("vastflow").version == PYPROJECT["project"]["version"]


def test_importing_package_imports_no_submodules():
    code = "import sys; before = {*sys.modules}; import vastflow; print(*{*sys.modules} - before)"
    found = run(sys.executable, "-c", code).stdout.split()
    assert {name for name in found if name.partition(".")[0] not in sys.stdlib_module_names} == {"vastflow"}


@each_row("folder", LAYERS)
def test_folder_is_imported_only_below_vastflow(folder):
    done = run(sys.executable, "-c", f"import {folder}")  # in the repository's root, where Python would find it
    assert done.returncode == 1
    assert f"ImportError: import vastflow.{folder}, not {folder}: one module has one name" in done.stderr


def test_code_map_names_every_package():
    page = (ROOT / "docs" / "find-your-way-in-the-code.md").read_text()
    named = re.findall(r"^\| `([a-z0-9_/]+)/` \| (.*) \|$", page, re.MULTILINE)
    said = {folder: ast.get_docstring(ast.parse((folder / "__init__.py").read_text())) for folder in package_folders()}
    assert sorted(named) == sorted((str(folder.relative_to(ROOT)), words) for folder, words in said.items())
    files = re.findall(r"`([a-z0-9_/]+\.py)`", page)
    assert files and [file for file in files if not (ROOT / file).is_file()] == []


def test_top_level_holds_nothing_beyond_the_fixed_layout():
    found = {path.name for path in ROOT.iterdir() if not path.name.startswith(".")}
    assert {name for name in found - MADE_HERE if not name.endswith(".egg-info")} == LAYOUT


def test_modules_import_in_no_circle():
    graph = grimp.build_graph("vastflow")
    waiting = {name: set(graph.find_modules_directly_imported_by(name)) for name in graph.modules}
    while free := {name for name, imported in waiting.items() if not imported & waiting.keys()}:
        waiting = {name: imported for name, imported in waiting.items() if name not in free}
    assert sorted(waiting) == []  # those on a circle, and those that lead to one


def test_campaigns_folder_has_only_named_code():
    for file in (ROOT / "campaigns").rglob("*.py"):
        named = [vast for vast in file.parent.glob("*.vast") if file.name in vast.read_text()]
        assert named, f"{file} belongs to no campaign"


@each_row(
    "group", ["console_scripts", "vastflow.producers", "vastflow.oracles", "vastflow.controllers", "vastflow.formats"]
)
def test_entry_points_load(group):
    ours = [entry for entry in entry_points(group=group) if entry.value.startswith("vastflow.")]
    asked = (
        PYPROJECT["project"]["scripts"] if group == "console_scripts" else PYPROJECT["project"]["entry-points"][group]
    )
    assert {entry.name: entry.value for entry in ours} == asked
    for entry in ours:
        assert callable(entry.load())


def needed(*folders: str) -> set[str]:
    """Distributions of everything foreign that the files in `folders` import."""
    providers = packages_distributions()
    # Type checkers alone have `_typeshed`.
    foreign = imported_modules(*folders) - set(sys.stdlib_module_names) - {"vastflow", "_typeshed"}
    # A distribution that is one extension module is not listed before Python 3.12; manifold3d has the module's name.
    # pydantic's core is a distribution of its own, which pydantic pins to the exact version it needs.
    return {canonical(providers.get(module, [module])[0]) for module in foreign} - {"pydantic-core"}


def test_everything_imported_is_a_declared_dependency():
    extras = {*PYPROJECT["project"]["optional-dependencies"]} - {"dev"}
    found = needed(*LAYERS) - set(declared()) - {name for extra in extras for name in declared(extra)}
    assert found == {
        "bridge-messages",
        "bridge-missions",
        "bridge-wheels",
        "rclpy",
    }  # in the process of the bridge, of the user's installation of ROS 2


def test_everything_the_tests_import_is_declared_with_them():
    # Modules of a folder of scripts import each other.
    scripts = {
        canonical(file.stem)
        for name in ("docs/studies", "tests/proofs", "tests/compat", "tests/support")
        for file in (ROOT / name).glob("*.py")
    }
    ros = {"rclpy", *(f"{name}-msgs" for name in ("geometry", "nav", "nav2", "rosgraph", "sensor", "tf2"))}
    assert needed("tests") - scripts - ros - set(declared()) - set(declared("dev")) == set()


def test_declared_dependencies_are_imported_or_have_a_reason():
    # fsspec imports s3fs; the others are declared for their bounds alone, which are Prefect's,
    # see pyproject.toml and below.
    assert set(declared()) - needed(*LAYERS) == {"fastapi", "python-dateutil", "s3fs", "sqlalchemy"}


def test_dependency_bounds_match_prefects_extras():
    asked = {canonical(need.name): need for need in map(Requirement, requires("prefect")) if not need.marker}
    bounded = {name: need for name, need in declared().items() if name in asked}
    assert {name: need.extras for name, need in bounded.items() if need.extras != asked[name].extras} == {}


def test_fastapi_is_bounded_to_versions_that_prefect_supports():
    # With 0.155 and later Prefect 3.8.8's server dies while it is imported. Prefect 3.9 says <0.151 itself.
    bound = declared()["fastapi"].specifier
    assert ("0.150.0" in bound, "0.151.0" in bound, version("fastapi") in bound) == (True, False, True)
    assert "3.8.8" in declared()["prefect"].specifier


def test_prefects_server_can_be_imported():
    done = run(sys.executable, "-c", "import prefect.server.api.server")
    assert done.returncode == 0, done.stderr


def test_importing_the_flows_imports_neither_prefect_nor_numba():
    code = "import sys, vastflow.flows; print(sorted({'prefect', 'numba', 'fastapi', 'scipy'} & set(sys.modules)))"
    assert run(sys.executable, "-c", code).stdout.strip() == "[]"


def test_wheel_is_tried_with_allowed_pythons():
    page = (ROOT / "docs" / "operate.md").read_text()
    tried = re.search(r"With Python ([\d., and]+)", page)[1]
    allowed = SpecifierSet(PYPROJECT["project"]["requires-python"])
    assert all(python in allowed for python in re.findall(r"\d+\.\d+(?:\.\d+)?", tried))


def test_readme_runs_a_campaign_that_exists_with_a_command_that_exists():
    line = readme_line(
        "python3 -m venv .venv && .venv/bin/pip install -c deployments/constraints.txt -e . && ", "quickstart.vast"
    )
    *_, command = line.split(" && ")
    program, verb, campaign = command.split()
    assert Path(program).name in PYPROJECT["project"]["scripts"]
    assert verb == "run"
    assert (ROOT / campaign).is_file()


def test_readme_begins_with_python_alone_and_has_two_long_commands():
    blocks = re.findall(r"^```sh\n(.*?)^```", README, re.MULTILINE | re.DOTALL)
    assert blocks[0].startswith("python3 -m venv ")
    assert len([block for block in blocks if "install" in block]) == 2


def test_readme_installs_requirements_of_tests():
    line = readme_line(
        "python3 -m venv .venv && .venv/bin/pip install -c deployments/constraints.txt -e ",
        ".venv/bin/pytest -n 3 --dist loadfile",
    )
    extra = re.search(r"'\.\[(\w+)\]'", line)[1]
    assert {"pytest", "pytest-xdist", "ruff", "mypy", "import-linter"} <= set(declared(extra))


def test_checkout_installs_tested_versions():
    commands = [line for line in README.splitlines() + DOCKERFILE.splitlines() if "/pip install" in line]
    assert len(commands) == 3
    assert all(" -c deployments/constraints.txt " in command for command in commands)


@each_row("python", ["3.11", "3.12", "3.13"])
def test_tested_versions_are_within_the_ranges_of_the_distribution(python):
    tested = {
        canonical(line.name): Version(next(iter(line.specifier)).version)
        for line in map(Requirement, re.findall(r"^[^\s#].*$", CONSTRAINTS, re.MULTILINE))
        if line.marker is None or line.marker.evaluate({"python_full_version": f"{python}.9", "python_version": python})
    }
    for extra in ("", *PYPROJECT["project"]["optional-dependencies"]):
        for name, needed in declared(extra).items():
            assert tested[name] in needed.specifier, f"{name}: {tested[name]} tested, {needed} declared"


@pytest.fixture
def checkout(tmp_path):
    """The CI script in a checkout whose README and checks can be chosen."""
    (tmp_path / ".ci").mkdir()
    shutil.copy(ROOT / ".ci" / "run", tmp_path / ".ci")

    def ci_run(readme: str, *options: str, check: str = "echo checked"):
        (tmp_path / "README.md").write_text(readme)
        (tmp_path / ".ci" / "check").write_text(f"#!/bin/sh\n{check}\n")
        (tmp_path / ".ci" / "check").chmod(0o755)
        return run(tmp_path / ".ci" / "run", *options)

    return ci_run


TEST_LINE = "python3 -m venv --without-pip .venv && echo tested with .venv/bin/pytest"
TESTED = "tested with .venv/bin/pytest"


@pytest.mark.parametrize(
    ("readme", "options", "check", "code", "passed", "message"),
    [
        (
            f"# Title\n\n{TEST_LINE} -n 2\n",
            [],
            "echo checked",
            0,
            [f"{TESTED} -n 2", "checked", f"{TESTED} -n 2 --slow"],
            "",
        ),
        (
            TEST_LINE.replace("tested with", "-c deployments/constraints.txt"),
            ["--newest"],
            "true",
            0,
            [".venv/bin/pytest", ".venv/bin/pytest --slow"],
            "",
        ),
        (TEST_LINE.replace("echo", "false"), [], "echo checked", 1, [], ""),
        (TEST_LINE, [], "false", 1, [TESTED], ""),
        (
            TEST_LINE.replace("echo tested with", "test -n"),
            [],
            "echo checked",
            2,
            ["checked"],
            "",
        ),  # which takes no --slow
        ("# No command\n", [], "true", 1, [], "exactly one"),
        (f"{TEST_LINE}\n{TEST_LINE}\n", [], "true", 1, [], "exactly one"),
    ],
    ids=["all", "newest", "quick tests", "checks", "slow tests", "no command", "two commands"],
)
def test_ci_runs_the_readme_line_then_checks_then_slow_tests(checkout, readme, options, check, code, passed, message):
    done = checkout(readme, *options, check=check)
    assert (done.returncode, [line for line in done.stdout.splitlines() if not line.startswith("+ ")]) == (code, passed)
    assert message in done.stderr


def test_ci_checks_lint_format_types_layers_and_the_wheel():
    check = (ROOT / ".ci" / "check").read_text()
    tools = ["ruff check", "ruff format --check", "mypy", "lint-imports", "python tests/proofs/wheel.py"]
    assert [tool for tool in tools if f"\n.venv/bin/{tool}" not in check] == []
