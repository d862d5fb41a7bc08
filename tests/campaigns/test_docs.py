"""The documentation: its examples work, its tables are complete, its links lead somewhere."""

import re
import shutil
import subprocess
import sys
import textwrap
from dataclasses import dataclass, fields
from pathlib import Path
from typing import get_args

import pytest
import yaml
from table import each_row
from typer.main import get_command

from vastflow.flows.cli.__main__ import app
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.results.summary import Summary
from vastflow.oracles.judgment.judge import judge_block
from vastflow.oracles.judgment.registry import known_oracles, oracle_class
from vastflow.oracles.observation.observe import observe_block
from vastflow.oracles.observation.trace import trace_of
from vastflow.producers.campaign_file.sections import Unexecuted
from vastflow.producers.campaign_file.spec import (
    CampaignSpec,
    EvaluationSpec,
    ExecutionSpec,
    FamilySpec,
    ResultsProcessingSpec,
)
from vastflow.producers.catalog.obstacle import ObstacleConfig
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.producers.model.producer import PRODUCERS, find_producer
from vastflow.sim.model.blocks import read_block, read_recordings, write_recordings
from vastflow.sim.model.recording import Outcome
from vastflow.sim.reading.abstract import BUILTIN, SHIPPED
from vastflow.sim.reading.vocabulary import ACTIONS
from vastflow.sim.run import run
from vastflow.sim.scenario.language.declaring import library, library_names
from vastflow.sim.scenario.language.reading import read_scenarios
from vastflow.sim.scenario.tree.modifier import MODIFIERS
from vastflow.sim.scenario.tree.stand_ins import stand_ins
from vastflow.sim.scenario.tree.support import TOPICS, unsupported

ROOT = Path(__file__).parents[2]
OFFICE = ROOT / "campaigns" / "quickstart" / "maps"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


@dataclass(frozen=True)
class Block:
    """A fenced block of a page; `about` is what follows the language on its first line."""

    page: str
    number: int
    language: str
    about: str
    text: str

    def __str__(self):
        return f"{self.page}-{self.number}"


def blocks() -> list[Block]:
    found = []
    for page in PAGES:
        fenced = re.findall(r"^```(\w+) ?(.*)\n((?:.*\n)*?)^```$", page.read_text(), re.MULTILINE)
        found += [Block(page.stem, k, *parts) for k, parts in enumerate(fenced)]
    return found


BLOCKS = blocks()
CAMPAIGNS = [b for b in BLOCKS if b.language == "yaml" and b.text.startswith("version:")]
VARIATIONS = [b for b in BLOCKS if (b.language, b.about) == ("yaml", "variations")]
ORACLES = [b for b in BLOCKS if (b.language, b.about) == ("yaml", "oracles")]
FILES = [b for b in BLOCKS if b.language == "python" and b.about]
SCENARIOS = [b for b in BLOCKS if b.language == "osc"]


def family_of(variations: str, oracles: str = "") -> str:
    """A whole campaign round a list of producers, with what they leave open given."""
    written = {parameter for entry in yaml.safe_load(variations) for parameter in entry}
    given = (
        ""
        if any(name.startswith("PathVariation") for name in written)
        else "\n      - start_pose: {x: 1, y: 5}\n      - goal_pose: {x: 8, y: 3.2}"
    )
    text = f"version: 1\nconfiguration:\n  - name: docs\n    parameters:\n      - map_file: maps/office.yaml{given}\n"
    text += "    variations:\n" + textwrap.indent(variations, "      ")
    return text + ("evaluation:\n  oracles:\n" + textwrap.indent(oracles, "    ") if oracles else "")


@pytest.fixture
def folder(tmp_path):
    """A folder with the office's map, the pages' files, and those of the program."""
    for place in ("maps", "campaigns/quickstart/maps"):
        shutil.copytree(OFFICE, tmp_path / place)
    for program in (ROOT / "campaigns" / "growth").glob("*.py"):
        shutil.copy(program, tmp_path)
    for block in (*FILES, *SCENARIOS):
        (tmp_path / block.about).write_text(block.text)
    return tmp_path


