"""What Nav2 parameter files set the costmaps and their layers to."""

from table import each_row

from vastflow.sim.nav2.parameter_files.document import parse
from vastflow.sim.nav2.parameter_files.findings import findings
from vastflow.sim.nav2.parameter_files.interpretation import interpretation
from vastflow.sim.nav2.parameters.costmap import ObstacleLayer, StaticLayer

MINIMAL = """
controller_server:
  ros__parameters:
    controller_frequency: 20.0
    controller_plugins: [FollowPath]
    FollowPath: {plugin: "nav2_mppi_controller::MPPIController", batch_size: 1500}
"""


def read(text):
    return interpretation(parse(text, "nav2.yaml"))


def parameters(text):
    return read(text).parameters


def local(text):
    """A local costmap of a document with these parameters, in flow style."""
    return parameters(f"local_costmap: {{local_costmap: {{ros__parameters: {{{text}}}}}}}").local_costmap


def statuses(text):
    return {".".join(found.path[2:]): found.status for found in findings(read(text))}


def test_costmap_is_the_node_in_its_namespace():
    assert read(f"local_costmap: {{ros__parameters: {{robot_radius: 0.3}}}}\n{MINIMAL}").replaced[1] == "local_costmap"


def test_list_of_plug_ins_decides_which_layers_there_are():
    found = local(
        "plugins: [a, b], a: {plugin: 'nav2_costmap_2d::StaticLayer'}, b: {plugin: 'nav2_costmap_2d/InflationLayer'}"
    )
    assert (found.static_layer.enabled, found.obstacle_layer.enabled, found.inflation_layer.enabled) == (
        True,
        False,
        True,
    )


def test_inflation_may_reach_across_a_whole_room():
    text = "plugins: [i], i: {plugin: 'nav2_costmap_2d::InflationLayer', inflation_radius: 5.5}"
    assert local(text).inflation_layer.inflation_radius == 5.5


def test_layer_may_be_switched_off():
    text = "plugins: [a], a: {plugin: 'nav2_costmap_2d::StaticLayer', enabled: false}"
    assert local(text).static_layer == StaticLayer(enabled=False)


@each_row(("layer", "cells"), [("VoxelLayer", 2), ("ObstacleLayer", 0)])
def test_voxel_layer_clears_short_of_the_beams_end(layer, cells):
    scan = "observation_sources: s, s: {data_type: LaserScan, clearing: true, obstacle_max_range: 2.0}"
    found = local(f"plugins: [a], a: {{plugin: 'nav2_costmap_2d::{layer}', {scan}}}").obstacle_layer
    assert found == ObstacleLayer(obstacle_max_range=2.0, short_clearing_cells=cells)


@each_row(
    "sources", ["", "observation_sources: [],", "observation_sources: s, s: {data_type: PointCloud2, marking: false},"]
)
def test_layer_without_a_source_that_marks_neither_marks_nor_clears(sources):
    found = local(f"plugins: [a], a: {{{sources} plugin: 'nav2_costmap_2d::ObstacleLayer'}}").obstacle_layer
    assert (found.enabled, found.marking, found.clearing) == (True, False, False)


def test_point_cloud_that_marks_is_read_as_the_laser_scan_where_there_is_none():
    sources = "observation_sources: up down, up: {obstacle_max_range: 4.0}, down: {marking: false, clearing: true}"
    text = f"local_costmap: {{local_costmap: {{ros__parameters: {{plugins: [a], a: {{plugin: nav2_costmap_2d::ObstacleLayer, {sources}}}}}}}}}"
    found = read(text)
    layer = found.parameters.local_costmap.obstacle_layer
    assert (layer.marking, layer.clearing, layer.obstacle_max_range) == (True, True, 4.0)
    why = {path[-1]: why for path, why in found.reader.unmodeled.items()}
    assert why == {
        "up": "a point cloud is read as the laser scan",
        "down": "only one source, a LaserScan, is modeled",
    }


