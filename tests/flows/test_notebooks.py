"""Notebooks: those of vastflow over a campaign, and those that a campaign file names, executed beside its results."""

import json
import re
from datetime import datetime
from pathlib import Path

import pytest
from command_line import called, refused
from explored import TOKEN, explorer_of
from whole_directory import ConfigurationResult, write_results

from vastflow.deployments.explorer.directories import Directories
from vastflow.flows.cli import notebook as notebook_command
from vastflow.flows.request.campaign_file import read_campaign
from vastflow.flows.run import notebook as notebook_module
from vastflow.flows.run import postprocess
from vastflow.flows.run.notebook import Book, execute_books, execute_kept, filled, shipped
from vastflow.flows.run.postprocess import run_steps
from vastflow.oracles.judgment.verdict import Verdict
from vastflow.producers.campaign_file import visualization
from vastflow.producers.campaign_file.visualization import LEVELS, visualization_of
from vastflow.sim.model.blocks import write_recordings
from vastflow.sim.model.recording import Recording, Run
from vastflow.tasks.store.store import open_store


def written(*sources):
    """A notebook with these code cells."""
    cells = [
        {"cell_type": "code", "id": f"c{k}", "metadata": {}, "execution_count": None, "outputs": [], "source": source}
        for k, source in enumerate(sources)
    ]
    return json.dumps({"cells": cells, "metadata": {}, "nbformat": 4, "nbformat_minor": 5})


def outputs_of(file):
    cells = json.loads(Path(file).read_text())["cells"]
    return "".join(text for cell in cells for each in cell["outputs"] for text in each.get("text", ()))


READS = (
    "DATA_DIR = ''\nRESULTS = \"\"  # ours\nRUN = 0",
    "from pathlib import Path\nprint('read', sorted(each.name for each in Path(DATA_DIR).iterdir()), Path(RESULTS).is_dir(), RUN)",
    "Path('beside.txt').write_text('written')",
)


@pytest.fixture
def results(small_room, tmp_path):
    return directory_of(small_room, tmp_path / "results")


def directory_of(file, root, second=0):
    rows = [Recording(Run(run, "7", "succeeded", 0, "", 7.5, 5.0, 0, 0), {}) for run in range(2)]
    verdicts = [Verdict("success", 0, "pass"), Verdict("success", 1, "fail", "late")]
    found = ConfigurationResult([write_recordings(rows)], verdicts=verdicts)
    created = datetime(2026, 11, 29, 7, 0, second)
    return write_results(file, root, found, created=created)


class Shown:
    """A campaign file with one tab of notebooks, run again and again with one store."""

    def __init__(self, file, root):
        self.file, self.root, self.store, self.count = file, root, open_store(root / "store"), 0
        self.text = file.read_text()

    def after(self, **named):
        self.file.write_text(self.text + f"evaluation: {{visualization: [My Tab: {json.dumps(named)}]}}\n")
        self.count += 1
        results = directory_of(self.file, self.root / "results", self.count)
        (results.directory / "report.html").write_text("<!-- work -->work<!-- /work -->")
        tabs = read_campaign(self.file)[0].spec.evaluation.visualization
        done = run_steps(results, (), self.file.parent, visualization_of(tabs), self.store)
        steps = json.loads((results.directory / "postprocessing/steps.json").read_text())["steps"]
        return steps, done


@pytest.fixture
def campaign(small_room, tmp_path):
    (small_room.parent / "reads.ipynb").write_text(written(*READS))
    return Shown(small_room, tmp_path)


@pytest.mark.slow  # 20 CPU-s: four kernels
def test_visualization_executes_each_level_over_the_layout_and_keeps_it_in_the_store(campaign, monkeypatch):
    asked = []
    monkeypatch.setattr(
        notebook_module,
        "execute_books",
        lambda books, real=execute_books: asked.append([each.is_executed for each in books]) or real(books),
    )
    steps, results = campaign.after(run="reads.ipynb", config="reads.ipynb", campaign="reads.ipynb")
    assert [(each["outcome"], each["message"]) for each in steps] == [
        ("done", "4 executed"),
        ("done", "2 executed"),
        ("done", "1 executed"),
    ]
    made = results.directory / "postprocessing"
    assert re.search(r"read \['_config', .*'room-1', 'room-2'\] True 0", outputs_of(made / "My-Tab-campaign.ipynb"))
    assert "'test.xml'] True 1" in outputs_of(made / "room-2/1/My-Tab-run.ipynb")
    assert "True 0" in outputs_of(made / "room-1/My-Tab-config.ipynb") and not (made / "room-1/beside.txt").exists()
    assert "DATA_DIR = ''\n" in json.loads((made / "My-Tab-campaign.ipynb").read_text())["cells"][0]["source"]
    report = (results.directory / "report.html").read_text()
    assert '<a href="postprocessing/room-2/1/My-Tab-run.html">' in report and results.faults == ()
    page = (made / "My-Tab-campaign.html").read_text()
    assert "default-src 'none'" in page and "<script" not in page
    assert asked == [[True] * 4, [True] * 2, [True]]
    asked.clear()
    _, again = campaign.after(run="reads.ipynb", campaign="reads.ipynb")
    assert asked == [[False] * 4, [False]]
    same = again.directory / "postprocessing/room-2/1/My-Tab-run.ipynb"
    assert same.read_bytes() == (made / "room-2/1/My-Tab-run.ipynb").read_bytes()
    asked.clear()
    (campaign.file.parent / "reads.ipynb").write_text(written(*READS, "1"))
    campaign.after(campaign="reads.ipynb")
    assert asked == [[True]]


