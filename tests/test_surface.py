"""The flat surface: its names and signatures, and the names of earlier versions."""

import ast
import importlib.util
import inspect
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from table import each_row

import vastflow
from vastflow import plugins, surface
from vastflow.oracles.judgment.registry import oracle_of
from vastflow.tasks.keys.source import PLUG_IN, installed_tree

ROOT = Path(__file__).parents[1]
GOLDEN = Path(__file__).parent / "golden" / "surface.txt"
FOLDERS = "sim|oracles|producers|tasks|flows|deployments"


def signature_of(value):
    """The parameters of a call, without types, which no version of Python writes as another does."""
    signature = inspect.signature(getattr(value, "py_func", value))
    parameters = [each.replace(annotation=inspect.Parameter.empty) for each in signature.parameters.values()]
    return str(signature.replace(parameters=parameters, return_annotation=inspect.Signature.empty))


def described(name, value):
    """Lines that say what others may call and read of a name."""
    if inspect.isclass(value):
        own = [each for each in value.__mro__ if each.__module__.startswith("vastflow.")]
        members = {name: member for each in reversed(own) for name, member in vars(each).items()}
        fields = {name for each in own for name in inspect.get_annotations(each)}
        is_plain = issubclass(value, Exception) and "__init__" not in {name for each in own for name in vars(each)}
        yield f"class {name}{'(*args)' if is_plain else signature_of(value)}"
        for member in sorted({each for each in {*members, *fields} if not each.startswith("_")}):
            found = getattr(members.get(member), "__func__", members.get(member))
            called = signature_of(found) if inspect.isroutine(found) else ""
            yield f"    {member}{called}"
    elif callable(value) and not hasattr(value, "__args__"):
        yield f"def {name}{signature_of(value)}"
    else:
        yield name if hasattr(value, "__args__") else f"{name} = {value!r}"


def test_surface_has_the_pinned_names_and_signatures(request):
    lines = []
    for module in (vastflow, plugins):
        names = sorted({*surface.homes(module.__name__)})
        lines += [f"# {module.__name__}", *(line for name in names for line in described(name, getattr(module, name)))]
    text = "\n".join(lines) + "\n"
    if request.config.getoption("update_golden"):
        GOLDEN.write_text(text, encoding="utf-8")
    assert text == GOLDEN.read_text(encoding="utf-8")


def test_page_lists_every_name_of_the_surface():
    page = (ROOT / "docs" / "names-that-stay.md").read_text()
    _, own, plug_ins = re.split(r"^## .*$", page, flags=re.MULTILINE)
    for module, text in (("vastflow", own), ("vastflow.plugins", plug_ins)):
        listed = [
            name
            for row in re.findall(r"^\| .* \| (`.*) \|$", text, re.MULTILINE)
            for name in re.findall(r"`(\w+)`", row)
        ]
        assert sorted(listed) == sorted(surface.homes(module))


def test_surface_reexports_every_name_to_type_checkers():
    # Only `import X as X` is a name of the module that others may import.
    for module, file in surface.SURFACES.items():
        tree = ast.parse((ROOT / ".package" / "vastflow" / file).read_text())
        (block,) = [node for node in tree.body if isinstance(node, ast.If)]
        imports = [
            node for node in block.body if isinstance(node, ast.ImportFrom) and node.module.startswith("vastflow.")
        ]
        pairs = [(alias.name, alias.asname) for node in imports for alias in node.names]
        assert [pair for pair in pairs if pair[0] != pair[1]] == [("open_results", "open")][: module == "vastflow"]
        assert len(pairs) == len(surface.homes(module))


@pytest.mark.slow
def test_surface_is_imported_without_errors_of_mypy(tmp_path):
    lines = [f"from {module} import {name}" for module in surface.SURFACES for name in surface.homes(module)]
    (tmp_path / "own.py").write_text("\n".join([*lines, "from vastflow.plugins import Gone", ""]))
    command = [sys.executable, "-m", "mypy", "--config-file", "pyproject.toml", tmp_path / "own.py"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=600)
    assert [line.partition("error: ")[2] for line in done.stdout.splitlines()[:-1]] == [
        'Module "vastflow.plugins" has no attribute "Gone"  [attr-defined]'
    ]


def test_surface_names_missing_name():
    with pytest.raises(AttributeError, match=r"module 'vastflow\.plugins' has no attribute 'Orakel'"):
        plugins.Orakel  # noqa: B018
    with pytest.raises(ImportError, match=r"cannot import name 'nothing' from 'vastflow'"):
        from vastflow import nothing  # noqa: F401


