"""Mutated floor plans and variation files: either a building, closed and drawn, or clean faults; nothing else."""

import random
import re
from pathlib import Path

from table import each_row

from vastflow.producers.floorplan.building import build
from vastflow.producers.floorplan.grid import grid_of
from vastflow.producers.floorplan.mesh import is_closed, mesh_of
from vastflow.producers.floorplan.reading import read_plan
from vastflow.producers.floorplan.rendering import geometry_of
from vastflow.producers.floorplan.syntax import parse
from vastflow.producers.floorplan.variation import parse_variation, variation_of
from vastflow.sim.model.faults import FileError

HERE = Path(__file__).parent
FLOOR_PLANS = HERE.parents[1] / "campaigns" / "floorplans"
PLANS = [HERE / "test_floorplan_example.fpm", FLOOR_PLANS / "nested_rooms.fpm"]
VARIATIONS = [HERE / "test_floorplan_example.variation", FLOOR_PLANS / "corridors.variation"]

BUDGET = 300
"""Mutants of a file; set it to 20,000 for an hour's hunt."""

TOKEN = re.compile(r"\w+|\s+|.", re.DOTALL)
NUMBERS = (
    "0",
    "-1",
    "0.0005",
    "1e-9",
    "1e9",
    "1e999",
    "-0.0",
    "3.",
    ".5",
    "00",
    "2.5e0",
    "180",
    "nan",
    "inf",
    "9" * 40,
)
WORDS = ("walls", "this", "world", "Space", "Column", "Entryway", "Window", "var", "spaced", "not aligned", "deg", "m", "cm",
         "Circle radius=0.5 m", "Polygon points:[(0,0), (0,2), (2,0)]", "rotation: z: 33 deg", "translation: y: 0.7 m",
         ".walls[2]", "and", "}", "{", "[", ":", ",", "//", "\x00", "é", "٣", '"', "uniform", "normal(mean=0, std=9)")  # fmt: skip


def mutated(text, rng):
    """`text` with one to four of its words changed, left out, doubled, swapped, or cut short."""
    tokens = TOKEN.findall(text)
    for _ in range(rng.choice((1, 1, 2, 4))):
        k = rng.randrange(len(tokens))
        numbers = [i for i, token in enumerate(tokens) if token[0].isdigit()]
        what = rng.randrange(8)
        if what <= 1 and numbers:
            tokens[rng.choice(numbers)] = rng.choice(NUMBERS)
        elif what == 2 and numbers:
            i, j = rng.choice(numbers), rng.choice(numbers)
            tokens[i], tokens[j] = tokens[j], tokens[i]
        elif what == 3:
            del tokens[k]
        elif what == 4:
            tokens.insert(k, rng.choice((*WORDS, rng.choice(tokens))))
        elif what == 5:
            tokens[k] = rng.choice((*WORDS, rng.choice(tokens)))
        elif what == 6:
            end = min(len(tokens), k + rng.randrange(1, 60))
            tokens[end:end] = tokens[k:end]
        else:
            del tokens[k : k + rng.randrange(1, 60)]
        if not tokens:
            break
    return "".join(tokens)


def check_faults(error):
    assert error.faults
    for line in str(error).splitlines():
        assert re.match(r"mutant:\d+:\d+: .+(; |, got ).+", line), line


@each_row("file", PLANS)
def test_mutated_plan_gives_a_building_or_clean_faults(file):
    rng = random.Random(f"plan {file.stem}")
    built = 0
    for _ in range(BUDGET):
        text = mutated(file.read_text(), rng)
        try:
            building = build(read_plan(text, "mutant"))
            grid = grid_of(building, resolution_m=0.25)
        except FileError as error:
            check_faults(error)
            continue
        built += 1
        assert geometry_of(building)["spaces"]
        assert set(grid.gray.ravel().tolist()) <= {0, 200, 255}
        if built % 5 == 0:
            assert is_closed(mesh_of(building)), text
    assert BUDGET / 20 < built < BUDGET  # neither are all refused nor is all accepted


@each_row("file", VARIATIONS)
def test_mutated_variation_gives_samples_or_clean_faults(file):
    rng = random.Random(f"variation {file.stem}")
    plan = parse(file.with_suffix(".fpm").read_text(), "plan")
    drawn = 0
    for number in range(BUDGET):
        text = mutated(file.read_text(), rng)
        try:
            variation = variation_of(parse_variation(text, "mutant"), plan)
            sample = variation.sample(number)
            assert len(sample.values) == len(variation.varied)
            build(read_plan(sample.text, "mutant"))
        except FileError as error:
            check_faults(error)
            continue
        drawn += 1
    assert BUDGET / 20 < drawn < BUDGET
