"""Keys hold the values that are read and checked, and not the code that reads and checks."""

import ast
import functools
import importlib
import importlib.metadata
import inspect
import shutil
from importlib.util import find_spec
from pathlib import Path

import pytest
from table import each_row

from vastflow.sim.model.digest import FileContent
from vastflow.sim.model.scenario import Scenario
from vastflow.sim.nav2.parameter_files.parameter_file import nav2_file
from vastflow.sim.reading import checked
from vastflow.sim.reading.abstract import abstract_content
from vastflow.sim.reading.checked import checked_digest
from vastflow.sim.system.keys import FILE_KEY
from vastflow.tasks.keys.keys import EVALUATE_SOURCE, EXECUTE_SOURCE, JUDGE_SOURCE, OBSERVE_SOURCE
from vastflow.tasks.keys.source import PACKAGES, READING, SourceTree, installed_tree

MAP = FileContent("room.yaml", "0" * 64)
POSES = {"start_pose": {"x": 1.0, "y": 1.5}, "goal_pose": {"x": 2.0, "y": 1.5}}
STAGES = {"execute": EXECUTE_SOURCE, "observe": OBSERVE_SOURCE, "judge": JUDGE_SOURCE, "evaluate": EVALUATE_SOURCE}

RESULTS_OF_READING = {
    "vastflow.sim.reading.checked.checked_of",
    "vastflow.sim.world.map_file.load_map",
    "vastflow.sim.world.readers.own.world_value",
    "vastflow.sim.world.readers.registry.check_within",
    "vastflow.sim.world.readers.registry.files_of_world",
    "vastflow.sim.world.readers.registry.known_reader",
    "vastflow.sim.world.readers.registry.read_file",
    "vastflow.sim.world.readers.registry.reader_of",
    "vastflow.sim.reading.movers.mover_shapes",
    "vastflow.sim.reading.movers.movers_of",
    "vastflow.sim.reading.movers.movers_value",
    "vastflow.sim.reading.script.script_of",
    "vastflow.sim.world.environment.difference_of",
    "vastflow.sim.world.environment.world_of",
    "vastflow.sim.system.system.system_of",
    "vastflow.sim.plug_ins.registry.plug_in_value",
}
"""Functions that stages call to read content whose value is in keys."""

WORDS_ONLY = {"vastflow.sim.model.names.did_you_mean", "vastflow.sim.model.names.nearest"}
"""Functions whose result is in messages alone."""

REFUSALS = {"vastflow.sim.model.parameter.parameter", "vastflow.sim.scenario.definition.behaviors_of"}
"""Functions that refuse a scenario before it runs, so that no result follows from it."""


def plug_ins():
    """Modules of every producer and oracle of vastflow."""
    groups = ("vastflow.producers", "vastflow.oracles")
    points = [point for group in groups for point in importlib.metadata.entry_points(group=group)]
    return {point.value.partition(":")[0] for point in points if point.value.startswith("vastflow.")}


def below(name, package):
    return name == package or name.startswith(f"{package}.")


def functions_of_reading(module):
    """Names of functions, and of classes with methods, that a module imports from a package that reads and checks."""
    tree = ast.parse(Path(find_spec(module).origin).read_text())
    for node in ast.walk(tree):
        if not isinstance(node, ast.ImportFrom) or not any(below(node.module or "", package) for package in READING):
            continue
        for alias in node.names:
            found = getattr(importlib.import_module(node.module), alias.name)
            members = vars(found).values() if inspect.isclass(found) else ()
            if inspect.isfunction(found) or any(
                isinstance(each, property | functools.cached_property) for each in members
            ):
                yield f"{node.module}.{alias.name}"


def test_computing_code_calls_only_listed_functions_of_reading_code():
    entries = {entry for stage in STAGES.values() for entry in stage} | plug_ins()
    computing = installed_tree().code(*sorted(entries)).modules
    called = {name for module in computing for name in functions_of_reading(module)}
    others = {name for name in called if not name.startswith("vastflow.sim.plug_ins.")}
    assert others <= RESULTS_OF_READING | WORDS_ONLY | REFUSALS


@each_row("stage", STAGES)
def test_stages_have_no_reading_code_in_their_source(stage):
    code = installed_tree().code(*STAGES[stage])
    assert not [module for module in code.modules if any(below(module, package) for package in READING)]
    assert not code.data


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """A cache of parsed source by content: a copy is read where it differs."""
    return tmp_path_factory.mktemp("cache") / "source"


@pytest.fixture
def copied(tmp_path, cache):
    """A copy of vastflow's source, and the digests of all its stages."""
    folders = {}
    for package in PACKAGES:
        source = next(iter(find_spec(package).submodule_search_locations))
        folders[package] = tmp_path / package
        shutil.copytree(source, folders[package], ignore=shutil.ignore_patterns("__pycache__"))

    def digests():
        tree = SourceTree(folders, cache=cache)
        return {name: tree.digest(*entries) for name, entries in {**STAGES, **{p: [p] for p in plug_ins()}}.items()}

    return tmp_path, digests


def test_reworded_hint_is_in_no_source_digest(copied):
    folder, digests = copied
    before = digests()
    for hint in (
        "scenario/language/members.py",
        "model/parameter.py",
        "model/names.py",
        "plug_ins/effects.py",
    ):
        file = folder / "vastflow.sim" / hint
        file.write_text(file.read_text() + '\nHINT = "another wording"\n')
    assert digests() == before


@pytest.mark.parametrize(
    "stray",
    [
        "campaigns.scenarios/report.html",
        "campaigns.scenarios/mine.osc",
        "sim/notes.txt",
        "sim/scenario/language/library/mine.osc",
    ],
)
def test_stray_file_in_a_package_folder_is_in_no_source_digest(copied, stray):
    folder, digests = copied
    before = digests()
    (folder / f"vastflow.{stray}").write_text("stray")
    (folder / "vastflow.oracles" / "report.txt").write_text("stray")
    assert digests() == before


