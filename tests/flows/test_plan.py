"""The plan: what a run would compute and why, compared with what the run then computes."""

import json
import shutil
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import called
from planned import planned
from room import edited, laid_out

from vastflow.flows import run_campaign
from vastflow.flows.plan import plan as plans
from vastflow.flows.results.past import newest_past
from vastflow.flows.results.provenance import STAGES
from vastflow.flows.results.reasons import whys
from vastflow.flows.run import prepared
from vastflow.oracles.results.unusable import UnusableDirectory
from vastflow.sim.model.blocks import read_rows
from vastflow.sim.model.faults import FileError
from vastflow.tasks.keys import source
from vastflow.tasks.keys.source import SourceTree

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

FAMILY = """\
  - name: hall
    parameters:
      - map_file: room.yaml
      - start_pose: {x: 1.0, y: 1.0, yaw: 0.0}
      - goal_pose: {x: 1.6, y: 1.0, yaw: 0.0}
"""


@pytest.fixture(scope="module")
def place(flow_folder):
    laid_out(flow_folder, "dry", [0.6])
    return flow_folder


@pytest.fixture(scope="module")
def first(place):
    found = run_campaign(place / "dry.vast", results=place / "results", store=place / "store", workers=2)
    assert found.faults == ()
    return found.directory


class Again:
    """An edited copy of the campaign over a copy of the first run's store."""

    def __init__(self, folder, place):
        self.folder = folder
        self.place = place
        self.store = folder / "store"

    def dry(self, *edits, **options):
        edited(self.folder, *edits)
        options = {"results": self.place / "results", "store": str(self.store), **options}
        return planned(self.folder / "dry.vast", **options)

    def run(self):
        return run_campaign(self.folder / "dry.vast", results=self.folder / "results", store=self.store, workers=2)

    def counted(self):
        of_block = {"execute": ("*/*/*", "recordings.parquet"), "observe": ("*/*", "traces.parquet")}
        counts = {
            stage: sum(len(read_rows(file.read_bytes())) for file in self.store.glob(f"{stage}/{level}/{name}"))
            for stage, (level, name) in of_block.items()
        }
        manifests = [json.loads(m.read_text().partition("\n")[2]) for m in self.store.glob("judge/*/*/manifest")]
        counts["judge"] = sum(len(manifest["info"]["runs"]) for manifest in manifests)
        return {"instantiate": len(list(self.store.glob("evaluate/*/*/manifest"))), **counts}


@pytest.fixture
def again(place, first, tmp_path):
    folder = tmp_path / "edited"
    shutil.copytree(place, folder, ignore=shutil.ignore_patterns("prefect", "results"))
    return Again(folder, place)


def computed(found):
    return {stage: found.computed(stage) for stage in STAGES}


def reasons(found, stage):
    return [(why.kind, str(why), why.amount) for why in whys(found.due) if why.stage == stage]


def files(folder):
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*")}


def test_plan_computes_everything_before_first_run_and_writes_nothing(place, tmp_path):
    before = files(place)
    found = planned(place / "dry.vast", results=tmp_path / "results", store=str(tmp_path / "store"))
    assert computed(found) == {"instantiate": 2, "execute": 4, "observe": 4, "judge": 4}
    assert [kind for kind, _, _ in reasons(found, "execute")] == ["never computed"]
    assert files(place) == before and list(tmp_path.iterdir()) == []


NOISE = ("dry.vast", "values: [0.0, 0.01]", "values: [0.0, 0.02]")
LEVEL = ("dry.vast", "values: [0.0, 0.01]", "values: [0.005, 0.0, 0.01]")
RUNS = ("dry.vast", "runs: 2", "runs: 5")
LEAST = ("dry.vast", "least_m: 0.1", "least_m: 0.2")
FRONT = ("dry.vast", "configuration:\n", "configuration:\n" + FAMILY)

GATHERED = "all verdicts are in the store, only causes of failures follow anew"

