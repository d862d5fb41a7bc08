"""The size of a campaign: more configurations or runs than it permits are refused with the number."""

import re
from pathlib import Path

import pytest
from families import write_map
from table import each_row

from vastflow.producers.campaign import load_campaign, most_configurations
from vastflow.producers.instantiation.instantiate import Family, Grown, growth_of, instantiate
from vastflow.producers.model.configuration import Fragment
from vastflow.producers.model.producer import evaluate
from vastflow.sim.model.faults import FileError
from vastflow.sim.plug_ins.neighbors import PlugInError

UNIFORM = "ParameterVariationDistributionUniform: {name: %s, min: 0, max: 1, num_variations: %d}"


def campaign(folder: Path, *producers: str, execution: str = "", families: int = 1) -> Path:
    write_map(folder, "map", rows=40)
    file = folder / "c.vast"
    lines = "".join(f"      - {producer}\n" for producer in producers)
    poses = "" if "Path" in lines else ", {start_pose: {x: 0.5, y: 1, yaw: 0}}, {goal_pose: {x: 1.5, y: 1, yaw: 0}}"
    head = f"    parameters: [{{map_file: map.yaml}}{poses}]\n    variations:\n"
    text = "".join(f"  - name: {'abc'[k]}\n{head}{lines}" for k in range(families))
    file.write_text(f"execution: {{{execution}}}\nconfiguration:\n{text}")
    return file


def refused(file: Path) -> str:
    with pytest.raises(FileError, match=re.escape(str(file))) as caught:
        load_campaign(file)
    return str(caught.value).removeprefix(f"{file}:")


BOX = "{amount: 1, max_distance: [0.1, 0.2]}"
PATH = "start_pose: '@start_pose', goal_poses: '@goal_poses'"
PLACED = "obstacle_configs: [%s]"


@each_row(
    ("producer", "asked"),
    [
        (f"PathVariationRandom: {{path_length: 5, num_paths: 1000000000, {PATH}}}", "1,000,000,000"),
        (f"PathVariationRandom: {{path_length: [5, 6], num_paths: 60000, {PATH}}}", "120,000"),
        (UNIFORM % ("a", 10**9), "1,000,000,000"),
        ("ParameterVariationDistributionGaussian: {name: a, mean: 0, std: 1, seed: 1, num_variations: 100001}", "100,001"),
        (f"ObstacleVariation: {{count: 30000, obstacle_configs: [{BOX}, {BOX}]}}", "120,000"),
        (f"ObstacleVariation: {{obstacle_configs: [{', '.join([BOX] * 40)}]}}", "1,099,511,627,776"),
        (f"OneOfVariation: {{variations: [{UNIFORM % ('a', 99_999)}, {UNIFORM % ('a', 2)}]}}".replace("[P", "[{P").replace("}, P", "}}, {P").replace("}]", "}}]"), "100,001"),
    ],
)  # fmt: skip
def test_too_many_choices_are_refused_with_the_permitting_key(tmp_path, producer, asked):
    said = refused(campaign(tmp_path, producer))
    number = asked.replace(",", "")
    right = f"At most 100,000 are allowed, unless 'execution: {{max_configurations: {number}}}' permits more."
    assert said == f"5:5: configuration[0].variations: The campaign asks for {asked} configurations. {right}"


def test_product_of_producers_and_the_sum_of_families_count(tmp_path):
    assert "asks for 1,000,000 configurations." in refused(
        campaign(tmp_path, UNIFORM % ("a", 1000), UNIFORM % ("b", 1000))
    )
    said = refused(campaign(tmp_path, UNIFORM % ("a", 50_000), families=3))
    assert "asks for 150,000 configurations, 50,000 of them here." in said


def test_limit_of_the_file_is_read(tmp_path):
    producer = UNIFORM % ("a", 100_001)
    assert "asks for 100,001" in refused(campaign(tmp_path, producer))
    found = load_campaign(campaign(tmp_path, producer, execution="max_configurations: 100001"))
    assert most_configurations(found.families[0]) == 100_001


def test_number_of_runs_is_refused_like_a_number_of_configurations(tmp_path):
    said = refused(campaign(tmp_path, UNIFORM % ("a", 20), execution="runs: 1000000000"))
    assert said == (
        "1:13: execution.runs: The campaign asks for 20,000,000,000 runs, 1,000,000,000 of each configuration. "
        "At most 10,000,000 are allowed, unless 'execution: {max_runs: 20000000000}' permits more."
    )
    found = load_campaign(campaign(tmp_path, UNIFORM % ("a", 20), execution="runs: 3"))
    assert [found.runs_asked(None), found.runs_asked(500_000)] == [3, 500_000]
    assert found.runs_asked(10**6, sample=10) == 10**6
    with pytest.raises(FileError, match="asks for 10,000,020 runs, 500,001 of each configuration"):
        found.runs_asked(500_001)


def test_excessive_amounts_per_meter_are_rejected(tmp_path):
    path = "PathVariationRandom: {path_length: 1.0, num_goal_poses_per_m: 1000000000}"
    (rejection,) = instantiate(load_campaign(campaign(tmp_path, path))).rejections
    assert rejection.reason == "a path of 1 m was to have 1000000000 goals, and the most are 1000"
    path = "PathVariationRandom: {path_length: 1.0, robot_diameter: 0.1, goal_poses: '@goal_pose'}"
    boxes = f"ObstacleVariation: {{{PLACED % '{amount_per_m: 1000000000, max_distance: 0}'}, robot_diameter: 0.1}}"
    (rejection,) = instantiate(load_campaign(campaign(tmp_path, path, boxes))).rejections
    assert re.fullmatch(r"\d{9,10} obstacles were asked for, and the most are 1000", rejection.reason)


class Untold:
    """A producer as users write them: it does not say how many choices there are."""

    reads: tuple[str, ...] = ()
    seed = 0
    most_choices: int | None = None

    def __init__(self, n: int) -> None:
        self.n = n
        self.writes = {f"a{n}": None}

    def produce(self, inputs, draws):
        yield from (Fragment({f"a{self.n}": k}) for k in range(self.n))


def grown(*producers: Untold, most: int) -> Grown:
    growth = growth_of(Family("a", {}, {}, producers, max_configurations=most))
    for producer in producers:
        growth.join({key: evaluate(producer, inputs) for key, inputs in growth.inputs().items()})
    return growth.grown()


def test_endless_producer_is_an_error():
    with pytest.raises(PlugInError, match="Untold yields more than its `most_choices` for one input"):
        evaluate(Untold(10**12), {})


def test_undeclared_choices_are_counted_when_joined():
    assert len(grown(Untold(20), Untold(30), most=600).partials) == 600
    with pytest.raises(
        FileError, match=r"Untold makes 600 configurations of family 'a'\. At most 599 are allowed, unless 'execution:"
    ):
        grown(Untold(20), Untold(30), most=599)