def read(folder, text):
    (folder / "docs.vast").write_text(text)
    return read_campaign(folder / "docs.vast")


def section(page: str, title: str) -> str:
    """The text below a heading, up to the next."""
    text = (ROOT / "docs" / f"{page}.md").read_text()
    (found,) = re.findall(rf"^#+ {re.escape(title)}\n((?:(?!#).*\n)*)", text, re.MULTILINE)
    return found


def first_column(text: str) -> list[str]:
    """Names in backticks in the first column of the tables of `text`."""
    cells = re.findall(r"^\| (`[^|]*) \|", text, re.MULTILINE)
    return [name for cell in cells for name in re.findall(r"`([^`]+)`", cell)]


def test_pages_have_every_kind_of_example():
    assert all((CAMPAIGNS, VARIATIONS, ORACLES, FILES, SCENARIOS))


@pytest.mark.parametrize("block", CAMPAIGNS, ids=str)
def test_campaign_of_page_is_valid_and_built_in_full(folder, block):
    campaign, _ = read(folder, block.text)
    found = instantiate(campaign)
    assert (campaign.notes, campaign.unexecutable, found.rejections) == ((), (), ())
    assert len(found.configurations) == 12 if block.page == "README" else found.configurations


@pytest.mark.parametrize("block", SCENARIOS, ids=str)
def test_scenario_of_page_is_valid_and_supported(folder, block):
    (definition,) = read_scenarios(folder / block.about)
    assert definition.name == Path(block.about).stem
    assert unsupported(definition, ACTIONS) == []


STAND_IN = stand_ins({}).keys() - {"bag_record"}
SCENARIO = "write-a-scenario"
TABLES = [
    (SCENARIO, ["On the robot and its world", "Without a robot"], ACTIONS - STAND_IN),
    (SCENARIO, ["Replaced"], STAND_IN),
    (SCENARIO, ["Refused"], {name for each in library_names() for name in library(each).actions} - ACTIONS),
    (SCENARIO, ["Topics"], TOPICS),
    (SCENARIO, ["How a run ends, and what is kept"], get_args(Outcome)),
    ("run-and-resume", ["`--json`"], [field.name for field in fields(Summary)]),
]


@each_row(("page", "titles", "names"), TABLES)
def test_tables_of_sections_are_complete(page, titles, names):
    described = [name for title in titles for name in first_column(section(page, title))]
    assert sorted(described) == sorted(names)


def test_modifiers_and_shipped_scenarios_are_described():
    text = (ROOT / "docs" / "write-a-scenario.md").read_text()
    assert [name for name in MODIFIERS if f"`{name}(" not in text] == []
    (table, _) = text.split("## Send the robot")
    assert first_column(table)[1:] == [BUILTIN + name for name in SHIPPED]


@pytest.mark.parametrize("block", VARIATIONS, ids=str)
def test_producers_of_page_build_configurations(folder, block):
    campaign, _ = read(folder, family_of(block.text))
    assert campaign.notes == ()
    assert instantiate(campaign).configurations


def test_producer_of_page_rejects_short_paths(folder):
    (block,) = [block for block in VARIATIONS if block.page == "write-a-producer"]
    found = instantiate(read(folder, family_of(block.text))[0])
    assert (len(found.configurations), len(found.rejections)) == (4, 2)
    assert "from its end, less than 1 m" in found.rejections[0].reason


@pytest.mark.slow
def test_oracle_of_page_judges_run(folder):
    (block,) = ORACLES
    producers = "- PathVariationRandom: {path_length: 4.0, robot_diameter: 0.5}\n"
    campaign, oracles = read(folder, family_of(producers, block.text))
    (configuration,) = instantiate(campaign).configurations
    recorded = write_recordings([run(configuration.scenario, 0)])
    verdicts = judge_block(
        configuration.scenario, recorded, observe_block(configuration.scenario, recorded), oracles
    ).verdicts
    assert [verdict.oracle for verdict in verdicts] == ["success", "safety", "localized.py:Localized"]
    (error,) = [verdict.metrics["greatest_error"] for verdict in verdicts if "localized" in verdict.oracle]
    assert error.unit == "m"
    assert 0 < error.value < 1