NOTHING = (0, 0, 0, 0)
CASES = {
    "a noise level": (
        [NOISE],
        (1, 2, 2, 2),
        {
            "execute": "scenario changed: system.laserscan_gaussian_noise_std_deviation changed "
            "(written by ParameterVariationList): from 0.01 to 0.02",
            "instantiate": "producer changed: parameters of ParameterVariationList changed: values gained 0.02, lost 0.01",
        },
    ),
    "a level in front": (
        [LEVEL],
        (1, 2, 2, 2),
        {"execute": "new configuration: new configuration: first with laserscan_gaussian_noise_std_deviation = 0.005"},
    ),
    "more runs": ([RUNS], (0, 6, 6, 6), {"execute": "more runs: more runs are asked: 2 before, now 5"}),
    "fewer runs": ([("dry.vast", "runs: 2", "runs: 1")], NOTHING, {}),
    "a family in front": ([FRONT], (0, 2, 2, 2), {"execute": "new configuration: family hall is new"}),
    "nothing": ([], NOTHING, {}),
    "another name": ([("dry.vast", "name: room\n", "name: chamber\n")], NOTHING, {}),
    "an oracle's parameter": (
        [LEAST],
        (0, 0, 0, 4),
        {"judge": "oracle changed: parameters of oracle driven.py:Driven changed: least_m from 0.1 to 0.2"},
    ),
    "an oracle": (
        [("dry.vast", "    - driven", "    - safety: {}\n    - driven")],
        (0, 0, 0, 4),
        {"judge": "oracle changed: oracle safety is new"},
    ),
    "another oracle instead": (
        [("dry.vast", "driven.py:Driven: {least_m: 0.1}", "safety: {}")],
        (0, 0, 0, 4),
        {"judge": "oracle changed: oracle safety is new"},
    ),
    "no oracle": (
        [("dry.vast", "    - driven.py:Driven: {least_m: 0.1}", "    - success: {}")],
        NOTHING,
        {"judge": f"oracle changed: oracle driven.py:Driven is gone: {GATHERED}"},
    ),
    "an oracle's code": (
        [("driven.py", "distance=trace.run.distance_m", "distance=2 * trace.run.distance_m")],
        (0, 0, 0, 4),
        {"judge": "source changed: source of oracle driven.py:Driven changed: its file"},
    ),
    "a producer's code": (
        [("ahead.py", "1.0 + distance_m", "1.1 + distance_m")],
        (1, 4, 4, 4),
        {
            "instantiate": "source changed: source of Ahead changed: its file",
            "execute": "scenario changed: task.goal_pose changed (written by Ahead): position.x from 1.6 to 1.7",
        },
    ),
    "the map": (
        [("room.yaml", "origin: [0.0,", "origin: [0.1,")],
        (1, 4, 4, 4),
        {"instantiate": "input changed: what Ahead reads changed: map_file"},
    ),
}
"""Edits, what they cost in each stage, and why."""


@pytest.mark.parametrize(("edits", "counts", "why"), CASES.values(), ids=CASES)
def test_plan_gives_cost_and_reason_of_edit(again, edits, counts, why):
    found = again.dry(*edits)
    assert tuple(computed(found).values()) == counts
    for stage, words in why.items():
        assert [(f"{kind}: {said}", n) for kind, said, n in reasons(found, stage)] == [(words, found.computed(stage))]


def kernel_edited(again):
    """The tree in which a module that only the stage `execute` reads is another."""
    folders = {name: Path(source.installed_tree()._packages[name]) for name in source.PACKAGES}
    folders["vastflow.sim"] = Path(shutil.copytree(folders["vastflow.sim"], again.folder / "sim"))
    module = again.folder / "sim" / "world" / "lidar.py"
    module.write_text(module.read_text() + "\nANOTHER = 1\n")
    return SourceTree(folders)


def selection(past, metadata):
    metadata["asked"]["only"] = ["room-1-1"]


def checked(past, metadata):
    """Change the version that read the scenarios."""
    table = pq.read_table(past / "configurations.parquet")
    then = pa.array([f"{k:064}" for k in range(table.num_rows)])
    column = table.column_names.index("checked_digest")
    pq.write_table(table.set_column(column, "checked_digest", then), past / "configurations.parquet")


@pytest.mark.parametrize(
    ("change", "edits", "kind", "words"),
    [
        (checked, [], "scenario changed", "what vastflow or a plug-in makes of the same scenario changed"),
        (selection, [FRONT], "new configuration", "the campaign before was only a selection: room-1-1"),
    ],
)
def test_plan_names_differences_from_earlier_campaign(again, first, tmp_path, change, edits, kind, words):
    past = Path(shutil.copytree(first, tmp_path / "past"))
    metadata = json.loads((past / "metadata.json").read_text())
    change(past, metadata)
    (past / "metadata.json").write_text(json.dumps(metadata))
    if not edits:
        shutil.rmtree(again.store / "execute")
    ((found, said, _),) = reasons(again.dry(*edits, since=past), "execute")
    assert found == kind and words in said


def test_plan_names_lost_artifacts_and_leaves_the_store_alone(again, first):
    recordings = sorted(again.store.glob("execute/*/*"))
    shutil.rmtree(recordings[0])
    manifest = next((recordings[1]).glob("*/manifest"))
    manifest.write_text("damaged")
    shutil.rmtree(again.store / "evaluate")
    found = again.dry()
    expected = ("lost", f"not in this store, though an earlier campaign had it: {first.name}")
    ((kind, words, amount),) = reasons(found, "execute")
    assert (kind, words) == expected and 3 <= amount <= 4
    assert {kind for kind, _, _ in reasons(found, "instantiate")} == {"lost"} and found.computed("instantiate") == 2
    assert manifest.read_text() == "damaged" and not (again.store / "evaluate").exists()


def test_plan_reports_producer_that_raises(again):
    found = again.dry(("ahead.py", "        for distance_m", "        1 / 0\n        for distance_m"), FRONT)
    assert [fault.error for fault in found.faults] == ["ZeroDivisionError: division by zero"]
    assert found.computed("execute") == 2


