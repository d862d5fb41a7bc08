"""The campaigns of bodies that move: what their files ask for."""

from collections import Counter
from pathlib import Path

import pytest

from vastflow.flows.request.campaign_file import read_campaign
from vastflow.producers.instantiation.instantiate import instantiate
from vastflow.sim.reading.movers import movers_of
from vastflow.sim.run import run

MOVING = Path(__file__).parents[2] / "campaigns" / "moving"


def configurations_of(name):
    campaign, oracles = read_campaign(MOVING / name)
    assert (campaign.notes, campaign.unexecutable) == ((), ())
    assert "social" in {oracle.name for oracle in oracles}
    return instantiate(campaign)


def test_crossing_campaign_asks_for_each_angle_speed_and_delay():
    found = configurations_of("crossing.vast")
    assert (len(found.configurations), len(found.rejections)) == (43, 2)
    assert {rejection.reason for rejection in found.rejections} == {
        "at 10 s, 0 degrees, 0.5 m/s the body begins where the robot does"
    }


@pytest.mark.slow
def test_person_that_crosses_meets_the_robot_at_the_encounter():
    """The robot is expected 10 s after the start where a person from its right passes."""
    found = configurations_of("crossing.vast").configurations
    asked = {"angle_deg": 90.0, "speed": 1.5, "late_s": 0.0}
    (chosen,) = [c for c in found if asked.items() <= c.provenance["_requested_movers.crossing"].items()]
    contacts = [event for event in run(chosen.scenario, 0, 0).run.events if event.kind == "contact"]
    assert contacts[0].what == "crossing"
    assert 9.0 < contacts[0].t_s < 10.5


def test_pedestrian_campaign_has_equal_routes_for_both_manners():
    found = configurations_of("pedestrians.vast")
    assert not found.rejections
    bodies = [movers_of(each.scenario.environment) for each in found.configurations]
    assert Counter(map(len, bodies)) == {3: 6, 8: 6, 20: 6}
    routes = Counter(tuple(body.rule.waypoints for body in each) for each in bodies)
    assert set(routes.values()) == {2}
