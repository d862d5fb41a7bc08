"""Nav2 parameters that are written as a document are read as they were."""

from typing import Literal, get_args, get_origin

from hypothesis import given, settings
from hypothesis import strategies as st
from table import each_row

from vastflow.sim.model.parameter import ParameterGroup, range_of
from vastflow.sim.nav2.parameter_files.chosen import parameters_of
from vastflow.sim.nav2.parameter_files.costmaps import OF_THE_MAP, OF_THE_WINDOW
from vastflow.sim.nav2.parameter_files.interpretation import document_of, interpretation
from vastflow.sim.nav2.parameters.costmap import (
    Costmap,
    DenoiseLayer,
    KeepoutFilter,
    SpeedFilter,
    StaticLayer,
    global_costmap,
)
from vastflow.sim.nav2.parameters.dwb import DwbParameters
from vastflow.sim.nav2.parameters.mppi import MppiParameters
from vastflow.sim.nav2.parameters.rpp import RppParameters
from vastflow.sim.nav2.parameters.servers import RotationShim, SmacPlanner2D, SmacPlannerHybrid, SmootherParameters
from vastflow.sim.nav2.parameters.stack import NavParameters

_ONE_BY_ONE = ("refusal", "short_clearing_cells", "place", "consider_footprint", "group_connectivity_type")


@st.composite
def varied(draw, default):
    """Parameters like `default` with other values; those of a group that is not enabled stay."""
    values = {}
    for name, value in default:
        if isinstance(value, ParameterGroup):
            values[name] = draw(varied(value))
        elif name not in _ONE_BY_ONE and draw(st.booleans()):
            field = type(default).model_fields[name]
            chosen = get_args(field.annotation) if get_origin(field.annotation) is Literal else ()
            values[name] = draw(st.sampled_from(chosen) if chosen else values_of(value, *range_of(field)))
    if values.get("enabled", getattr(default, "enabled", True)) is False:
        own = ("place", "scale", "cost_weight", "threshold_to_consider")  # of critics that share a class
        return type(default)(enabled=False, **{name: value for name, value in default if name in own})
    if "max_particles" in values or "min_particles" in values:
        values |= {"min_particles": 1}
    if isinstance(default, MppiParameters) and values["CostCritic"].enabled:
        values["ObstaclesCritic"] = default.ObstaclesCritic.with_values(enabled=False)
    if isinstance(default, Costmap) and default.track_unknown_space:  # the global one
        values |= {"in_odom": False, "publish_frequency": default.publish_frequency}
        if values.setdefault("sized_by_map", True):
            values = {name: value for name, value in values.items() if name not in OF_THE_MAP}
        else:
            values |= {"static_layer": StaticLayer(enabled=False), "width": 20, "height": 30}
    elif isinstance(default, Costmap):
        given = ("in_odom", "sized_by_map", *OF_THE_WINDOW)
        values = {name: value for name, value in values.items() if name not in given}
        if values["static_layer"].enabled:  # one that stays is refused
            values["rolling_window"] = True
    return default.with_values(**values)


def values_of(value, low, high):
    low, high = max(low, -1e9), min(high, 1e9)
    if isinstance(value, str):
        return st.sampled_from(["[]", "", "[[0.3, 0.3], [0.3, -0.3], [-0.3, 0.0]]"])
    if isinstance(value, bool):
        return st.booleans()
    if isinstance(value, int):
        return st.integers(int(low), int(high))
    if isinstance(value, tuple):
        return st.tuples(*(st.floats(low, high) for _ in value))
    return st.floats(low, high)


@settings(max_examples=40, deadline=None)
@given(st.data(), st.sampled_from([MppiParameters(), DwbParameters(), RppParameters()]))
def test_written_document_round_trips(data, controller):
    default = NavParameters(controller=controller)
    parts = {name: data.draw(varied(group)) for name, group in default if name != "robot"}
    if parts["global_costmap"].speed_filter.enabled:  # a second one is refused
        parts["local_costmap"] = parts["local_costmap"].with_values(speed_filter=default.local_costmap.speed_filter)
    kept = {
        name: getattr(default, name)
        for name in ("perturbation", "lidar_noise", "latency", "odometry", "robot", "rotation_shim")
    }
    often = parts["controller_server"].with_values(controller_frequency=1000.0)
    wanted = default.with_values(**parts | kept | {"controller_server": often})
    assert interpretation(document_of(wanted)).parameters == wanted


def of(system, **parts):
    return parameters_of(system).with_values(**parts)


COSTMAP = global_costmap()
FILTERS = {"keepout_filter": KeepoutFilter(), "speed_filter": SpeedFilter(type=2, base=0.5, multiplier=-0.004)}
DENOISE = {"denoise_layer": DenoiseLayer(minimal_group_size=4, group_connectivity_type=4)}
SHIM = RotationShim(enabled=True, forward_sampling_distance=0.7, rotate_to_goal_heading=True)


@each_row(
    "stack",
    [
        *(of({"controller": name}, rotation_shim=SHIM) for name in ("mppi", "dwb", "rpp")),
        of({}, global_costmap=COSTMAP.with_values(**FILTERS)),
        of({}, global_costmap=COSTMAP.with_values(**DENOISE)),
        of({}, planner=SmacPlanner2D(tolerance=0.3, smoother=SmootherParameters(w_data=0.1))),
        of({}, planner=SmacPlannerHybrid(motion_model_for_search="REEDS_SHEPP", smooth_path=False)),
    ],
)
def test_stacks_with_plug_ins_are_read_from_their_documents(stack):
    assert interpretation(document_of(stack)).parameters == stack