@pytest.mark.slow
def test_tests_of_pages_pass(folder):
    tests = [block.about for block in FILES if block.about.startswith("test_")]
    assert len(tests) == 5
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", str(folder), *tests]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stdout


@each_row("name", PRODUCERS.known)
def test_table_of_producer_has_its_parameters(name):
    kind = find_producer(name, ROOT)
    table, _, obstacles = section("write-a-campaign", f"`{name}`").partition("Each of `obstacle_configs`")
    assert sorted(first_column(table)) == sorted(set(kind.Parameters.model_fields) - {"dimension"})
    if name == "ObstacleVariation":
        assert sorted(first_column(obstacles)) == sorted(ObstacleConfig.model_fields)


@each_row("name", known_oracles())
def test_table_of_oracle_has_parameters_and_defaults(name):
    text = section("write-a-campaign", f"`{name}`")
    rows = re.findall(r"^\| `(\w+)` \| (\S+) \|", text, re.MULTILINE)
    parameters = oracle_class(name).Parameters.model_fields
    assert {key: yaml.safe_load(default) for key, default in rows} == {k: f.default for k, f in parameters.items()}


def test_table_of_unexecuted_keys_is_complete():
    text = section("write-a-campaign", "Read, but not executed by this version")
    rows = re.findall(r"^\| ([^|]*) \| (`[^|]*) \|", text, re.MULTILINE)
    said = {where.strip("`"): set(re.findall(r"`([^`]+)`", keys)) for where, keys in rows}
    sections = {
        "campaign": CampaignSpec,
        "a family": FamilySpec,
        "execution": ExecutionSpec,
        "results_processing": ResultsProcessingSpec,
        "evaluation": EvaluationSpec,
    }
    marked = {
        where: {
            name for name, field in model.model_fields.items() if any(isinstance(m, Unexecuted) for m in field.metadata)
        }
        for where, model in sections.items()
    }
    assert said == {where: keys for where, keys in marked.items() if keys}


def test_columns_of_a_trace_are_all_described(folder):
    producers = "- PathVariationRandom: {path_length: 3.0, robot_diameter: 0.5}\n"
    producers += "- ObstacleVariation: {obstacle_configs: [{amount: 1, max_distance: 0.8}], robot_diameter: 0.5}\n"
    (configuration,) = instantiate(read(folder, family_of(producers))[0]).configurations
    recorded = write_recordings([run(configuration.scenario, 0)])
    ((row, columns),) = read_block(observe_block(configuration.scenario, recorded))
    trace = trace_of(read_recordings(recorded)[0], row, columns)
    there = {re.sub(r"/.*", "/<size class>", name) for name in (*trace.columns, "appearing_clearance_m")}
    assert sorted(first_column(section("write-an-oracle", "What it gets"))) == sorted(there)


@each_row(("name", "page"), [("run", "run-and-resume"), ("plan", "see-what-would-run")])
def test_page_describes_options_and_commands(name, page):
    command = get_command(app).commands[name]
    options = {name for option in command.params for name in option.opts if name.startswith("--")}
    described = {name.split()[0] for name in first_column(section(page, f"`vastflow {name}`"))}
    assert described == options
    commands = {name.split()[1] for name in first_column(section("run-and-resume", "Commands")) if " " in name}
    assert commands == set(get_command(app).list_commands(None))


def places(page: Path) -> list[str]:
    return [link for link in re.findall(r"\]\(([^)#\s]+)", page.read_text()) if "://" not in link]


@each_row("page", PAGES)
def test_links_of_pages_exist(page):
    assert [link for link in places(page) if not (page.parent / link).exists()] == []


def test_pages_are_reachable_from_the_readme():
    reached, todo = set(), [ROOT / "README.md"]
    while todo:
        page = todo.pop()
        if page not in reached:
            reached.add(page)
            todo += [(page.parent / link).resolve() for link in places(page) if link.endswith(".md")]
    assert set(PAGES) <= reached