@pytest.mark.parametrize(
    "module", ["navigator/tick.py", "controllers/mppi.py", "controllers/dwb_critics.py", "controllers/rpp.py"]
)
def test_changed_kernel_affects_only_execution_source(copied, module):
    folder, digests = copied
    before = digests()
    kernel = folder / "vastflow.sim" / "nav2" / module
    kernel.write_text(kernel.read_text() + "\nANOTHER = 1\n")
    after = digests()
    assert [name for name in after if after[name] != before[name]] == ["execute"]


def test_changed_radius_of_robot_affects_observing_and_judging(copied):
    folder, digests = copied
    before = digests()
    outline = folder / "vastflow.sim" / "nav2" / "costmaps" / "outline.py"
    outline.write_text(outline.read_text() + "\nANOTHER = 1\n")
    after = digests()
    assert {"observe", "judge"} <= {name for name in after if after[name] != before[name]}


def driving(abstract="builtin:navigate_to_pose", timeout_s=20.0, system=None):
    return Scenario(abstract, timeout_s, {"map_file": MAP}, POSES, system or {})


def parameters(folder, text):
    file = folder / f"nav2-{len(list(folder.iterdir()))}.yaml"
    file.write_text(text)
    return {FILE_KEY: nav2_file(file)}


AMCL = "amcl:\n  ros__parameters:\n    alpha1: 0.3\n    alpha2: 0.4\n"


@each_row(
    "text",
    [
        "# a comment\n" + AMCL,
        "amcl:\n  ros__parameters:\n    alpha2: 0.4\n    alpha1: 0.3\n",
        AMCL + "some_other_node:\n  ros__parameters: {rate: 3}\n",
    ],
)
def test_equal_numbers_in_parameter_file_keep_key(tmp_path, text):
    before = checked_digest(driving(system=parameters(tmp_path, AMCL)))
    assert checked_digest(driving(system=parameters(tmp_path, text))) == before


def test_changed_number_in_parameter_file_changes_key(tmp_path):
    before = checked_digest(driving(system=parameters(tmp_path, AMCL)))
    assert checked_digest(driving(system=parameters(tmp_path, AMCL.replace("0.3", "0.31")))) != before


def test_changed_default_value_changes_key(monkeypatch):
    before = checked_digest(driving())
    real = checked.parameters_of

    def other_default(system):
        found = real(system)
        return found.with_values(amcl=found.amcl.with_values(alpha1=0.31))

    monkeypatch.setattr(checked, "parameters_of", other_default)
    assert checked_digest(driving()) != before


def own_controller(folder, text):
    """A system whose controller is in a file beside its parameters, with a helper."""
    (folder / "mine.py").write_text(
        "import httpx\nfrom gains import GAIN\nfrom vastflow.sim.nav2.controllers.rpp import Rpp\n\n\n"
        f"class Mine(Rpp):\n    {text}\n"
    )
    file = folder / "mine.yaml"
    file.write_text(
        "controller_server:\n  ros__parameters:\n    controller_plugins: [FollowPath]\n"
        "    FollowPath: {plugin: 'mine.py:Mine'}\n"
    )
    return {FILE_KEY: nav2_file(file)}


def test_custom_controller_and_helpers_are_in_key(tmp_path, monkeypatch):
    gains = tmp_path / "gains.py"
    gains.write_text("GAIN = 1\n")
    digests = [checked_digest(driving(system=own_controller(tmp_path, "pass")))]
    assert checked_digest(driving(system=own_controller(tmp_path, "pass"))) == digests[0]
    digests.append(checked_digest(driving(system=own_controller(tmp_path, "def other(self): return 1"))))
    gains.write_text("GAIN = 2\n")
    digests.append(checked_digest(driving(system=own_controller(tmp_path, "def other(self): return 1"))))
    real = importlib.metadata.version
    monkeypatch.setattr(importlib.metadata, "version", lambda name: "99.0" if name == "httpx" else real(name))
    digests.append(checked_digest(driving(system=own_controller(tmp_path, "def other(self): return 1"))))
    assert len(set(digests)) == 4


def test_copy_of_a_shipped_scenario_has_the_same_digest(tmp_path):
    source = next(iter(find_spec("vastflow.campaigns.scenarios").submodule_search_locations))
    copy = Path(shutil.copy(Path(source) / "navigate_to_pose.osc", tmp_path))
    assert checked_digest(driving(abstract_content(copy))) == checked_digest(driving())
    copy.write_text("# a line above, and recordings name lines\n" + copy.read_text())
    assert checked_digest(driving(abstract_content(copy))) != checked_digest(driving())


def test_unread_key_recomputes_nothing():
    assert checked_digest(driving(system={"label": "a"})) == checked_digest(driving(system={"label": "b"}))


def test_whole_seconds_are_the_same_with_a_point_and_without():
    assert checked_digest(driving(timeout_s=20)) == checked_digest(driving(timeout_s=20.0))


@each_row("part", ["environment", "task"])
def test_unread_value_that_seeds_runs_changes_key(part):
    other = {"environment": {"map_file": MAP}, "task": POSES, part: {**getattr(driving(), part), "_x": 1}}
    scenario = Scenario("builtin:navigate_to_pose", 20.0, other["environment"], other["task"], {})
    assert checked_digest(scenario) != checked_digest(driving())


def test_uncheckable_scenario_has_own_digest():
    broken = [Scenario("builtin:no_such", 20.0, {}, {"k": k}, {}) for k in range(2)]
    assert len({checked_digest(each) for each in broken}) == 2
