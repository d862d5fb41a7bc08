"""Strategies: each keeps the contract, comes back to the same points, and finds what it is for."""

from pathlib import Path

import numpy as np
import pytest
from table import each_row

from vastflow.producers.campaign_file.search import SearchDimension, SearchSpec
from vastflow.producers.search.conformance import CHECKS, check_strategy
from vastflow.producers.search.criteria import best_of, criteria, plan_text, runs_until
from vastflow.producers.search.sampling import Random, SamplingParameters
from vastflow.producers.search.space import Space
from vastflow.producers.search.strategy import Evaluation, Problem, Proposal, asked, find_strategy
from vastflow.sim.model.faults import UserError

MIXED = {
    "x": SearchDimension(type="float", low=0.1, high=10, log=True),
    "n": SearchDimension(type="int", low=0, high=9, step=3),
    "m": SearchDimension(type="int", low=1, high=100, log=True),
    "k": SearchDimension(type="choice", values=["a", [1]]),
    "b": SearchDimension(type="bool"),
}
PLANE = {name: SearchDimension(type="float", low=-2, high=2) for name in ("x", "y")}
ARCHIVE = {"archive": {"measures": {"x": {"low": 0, "high": 5}, "y": {"low": 0, "high": 5, "bins": 4}}}}
CVT = {"archive": {"type": "cvt", "cells": 16, "measures": {"x": {"low": 0, "high": 5}}}, "emitters": 2}
STRATEGIES = {
    "random": ("random", {}, MIXED),
    "sobol": ("sobol", {}, MIXED),
    "halton": ("halton", {}, MIXED),
    "textbook halton": ("halton", {"scramble": False}, MIXED),
    "tpe": ("optuna", {}, MIXED),
    "cmaes": ("optuna", {"sampler": "cmaes"}, MIXED),
    "grid": ("qd", ARCHIVE, MIXED),
    "cvt": ("qd", CVT, MIXED),
    "boundary": ("boundary", {}, PLANE),
}


def strategy(name, given, dimensions, **problem):
    kind = find_strategy(name, Path())
    if kind.library:
        pytest.importorskip(kind.library)
    return kind, kind.Parameters.model_validate(given), Problem(Space(dimensions), seed=3, per_batch=6, **problem)


def searched(kind, parameters, problem, objective, batches):
    """All evaluations of a search whose objective is a function of the point."""
    found, told = kind(parameters, problem), []
    for batch in range(batches):
        first = len(told) + 1
        proposals = [Proposal(first + k, batch, point) for k, point in enumerate(found.ask(batch, problem.per_batch))]
        wanted = kind.measures(parameters)
        evaluations = [
            Evaluation(each, "judged", objective(each.point), {name: each.point[name] for name in wanted}, 5)
            for each in proposals
        ]
        found.tell(evaluations)
        told += evaluations
    return found, told


@each_row("check", CHECKS)
@each_row("name", STRATEGIES)
def test_shipped_strategy_keeps_the_contract(name, check):
    check(*strategy(*STRATEGIES[name]))


def test_strategy_that_keeps_no_contract_is_found():
    class Careless(Random):
        def ask(self, batch, count):
            return [{"x": np.random.rand()}] * count

    with pytest.raises(AssertionError, match=r"Careless must propose points of the space"):
        check_strategy(Careless, SamplingParameters(), Problem(Space(PLANE), per_batch=2))


@each_row("unit", [0.0, 0.2, 0.5, 0.999, 1.0])
def test_point_that_is_coded_and_decoded_is_the_same(unit):
    space = Space(MIXED)
    point = space.decoded([unit] * len(MIXED))
    assert space.contains(point)
    again = space.decoded(space.encoded(point))
    assert again == {**point, "x": pytest.approx(point["x"])}


def test_ends_of_the_unit_cube_are_the_ends_of_every_range():
    ends = {"x": (0.1, 10), "n": (0, 9), "m": (1, 100), "k": ("a", [1]), "b": (False, True)}
    for end in (0, 1):
        assert Space(MIXED).decoded([end] * 5) == {name: both[end] for name, both in ends.items()}


def test_halton_without_scrambling_is_the_textbooks_sequence_across_batches():
    kind, parameters, problem = strategy("halton", {"scramble": False}, PLANE)
    found = kind(parameters, problem)
    points = [point for batch in range(2) for point in found.ask(batch, 2)]
    units = [[0, 0], [1 / 2, 1 / 3], [1 / 4, 2 / 3], [3 / 4, 1 / 9]]  # radical inverses of 0 to 3 to the bases 2 and 3
    assert [problem.space.encoded(point) for point in points] == [pytest.approx(unit, abs=1e-12) for unit in units]