def test_importing_name_imports_its_needs_alone():
    code = (
        "import sys, vastflow.plugins as p; p.Planner; print(sorted({'numba', 'pandas', 'prefect'} & {*sys.modules}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=300)
    assert done.stdout == "[]\n"


def pages():
    folders = [
        (ROOT / "docs", "*"),
        (ROOT / "docs" / "examples", "*"),
        (ROOT / "campaigns", "**/*"),
        (ROOT / "flows" / "cli", "*.j2"),
    ]
    files = [file for folder, pattern in folders for file in sorted(folder.glob(pattern)) if file.is_file()]
    kinds = (".md", ".py", ".ipynb", ".vast", ".osc", ".yaml", ".j2")
    return [file for file in (ROOT / "README.md", *files) if file.suffix in kinds and file.name != "changelog.md"]


def test_pages_and_campaigns_import_surface_alone():
    deep = re.compile(rf"(?:from|import) vastflow\.(?!plugins\b)\w+|vastflow\.(?:{FOLDERS})\.\w+")
    assert len(pages()) > 50
    found = {str(file.relative_to(ROOT)): deep.findall(file.read_text(encoding="utf-8")) for file in pages()}
    assert {file: names for file, names in found.items() if names} == {}


NAMED_BEFORE = {
    "vastflow.oracles.conformance": "check_oracle",
    "vastflow.oracles.evidence.rates": "pooled",
    "vastflow.oracles.judgement.conformance": "check_oracle",
    "vastflow.oracles.judgement.oracle": "Oracle Parameters",
    "vastflow.oracles.judgement.registry": "oracle_of",
    "vastflow.oracles.judgement.verdict": "Verdict",
    "vastflow.oracles.notebook.recorded_tables": "recorded_tables",
    "vastflow.oracles.oracle": "Oracle Parameters oracle_of",
    "vastflow.oracles.rates": "pooled",
    "vastflow.oracles.recorded_tables": "recorded_tables",
    "vastflow.oracles.results.recorded_tables": "recorded_tables",
    "vastflow.oracles.situation": "Situation",
    "vastflow.oracles.trace": "NoReference Trace",
    "vastflow.oracles.verdict": "Verdict",
    "vastflow.producers": "producer",
    "vastflow.producers.configuration": "Fragment Rejection",
    "vastflow.producers.conformance": "CHECKS check_producer",
    "vastflow.producers.producer": "Draws Parameters Producer evaluate",
    "vastflow.sim.digest": "Value",
    "vastflow.sim.nav.controllers.conformance": "check_controller",
    "vastflow.sim.nav.controllers.controller": "Controller ControllerInput kernel",
    "vastflow.sim.nav.controllers.registry": "find_controller",
    "vastflow.sim.nav.footprint": "outline_hits",
    "vastflow.sim.nav.parameters.parameter": "parameter",
    "vastflow.sim.nav2.controllers.registry": "find_controller",
    "vastflow.sim.nav2.parameters.parameter": "parameter",
    "vastflow.sim.nav2.planners.registry": "find_planner",
    "vastflow.sim.recording": "Run",
    "vastflow.sim.recordings.recording": "Run",
    "vastflow.sim.world.robot": "arc wrapped",
}
"""Modules that pages named before, and which are gone, with the names that the pages imported."""


@pytest.fixture
def forgotten(monkeypatch):
    """No module of an earlier version has been imported."""
    for name in [each for each in sys.modules if surface.spec_of(each)]:
        monkeypatch.delitem(sys.modules, name)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.usefixtures("forgotten")
@each_row(("module", "names"), sorted(NAMED_BEFORE.items()))
def test_earlier_module_has_names_that_pages_imported(module, names):
    for name in names.split():
        found = (
            import_module(f"{module}.{name}")
            if module == "vastflow.producers"
            else getattr(import_module(module), name)
        )
        assert found is not None
    assert importlib.util.find_spec(module) is not None
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        import_module(module).nothing  # noqa: B018


def test_moved_names_hide_no_module_and_lead_to_some():
    graph = {str(file.relative_to(ROOT)) for folder in FOLDERS.split("|") for file in (ROOT / folder).rglob("*.py")}
    modules = {"vastflow." + file.removesuffix(".py").removesuffix("/__init__").replace("/", ".") for file in graph}
    assert modules & surface.MOVED.keys() == set()
    assert {place for places in surface.MOVED.values() for place in places} <= modules
    assert surface.MOVED.keys() == NAMED_BEFORE.keys() - {"vastflow.producers"}


OLD_ORACLE = '''"""As the page of 0.2 had it."""

from vastflow.oracles.oracle import Oracle, Parameters
from vastflow.oracles.situation import Situation
from vastflow.oracles.trace import Trace
from vastflow.oracles.verdict import Verdict


class Moved(Oracle[Parameters]):
    Parameters = Parameters

    def judge(self, trace: Trace, situation: Situation) -> Verdict:
        return self.passed(trace)
'''
NEW_ORACLE = """from vastflow.plugins import Oracle, OracleParameters, Situation, Trace, Verdict


class Moved(Oracle[OracleParameters]):
    Parameters = OracleParameters

    def judge(self, trace: Trace, situation: Situation) -> Verdict:
        return self.passed(trace)
"""


@pytest.mark.usefixtures("forgotten")
def test_earlier_oracle_works_and_warns_at_its_own_lines(tmp_path):
    (tmp_path / "moved.py").write_text(OLD_ORACLE)
    with pytest.warns(DeprecationWarning) as raised:
        plugins.check_oracle(oracle_of("moved.py:Moved", {}, tmp_path))
    said = [(warning.filename, warning.lineno, str(warning.message)) for warning in raised]
    assert [(file, line) for file, line, _ in said] == [(str(tmp_path / "moved.py"), line) for line in (3, 4, 5, 6)]
    assert said[0][2] == (
        "vastflow.oracles.oracle goes with the next version: it is vastflow.oracles.judgment.oracle now. "
        "Import from vastflow.plugins or vastflow, whose names stay."
    )


@pytest.mark.slow
def test_command_shows_the_warning_about_an_earlier_name(tmp_path):
    (tmp_path / "moved.py").write_text(OLD_ORACLE)
    (tmp_path / "old.vast").write_text(
        "version: 1\nmetadata: {name: old}\nconfiguration: [{name: a, parameters: [start_pose: {x: 1, y: 1}, goal_pose: {x: 2, y: 1}]}]\n"
        "execution: {runs: 1}\nevaluation: {oracles: ['moved.py:Moved']}\n"
    )
    command = [Path(sys.executable).with_name("vastflow"), "validate", tmp_path / "old.vast"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert f"{tmp_path}/moved.py:3: DeprecationWarning: vastflow.oracles.oracle goes" in done.stderr


def test_name_that_left_surface_still_works_and_warns(monkeypatch):
    monkeypatch.setattr(surface, "MOVED", {"vastflow.plugins.Verdikt": ("vastflow.oracles.judgment.verdict.Verdict",)})
    with pytest.warns(DeprecationWarning, match=r"vastflow\.plugins\.Verdikt goes with the next version") as raised:
        from vastflow.plugins import Verdikt
    assert (Verdikt, raised[0].filename) == (plugins.Verdict, __file__)
    assert list(surface.origins("vastflow.plugins.Verdikt")) == ["vastflow.oracles.judgment.verdict.Verdict"]


def modules_behind(folder, text):
    (folder / "moved.py").write_text(text)
    code = installed_tree().plug_in_code(type(oracle_of("moved.py:Moved", {}, folder)))
    return {name: digest for name, digest in code.modules.items() if name != PLUG_IN}


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.usefixtures("forgotten")
def test_code_behind_an_oracle_is_the_same_however_it_imports(tmp_path):
    deep = OLD_ORACLE.replace("oracles.oracle", "oracles.judgment.oracle").replace(
        "oracles.verdict", "oracles.judgment.verdict"
    )
    deep = deep.replace("oracles.situation", "oracles.observation.situation").replace(
        "oracles.trace", "oracles.observation.trace"
    )
    found = {name: modules_behind(tmp_path, text) for name, text in (("deep", deep), ("flat", NEW_ORACLE))}
    assert found["flat"] == found["deep"]
    assert "vastflow.oracles.observation.trace" in found["flat"]
    assert not any(
        name.startswith(("vastflow.plugins", "vastflow.surface", "vastflow.flows")) for name in found["flat"]
    )
    assert "vastflow.sim.nav2.planners.planner" not in found["flat"]
    moved = modules_behind(tmp_path, OLD_ORACLE)
    assert found["deep"].items() <= moved.items()  # with the module of `oracle_of`, which was in that of `Oracle`


@pytest.mark.parametrize(
    "line", ["import vastflow.plugins", "from vastflow import plugins", "from vastflow.plugins import *"]
)
def test_code_behind_import_of_whole_surface_is_all_of_it(tmp_path, line):
    found = modules_behind(tmp_path, NEW_ORACLE.replace("\n\n", f"\n{line}\n\n", 1))
    homes = {
        module for module, _ in surface.homes("vastflow.plugins").values() if not module.startswith("vastflow.flows")
    }
    assert homes <= found.keys()
