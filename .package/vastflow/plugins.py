"""What plug-ins import: names that stay, whatever modules they come from.

A name that is imported below is one of this module's, for type checkers as for Python, which imports it when it is asked for: who
reads the parameters of a controller needs no oracle. Plug-ins' keys follow a name to the module that it comes from.
"""

from typing import TYPE_CHECKING, Any

from vastflow.surface import homes, named

if TYPE_CHECKING:
    from vastflow.flows.export.conformance import check_format as check_format
    from vastflow.flows.export.format import ExportedCampaign as ExportedCampaign
    from vastflow.flows.export.format import ExportedConfiguration as ExportedConfiguration
    from vastflow.flows.export.format import ExportedFile as ExportedFile
    from vastflow.flows.export.format import Format as Format
    from vastflow.flows.export.run import ExportedRun as ExportedRun
    from vastflow.oracles.judgment.conformance import check_oracle as check_oracle
    from vastflow.oracles.judgment.oracle import Oracle as Oracle
    from vastflow.oracles.judgment.oracle import OracleParameters as OracleParameters
    from vastflow.oracles.judgment.registry import oracle_of as oracle_of
    from vastflow.oracles.judgment.verdict import Metric as Metric
    from vastflow.oracles.judgment.verdict import Verdict as Verdict
    from vastflow.oracles.observation.obstacle_tracks import ObstacleTrack as ObstacleTrack
    from vastflow.oracles.observation.obstacle_tracks import obstacle_tracks_of as obstacle_tracks_of
    from vastflow.oracles.observation.situation import Situation as Situation
    from vastflow.oracles.observation.trace import NoReference as NoReference
    from vastflow.oracles.observation.trace import Reference as Reference
    from vastflow.oracles.observation.trace import Trace as Trace
    from vastflow.producers.model.configuration import Fragment as Fragment
    from vastflow.producers.model.configuration import Rejection as Rejection
    from vastflow.producers.model.conformance import check_producer as check_producer
    from vastflow.producers.model.producer import Draws as Draws
    from vastflow.producers.model.producer import Producer as Producer
    from vastflow.producers.model.producer import ProducerParameters as ProducerParameters
    from vastflow.producers.model.producer import evaluate as evaluate
    from vastflow.producers.search.conformance import check_strategy as check_strategy
    from vastflow.producers.search.space import Point as Point
    from vastflow.producers.search.space import Space as Space
    from vastflow.producers.search.strategy import Cell as Cell
    from vastflow.producers.search.strategy import Evaluation as Evaluation
    from vastflow.producers.search.strategy import Problem as Problem
    from vastflow.producers.search.strategy import Proposal as Proposal
    from vastflow.producers.search.strategy import Strategy as Strategy
    from vastflow.producers.search.strategy import StrategyParameters as StrategyParameters
    from vastflow.sim.kernels.plug_in import kernel as kernel
    from vastflow.sim.kernels.streams import integer_below as integer_below
    from vastflow.sim.kernels.streams import normal_pair as normal_pair
    from vastflow.sim.kernels.streams import uniform as uniform
    from vastflow.sim.model.digest import Value as Value
    from vastflow.sim.model.parameter import parameter as parameter
    from vastflow.sim.model.pose import Pose as Pose
    from vastflow.sim.model.recording import Run as Run
    from vastflow.sim.model.shape import Box as Box
    from vastflow.sim.model.shape import Disc as Disc
    from vastflow.sim.model.shape import Polygon as Polygon
    from vastflow.sim.nav2.controllers.conformance import check_controller as check_controller
    from vastflow.sim.nav2.controllers.controller import Controller as Controller
    from vastflow.sim.nav2.controllers.controller import ControllerInput as ControllerInput
    from vastflow.sim.nav2.controllers.controller import PlanCut as PlanCut
    from vastflow.sim.nav2.controllers.controller import Setting as Setting
    from vastflow.sim.nav2.controllers.controller import SpeedLimits as SpeedLimits
    from vastflow.sim.nav2.costmaps.window import Window as Window
    from vastflow.sim.nav2.costmaps.window import cost_at as cost_at
    from vastflow.sim.nav2.costmaps.window import outline_hits as outline_hits
    from vastflow.sim.nav2.parameter_files.plug_ins import find_controller as find_controller
    from vastflow.sim.nav2.parameter_files.plug_ins import find_planner as find_planner
    from vastflow.sim.nav2.planners.conformance import check_planner as check_planner
    from vastflow.sim.nav2.planners.planner import GOAL_OCCUPIED as GOAL_OCCUPIED
    from vastflow.sim.nav2.planners.planner import GOAL_OUTSIDE as GOAL_OUTSIDE
    from vastflow.sim.nav2.planners.planner import NO_VALID_PATH as NO_VALID_PATH
    from vastflow.sim.nav2.planners.planner import START_OCCUPIED as START_OCCUPIED
    from vastflow.sim.nav2.planners.planner import START_OUTSIDE as START_OUTSIDE
    from vastflow.sim.nav2.planners.planner import TIMEOUT as TIMEOUT
    from vastflow.sim.nav2.planners.planner import Planner as Planner
    from vastflow.sim.nav2.planners.planner import PlannerInput as PlannerInput
    from vastflow.sim.nav2.planners.planner import PlannerSetting as PlannerSetting
    from vastflow.sim.system.facts import RobotFact as RobotFact
    from vastflow.sim.system.system import System as System
    from vastflow.sim.world.bodies import Body as Body
    from vastflow.sim.world.motion import arc as arc
    from vastflow.sim.world.motion import wrapped as wrapped
    from vastflow.sim.world.mover import Mover as Mover
    from vastflow.sim.world.mover import ReactiveMover as ReactiveMover
    from vastflow.sim.world.mover import Sight as Sight
    from vastflow.sim.world.mover_conformance import check_mover as check_mover
    from vastflow.sim.world.noise import LidarNoise as LidarNoise
    from vastflow.sim.world.noise import Scan as Scan
    from vastflow.sim.world.noise_conformance import check_lidar_noise as check_lidar_noise
    from vastflow.sim.world.noise_registry import find_lidar_noise as find_lidar_noise
    from vastflow.sim.world.readers.conformance import check_world_reader as check_world_reader
    from vastflow.sim.world.readers.reader import WorldError as WorldError
    from vastflow.sim.world.readers.reader import WorldReader as WorldReader

else:  # of which a type checker would conclude that every name is there

    def __getattr__(name: str) -> Any:
        return named(__name__, name)


def __dir__() -> list[str]:
    return sorted(homes(__name__))
