"""Dataclasses as the records kernels read."""

from dataclasses import dataclass, field

import numpy as np

from vastflow.sim.kernels.numeric import njit
from vastflow.sim.kernels.record import record_of


@dataclass(frozen=True, slots=True)
class Critic:
    cost_weight: float = 3.81
    enabled: bool = True


@dataclass(frozen=True, slots=True)
class Controller:
    time_steps: int = 56
    max_velocity: tuple[float, float, float] = (0.5, 0.0, 2.0)
    CostCritic: Critic = field(default_factory=Critic)


@njit
def read(record):
    q = record[0]
    return q.time_steps, q.max_velocity[2], q.CostCritic.cost_weight, q.CostCritic.enabled


def test_kernel_reads_numbers_lists_and_groups_by_their_names():
    assert read(record_of(Controller())) == (56, 2.0, 3.81, 1)


def test_whole_numbers_and_flags_are_whole_numbers_and_the_rest_is_real():
    dtype = record_of(Controller()).dtype
    assert dtype["time_steps"] == np.int64
    assert dtype["CostCritic"]["enabled"] == np.int64
    assert dtype["CostCritic"]["cost_weight"] == np.float64