@pytest.mark.slow  # 10 CPU-s: three kernels
def test_failing_cell_is_a_fault_in_one_sentence_and_verdicts_stay(campaign, monkeypatch):
    failing = ("1", "raise RuntimeError('out\\nof ideas')")
    (campaign.file.parent / "fails.ipynb").write_text(written(*failing))
    for _ in range(2):  # a fault is not kept
        steps, results = campaign.after(config="fails.ipynb")
        assert [each["message"] for each in steps] == ["room-1: cell 2: RuntimeError: out of ideas; 1 more"]
        (fault,) = results.faults
        assert (fault.stage, fault.error) == ("visualization", f"fails.ipynb (config): {steps[0]['message']}")
        assert results.summary.passed == 2
        assert "out" in (results.directory / "postprocessing/room-1/My-Tab-config.html").read_text()
    monkeypatch.setattr(postprocess, "MOST", 1)
    (campaign.file.parent / "ok.ipynb").write_text(written("1"))
    steps, results = campaign.after(run="ok.ipynb")
    assert steps[0]["message"] == "1 executed, 3 left out"
    assert [*steps[0]["files"]] == ["room-1/1/My-Tab-run.html", "room-1/1/My-Tab-run.ipynb"]  # which failed


def test_notebook_imports_nothing_from_its_folder(tmp_path):
    for name in ("pandas", "numpy"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('code of the folder')\n")
    assert execute_books([Book(written("import numpy, pandas"), {}, str(tmp_path / "page"))]) == [""]


def test_store_keeps_outputs_by_text_results_and_values(tmp_path, monkeypatch):
    executed = []

    def execute(books):
        for each in books:
            if each.is_executed:
                executed.append((each.text, each.values["RUN"]))
            Path(f"{each.place}.ipynb").write_text(f"outputs of {each.text}")
        return [""] * len(books)

    monkeypatch.setattr(notebook_module, "execute_books", execute)
    store = open_store(tmp_path / "store")
    for text, results, run in [
        ("a", "r", 0),
        ("a", "r", 0),
        ("b", "r", 0),
        ("a", "s", 0),
        ("a", "r", 1),
        ("a", "r", 0),
    ]:
        book = Book(text, {"RUN": run, "DATA_DIR": f"/tmp/{len(executed)}"}, str(tmp_path / "page"))
        assert execute_kept([book], results, store) == [""]
    assert executed == [("a", 0), ("b", 0), ("a", 0), ("a", 1)]


def test_cell_without_end_is_cut_after_its_time(tmp_path, monkeypatch):
    monkeypatch.setattr(notebook_module, "LIMIT_S", 1.0)
    book = Book(written("1", "while True: pass"), {}, str(tmp_path / "endless"))
    assert execute_books([book]) == ["cell 2: expected an end within 1 s, got none"]


def test_validate_names_notebooks_that_cannot_run(small_room, monkeypatch):
    (small_room.parent / "text.ipynb").write_text("{}")
    (small_room.parent / "good.ipynb").write_text(written("1"))
    text = small_room.read_text()
    small_room.write_text(
        text + "evaluation:\n  visualization:\n    - Tab:\n        run: gone.ipynb\n        config: text.ipynb\n"
        "        campaign: good.ipynb\n        batch: good.ipynb\n"
    )
    line = text.count("\n") + 4
    said = called("validate", small_room)
    words = " ".join((said.stdout + said.stderr).split())
    assert said.exit_code == 0
    assert re.search(rf":{line}:\d+: warning: [^ ]*run: [Tt]here is no notebook 'gone.ipynb'", words)
    assert re.search(
        rf":{line + 1}:\d+: warning: [^ ]*config: [Ee]xpected JSON of nbformat 4, got 'text.ipynb' that is no notebook",
        words,
    )
    assert re.search(rf":{line + 3}:\d+: .*batch: .*the campaign, which has all batches", words)
    assert "good.ipynb" not in words
    monkeypatch.setattr(visualization, "EXTRA", ("nowhere_installed",))
    said = called("validate", small_room)
    assert "nowhere_installed is missing. Call pip install 'vastflow[notebook]'" in " ".join(
        (said.stdout + said.stderr).split()
    )


def test_reading_a_campaign_executes_no_notebook_of_it(small_room, tmp_path, monkeypatch):
    (small_room.parent / "spy.ipynb").write_text(written(f"open({str(tmp_path / 'ran')!r}, 'w')"))
    small_room.write_text(
        small_room.read_text() + "evaluation: {visualization: [T: {campaign: spy.ipynb, run: spy.ipynb}]}\n"
    )
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    for command in ("validate", "plan"):
        assert called(command, small_room).exit_code == 0
    directory = directory_of(small_room, tmp_path / "results").directory
    called("show", directory)
    called("notebook", directory, "--no-execute", "--folder", tmp_path / "out")
    assert not (tmp_path / "ran").exists() and (tmp_path / "out" / f"{directory.name}.ipynb").is_file()
    assert (directory / "inputs/spy.ipynb").is_file()


def test_filled_replaces_only_whole_lines():
    text = written("DATA_DIR = ''\nx = \"RESULTS = ''\"\n  RUN = 0\nRUN = 0  # which", "DATA_DIR = 'mine'")
    values = {"DATA_DIR": "/a \\g<0> 'b'", "RESULTS": "/c", "RUN": 3}
    one, two = (cell["source"] for cell in json.loads(filled(text, values))["cells"])
    assert one.splitlines() == [
        f"DATA_DIR = {values['DATA_DIR']!r}",
        "x = \"RESULTS = ''\"",
        "  RUN = 0",
        "RUN = 3  # which",
    ]
    assert two == "DATA_DIR = 'mine'"


def test_notebook_command_refuses_unknown_names_and_overwrites_nothing(results, tmp_path, monkeypatch):
    directory = results.directory
    assert "expected CONFIGURATION/RUN, such as room-1/0, got 'room-1'" in refused(
        "notebook", directory, "--run", "room-1"
    )
    assert "Unknown configuration 'rom-1'" in refused("notebook", directory, "--configuration", "rom-1")
    assert refused("notebook", directory, "--run", "room-1/7", "--no-execute").endswith(
        "room-1: expected the number of a run, 0 to 1, got 7"
    )
    assert "got several" in refused("notebook", directory, "--run", "room-1/0", "--campaign")
    out = ("--folder", tmp_path / "out")
    called("notebook", directory, "--no-execute", "--run", "room-1/1", *out)
    file = tmp_path / "out" / f"{directory.name}-room-1-1.ipynb"
    assert "RUN = 1" in "".join(json.loads(file.read_text())["cells"][1]["source"])
    assert "expected a new file, got one that exists" in refused(
        "notebook", directory, "--no-execute", "--run", "room-1/1", *out
    )
    monkeypatch.setattr(visualization, "EXTRA", ("nowhere_installed",))
    assert refused("notebook", directory).startswith(
        "nowhere_installed is missing. Call pip install 'vastflow[notebook]'"
    )
    assert notebook_command.__doc__


@pytest.mark.parametrize("level", LEVELS)
def test_shipped_notebook_imports_public_names_alone_and_holds_no_outputs(level):
    notebook = json.loads(shipped(level))
    code = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    imported = set(re.findall(r"(?m)^(?:import|from) (\w+)", "\n".join(code)))
    assert imported <= {"json", "matplotlib", "pandas", "pathlib", "vastflow", "yaml"}
    assert not re.search(r"vastflow\.(flows|oracles|sim|tasks|producers)", "\n".join(code))
    assert all(not cell.get("outputs") for cell in notebook["cells"])
    assert re.search(r"(?m)^RESULTS = \"\"|^RESULTS = ''", "\n".join(code))


@pytest.mark.slow  # 40 CPU-s: a campaign, and a kernel for each level
def test_shipped_notebooks_show_the_numbers_of_the_report(small_room, tmp_path, monkeypatch):
    monkeypatch.setenv("VASTFLOW_STORE", str(tmp_path / "store"))
    monkeypatch.setattr(postprocess, "MOST", 1)
    for level in ("config", "run"):
        (small_room.parent / f"{level}.ipynb").write_text(shipped(level))
    tabs = "[Ours: {config: config.ipynb, run: run.ipynb}]"
    small_room.write_text(small_room.read_text() + f"evaluation: {{visualization: {tabs}}}\n")
    done = called("run", small_room, "--runs", "1", "--results", tmp_path / "results")
    assert done.exit_code in (0, 1), done.stderr
    (directory,) = (tmp_path / "results").iterdir()
    called("notebook", directory, "--folder", tmp_path)
    text = (tmp_path / f"{directory.name}.html").read_text()
    whole = json.loads((directory / "evidence.json").read_text())["all_oracles"]["campaign"]
    for share in (whole["rate"], whole["interval"]["low"], whole["interval"]["high"]):
        assert f"<td>{100 * share:.1f}</td>" in text
    report = (directory / "report.html").read_text()
    for place in ("room-1/Ours-config.html", "room-1/0/Ours-run.html"):
        page = (directory / "postprocessing" / place).read_text()
        assert page.count("data:image/png") == 2 and f"postprocessing/{place}" in report
    client = explorer_of(directory.parent)
    client.get("/", params={"token": TOKEN})
    (told,) = Directories([directory.parent]).all()
    page = client.get("/campaign", params={"c": told.id}).text
    (link,) = re.findall(r'href="(/notebook[^"]*Ours-config[^"]*)"', page)
    shown = client.get(link.replace("&amp;", "&"))
    assert "data:image/png" in shown.text and "sandbox" in shown.headers["content-security-policy"]
    assert client.get("/notebook", params={"c": told.id, "n": "../report.html"}).status_code == 404