PLACES = {"archive": {"bins": 5, "measures": {name: {"low": -2, "high": 2} for name in PLANE}}}


@each_row(("name", "given"), [("optuna", {}), ("qd", PLACES)])
def test_equal_objectives_give_points_from_the_whole_space(name, given):
    kind, parameters, problem = strategy(name, given, PLANE)
    found, told = searched(kind, parameters, problem, lambda point: 0.0, 40)
    assert name != "qd" or len(found.archive) >= 18
    inner = [max(map(abs, each.proposal.point.values())) < 1 for each in told]
    assert np.mean(inner) == pytest.approx(0.25, abs=0.08)


def test_minimizing_search_prefers_lowest_value():
    kind, parameters, problem = strategy("optuna", {}, PLANE, direction="minimize")
    _, told = searched(kind, parameters, problem, lambda point: abs(point["x"] - 1), 12)
    assert best_of(told, "minimize").objective < 0.1


def spec(**criteria_of_file):
    space = {"x": {"type": "float", "low": 0, "high": 1}}
    return SearchSpec.model_validate({"strategy": "random", "search_space": space, **criteria_of_file})


def batches(*objectives):
    numbered = iter(range(1, 99))
    return [
        [Evaluation(Proposal(next(numbered), k, {}), "judged", value, {}, 5, 3600.0) for value in batch]
        for k, batch in enumerate(objectives)
    ]


@each_row(
    ("objective", "direction", "runs"),
    [(0.8, "maximize", 10), (0.9, "maximize", None), (0.1, "minimize", 20), (0.5, "minimize", 5)],
)
def test_runs_are_counted_until_a_point_is_as_good(objective, direction, runs):
    told = [each for batch in batches([0.2, 0.8], [0.8, 0.1]) for each in batch]
    assert runs_until(told, objective, direction) == runs


@each_row(
    ("asked", "met"),
    [
        ({"budget": {"batches": 2}}, "batches 2 of 2"),
        ({"budget": {"runs": 20}}, "runs 20 of 20"),
        ({"budget": {"evaluations": 4}}, "judged points 4 of 4"),
        ({"budget": {"evaluations": 5}}, None),
        ({"budget": {"simulated_hours": 4}}, "simulated hours 4.00 of 4"),
        ({"stopping": {"target_objective": 0.7}}, "objective 0.8, target 0.7"),
        ({"stopping": {"no_improvement": 1}}, "batches without improvement 1 of 1"),
        ({"stopping": {"no_improvement": {"patience": 2, "min_delta": 0.5}}}, None),
        ({"stopping": {"metric": {"name": "coverage", "op": ">=", "value": 0.3}}}, "coverage 0.4 >= 0.3"),
        ({"stopping": {"metric": {"name": "coverage", "value": 0.3}}}, "coverage 0.4 >= 0.3"),
        ({"budget": {"batches": 9}, "max_proposals": 4}, "proposals 4 of 4"),
    ],
)
def test_search_ends_at_the_criterion_that_is_met_first(asked, met):
    found = list(criteria(spec(**asked), batches([0.2, 0.8], [0.8, 0.1]), {"coverage": 0.4}, 0.0))
    assert next((each.text for each in found if each.met), None) == met


def test_plan_names_each_end_with_its_unit():
    budget = [{"batches": 1}, {"evaluations": 20}, {"runs": 60}, {"simulated_hours": 2}, {"time": 90}]
    metric = {"metric": {"name": "coverage", "op": ">", "value": 0.3}}
    asked = spec(per_batch=4, budget=budget, stopping=[{"target_objective": 0.9}, {"no_improvement": 3}, metric])
    assert plan_text(asked, 5) == (
        "search by random of 1 dimension to maximize failure_rate, 4 points a batch with 5 runs each, until 1 batch or "
        "20 judged points or 60 runs or 2 simulated hours or 90 s or failure_rate >= 0.9 or no improvement in 3 batches or "
        "coverage > 0.3 or 1000 proposals, then 60 fresh runs of the best"
    )


@each_row(
    ("points", "message"),
    [
        ([{"x": 2.5, "y": 0.0}], r"Odd proposes \{'x': 2\.5, 'y': 0\.0\} in batch 1, which is not in the search space"),
        ([{"x": 0.0}], "not in the search space. Expected a value of each dimension"),
        ([{"x": 0.0, "y": 0.0}] * 3, "strategy Odd proposes 3 points in batch 1. Expected at most 2"),
    ],
)
def test_unsuitable_proposals_are_refused(points, message):
    odd = type("Odd", (Random,), {"ask": lambda self, batch, count: points})
    with pytest.raises(UserError, match=message):
        asked(odd(SamplingParameters(), Problem(Space(PLANE))), 1, 2)