@pytest.mark.parametrize("edits", [[RUNS, LEVEL, FRONT], [NOISE, LEAST]], ids=["grown", "edited"])
def test_run_computes_planned_work(again, edits):
    said = computed(again.dry(*edits))
    before = again.counted()
    assert again.run().summary.executed == said["execute"]
    assert {stage: number - before[stage] for stage, number in again.counted().items()} == said
    assert computed(again.dry()) == dict.fromkeys(STAGES, 0)


def tables(directory):
    return [(directory / f"{name}.parquet").read_bytes() for name in ("verdicts", "runs", "configurations")]


def test_run_of_edited_oracles_equals_fresh_campaign(again):
    """An oracle is added, both are swapped, and one is removed."""
    driven, safety = "    - driven.py:Driven: {least_m: 0.1}\n", "    - safety: {}\n"
    edited(again.folder, ("dry.vast", driven, safety + driven))
    before = again.run()
    for old, new, words in [
        (safety + driven, driven + safety, []),
        (driven + safety, safety, [("oracle changed", f"oracle driven.py:Driven is gone: {GATHERED}", 0)]),
    ]:
        found = again.dry(("dry.vast", old, new), results=again.folder / "results")
        assert (reasons(found, "judge"), tuple(computed(found).values())) == (words, NOTHING)
        found = again.run()
        fresh = again.folder / f"fresh {len(words)}"
        shutil.copytree(again.store, fresh, ignore=shutil.ignore_patterns("judge", "rows", "report"))
        alike = run_campaign(again.folder / "dry.vast", results=again.folder / "others", store=fresh, workers=2)
        assert tables(found.directory) == tables(alike.directory)
        assert tables(found.directory)[0] != tables(before.directory)[0]
        before = found
        why = json.loads((found.directory / "metadata.json").read_text())["why"]
        (row,) = [row for row in why if row["stage"] == "judge"]
        assert (row["reused"], row["computed"], row["why"]) == (4, 0, "; ".join(said for _, said, _ in words))


def test_run_of_edited_kernel_matches_plan(again, monkeypatch):
    tree = kernel_edited(again)
    monkeypatch.setattr(plans, "installed_tree", lambda: tree)
    monkeypatch.setattr(prepared, "installed_tree", lambda: tree)
    found = again.dry()
    assert ("source changed", "source of execute changed: sim.world.lidar", 4) in reasons(found, "execute")
    said, before = computed(found), again.counted()
    assert again.run().summary.executed == said["execute"] == 4
    added = {stage: number - before[stage] for stage, number in again.counted().items()}
    assert added == {"instantiate": said["instantiate"], "execute": 4, "observe": 0, "judge": 0}


def test_newest_past_has_the_name_and_is_not_damaged(first, tmp_path):
    results = tmp_path / "results"
    for name, created, campaign in [("a", "2026-01-01", "dry"), ("b", "2026-03-01", "dry"), ("c", "2026-04-01", "wet")]:
        shutil.copytree(first, results / name)
        metadata = json.loads((results / name / "metadata.json").read_text())
        (results / name / "metadata.json").write_text(json.dumps({**metadata, "created": created, "name": campaign}))
    shutil.copytree(results / "b", results / "d")
    (results / "d" / "configurations.parquet").write_text("damaged")
    assert newest_past(results, "dry").directory == results / "b"
    assert newest_past(results, "other") is None
    assert newest_past(tmp_path / "nowhere", "dry") is None


def test_plan_reports_damaged_past_and_unknown_name(again, first, tmp_path):
    past = Path(shutil.copytree(first, tmp_path / "past"))
    (past / "runs.parquet").unlink()
    with pytest.raises(UnusableDirectory, match=r"past: damaged campaign directory: .*runs\.parquet"):
        again.dry(since=past)
    with pytest.raises(FileError, match=r"No family or configuration 'rom'\. Did you mean 'room'\?"):
        again.dry(only=["rom"])
    assert again.dry(NOISE, only=["room-1-1"]).computed("execute") == 0


def test_plan_command_prints_json_without_prefect(again, first, no_prefect):
    edited(again.folder, NOISE)
    options = ("--store", again.store, "--results", again.place / "results")
    result = called("plan", again.folder / "dry.vast", *options, "--json")
    assert result.exit_code == 0, result.stderr
    said = json.loads(result.stdout)
    assert said["stages"]["execute"] == {"reused": 2, "computed": 2}
    assert said["families"]["room"]["judge"] == {"reused": 2, "computed": 2}
    assert said["compared_with"] == str(first)
    assert {why["stage"] for why in said["why"]} == set(STAGES)
    text = called("plan", again.folder / "dry.vast", *options, "--why").stdout
    assert "execute 2 runs of room-1-2: system.laserscan_gaussian_noise_std_deviation changed" in text
    assert f"compared with {first}" in text.replace("\n", "")
