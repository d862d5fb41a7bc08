"""Floor plans in a few lines, and the documented example."""

from pathlib import Path

from vastflow.producers.floorplan.files import PlanFile

EXAMPLE = (Path(__file__).parents[1] / "producers" / "test_floorplan_example.fpm").read_text()
FLOOR_PLANS = Path(__file__).parents[2] / "campaigns" / "floorplans"

ROOM = """\
Floor plan: p
Defaults: walls: thickness: 0.2 m height: 2.5 m
Space a: shape: Rectangle width=4.0 m, length=3.0 m location: wrt: world of: this
"""
DOOR = "Entryway d: shape: Rectangle width=1.0 m, height=2.0 m location: in: a.walls[0] translation: z: 1.0 m\n"


def built(text):
    return PlanFile("p.fpm", text).building()