@each_row(
    "other",
    [
        "o: {plugin: nav2_costmap_2d::VoxelLayer, observation_sources: camera, camera: {data_type: PointCloud2}}",
        "o: {plugin: nav2_costmap_2d::VoxelLayer, enabled: false, observation_sources: s, s: {data_type: LaserScan}}",
        "o: {plugin: spatio_temporal_voxel_layer/SpatioTemporalVoxelLayer}",
    ],
)
def test_of_two_obstacle_layers_the_one_is_read_that_is_on_and_sees_the_scan(other):
    scan = "a: {plugin: nav2_costmap_2d::ObstacleLayer, observation_sources: s, s: {data_type: LaserScan, obstacle_max_range: 7.0}}"
    found = read(f"local_costmap: {{local_costmap: {{ros__parameters: {{plugins: [o, a], {other}, {scan}}}}}}}")
    assert found.parameters.local_costmap.obstacle_layer.obstacle_max_range == 7.0
    assert "a second layer beside a is not modeled" in found.reader.unmodeled.values()


def test_file_with_one_costmap_gives_the_other_its_body():
    footprint = "'[[0.2, 0.4], [0.2, -0.4], [-0.9, 0.0]]'"
    body = f"footprint: {footprint}, footprint_padding: 0.02, robot_radius: 0.5"
    found = parameters(f"global_costmap: {{global_costmap: {{ros__parameters: {{{body}}}}}}}")
    assert found.local_costmap.footprint == found.global_costmap.footprint != "[]"
    assert found.local_costmap.footprint_padding == 0.02
    assert local("robot_radius: 0.4").robot_radius == 0.4
    text = "local_costmap: {local_costmap: {ros__parameters: {robot_radius: 0.4}}}"
    assert parameters(text).global_costmap.robot_radius == 0.4


def test_of_several_sources_the_first_laser_scan_is_used_and_the_others_are_not_modeled():
    sources = (
        "observation_sources: depth scan, depth: {data_type: PointCloud2}, scan: {data_type: LaserScan, clearing: true}"
    )
    text = f"local_costmap: {{local_costmap: {{ros__parameters: {{plugins: [a], a: {{plugin: nav2_costmap_2d::VoxelLayer, {sources}}}}}}}}}"
    assert read(text).parameters.local_costmap.obstacle_layer.clearing
    found = statuses(text)
    assert found["ros__parameters.a.depth.data_type"] == "not modeled"
    assert found["ros__parameters.a.scan.data_type"] == "modeled"


def test_costmaps_without_a_list_have_nav2s_default_layers():
    found = local("robot_radius: 0.3")
    assert (found.static_layer.enabled, found.obstacle_layer.enabled, found.inflation_layer.enabled) == (
        True,
        True,
        True,
    )


def test_global_costmaps_size_is_the_maps():
    text = "global_costmap: {global_costmap: {ros__parameters: {width: 80, resolution: 0.1, plugins: []}}}"
    assert parameters(text).global_costmap.resolution == 0.05
    assert statuses(text)["ros__parameters.width"] == "no effect"


def test_spatio_temporal_voxel_layer_is_read_as_a_voxel_layer_and_said():
    text = """local_costmap: {local_costmap: {ros__parameters: {plugins: [stvl], stvl: {
        plugin: spatio_temporal_voxel_layer/SpatioTemporalVoxelLayer, voxel_decay: 15.0, observation_sources: [clear, mark],
        clear: {data_type: PointCloud2, marking: false}, mark: {data_type: PointCloud2, marking: true, obstacle_range: 4.0}}}}}"""
    found = read(text)
    layer = found.parameters.local_costmap.obstacle_layer
    assert (layer.enabled, layer.marking, layer.clearing, layer.short_clearing_cells) == (True, True, True, 2)
    assert (layer.obstacle_max_range, layer.raytrace_max_range) == (4.0, 4.0)
    assert set(found.reader.unmodeled.values()) == {
        "it is read as a VoxelLayer of the laser scan: no voxel decays, and there is no camera"
    }
