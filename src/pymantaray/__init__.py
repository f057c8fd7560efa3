"""
MantaRay: effects of refraction in the ocean on acoustic ranges, and on the positions estimated from
them.

The names here are the public interface; each is imported from its folder when it is first used.
"""

from typing import TYPE_CHECKING

from pymantaray.lazy import lazy_exports
from pymantaray.version import __version__ as __version__

if TYPE_CHECKING:
    from pymantaray.acoustics import Medium as Medium
    from pymantaray.acoustics import find_eigenrays as find_eigenrays
    from pymantaray.apps.atlas import Atlas as Atlas
    from pymantaray.apps.atlas import AtlasLinks as AtlasLinks
    from pymantaray.apps.atlas import open_atlas as open_atlas
    from pymantaray.apps.atlas import run_atlas as run_atlas
    from pymantaray.apps.atlas import safety_table as safety_table
    from pymantaray.apps.atlas import write_atlas_page as write_atlas_page
    from pymantaray.apps.atlas import write_atlas_plots as write_atlas_plots
    from pymantaray.apps.bellhop import BellhopOptions as BellhopOptions
    from pymantaray.apps.bellhop import HalfSpace as HalfSpace
    from pymantaray.apps.bellhop import compare_with_bellhop as compare_with_bellhop
    from pymantaray.apps.bellhop import linear_medium as linear_medium
    from pymantaray.apps.bellhop import read_bellhop_arrivals as read_bellhop_arrivals
    from pymantaray.apps.bellhop import read_bellhop_rays as read_bellhop_rays
    from pymantaray.apps.bellhop import write_bellhop as write_bellhop
    from pymantaray.apps.export import export_authors as export_authors
    from pymantaray.apps.export import export_run as export_run
    from pymantaray.apps.graphs import Certificate as Certificate
    from pymantaray.apps.graphs import GraphResult as GraphResult
    from pymantaray.apps.graphs import certify as certify
    from pymantaray.apps.graphs import open_graph as open_graph
    from pymantaray.apps.graphs import solve_graph as solve_graph
    from pymantaray.apps.graphs import to_gtsam as to_gtsam
    from pymantaray.apps.locate import LeverArm as LeverArm
    from pymantaray.apps.locate import LocateOptions as LocateOptions
    from pymantaray.apps.locate import Location as Location
    from pymantaray.apps.locate import Node as Node
    from pymantaray.apps.locate import Pattern as Pattern
    from pymantaray.apps.locate import PlanOptions as PlanOptions
    from pymantaray.apps.locate import PlatformError as PlatformError
    from pymantaray.apps.locate import ReadOptions as ReadOptions
    from pymantaray.apps.locate import SpeedPrior as SpeedPrior
    from pymantaray.apps.locate import Survey as Survey
    from pymantaray.apps.locate import SurveyPlan as SurveyPlan
    from pymantaray.apps.locate import TravelDirection as TravelDirection
    from pymantaray.apps.locate import locate as locate
    from pymantaray.apps.locate import plan_survey as plan_survey
    from pymantaray.apps.locate import read_survey as read_survey
    from pymantaray.apps.locate import write_location_page as write_location_page
    from pymantaray.apps.locate import write_plan_figure as write_plan_figure
    from pymantaray.apps.ocean import write_ocean_plots as write_ocean_plots
    from pymantaray.apps.online import Beacon as Beacon
    from pymantaray.apps.online import DriftingWater as DriftingWater
    from pymantaray.apps.online import OnlineEstimator as OnlineEstimator
    from pymantaray.apps.online import Outcome as Outcome
    from pymantaray.apps.online import PoseEstimate as PoseEstimate
    from pymantaray.apps.online import StartPose as StartPose
    from pymantaray.apps.plan import DeploymentPlan as DeploymentPlan
    from pymantaray.apps.plan import PlanResults as PlanResults
    from pymantaray.apps.plan import PlanSection as PlanSection
    from pymantaray.apps.plan import load_plan as load_plan
    from pymantaray.apps.plan import search_designs as search_designs
    from pymantaray.apps.plan import write_plan_page as write_plan_page
    from pymantaray.apps.ranges import measure as measure
    from pymantaray.apps.rays import write_ray_plot as write_ray_plot
    from pymantaray.apps.replay import DEFAULT_RULE as DEFAULT_RULE
    from pymantaray.apps.replay import DetectionRule as DetectionRule
    from pymantaray.apps.replay import Events as Events
    from pymantaray.apps.replay import PredictionOptions as PredictionOptions
    from pymantaray.apps.replay import Replay as Replay
    from pymantaray.apps.replay import correct_events as correct_events
    from pymantaray.apps.replay import read_events as read_events
    from pymantaray.apps.replay import replay_events as replay_events
    from pymantaray.apps.replay import smooth_positions as smooth_positions
    from pymantaray.apps.replay import write_replay as write_replay
    from pymantaray.apps.service import Ping as Ping
    from pymantaray.apps.service import RangingService as RangingService
    from pymantaray.apps.service import make_server as make_server
    from pymantaray.apps.study import Run as Run
    from pymantaray.apps.study import citation as citation
    from pymantaray.apps.study import open_run as open_run
    from pymantaray.apps.study import run_study as run_study
    from pymantaray.apps.study import write_comparison as write_comparison
    from pymantaray.apps.study import write_report as write_report
    from pymantaray.apps.sweep import Sweep as Sweep
    from pymantaray.apps.sweep import SweepResults as SweepResults
    from pymantaray.apps.sweep import load_sweep as load_sweep
    from pymantaray.apps.sweep import open_sweep as open_sweep
    from pymantaray.apps.sweep import run_sweep as run_sweep
    from pymantaray.apps.sweep import write_sweep_page as write_sweep_page
    from pymantaray.apps.table import CellStatus as CellStatus
    from pymantaray.apps.table import TableRanges as TableRanges
    from pymantaray.apps.table import TravelTimeTable as TravelTimeTable
    from pymantaray.apps.table import build_table as build_table
    from pymantaray.apps.table import open_table as open_table
    from pymantaray.apps.table import save_table as save_table
    from pymantaray.config import StudyConfig as StudyConfig
    from pymantaray.config import load_study as load_study
    from pymantaray.config.build.water import open_water as open_water
    from pymantaray.config.build.water import open_waters as open_waters
    from pymantaray.errors import MantaRayError as MantaRayError
    from pymantaray.estimation import dead_reckon as dead_reckon
    from pymantaray.estimation import read_pyfg as read_pyfg
    from pymantaray.estimation import solve_conditions as solve_conditions
    from pymantaray.estimation import write_pyfg as write_pyfg
    from pymantaray.evaluation import dropout_table as dropout_table
    from pymantaray.evaluation import error_table as error_table
    from pymantaray.evaluation import range_error_table as range_error_table
    from pymantaray.exchange import Tracks as Tracks
    from pymantaray.exchange import read_trajectories as read_trajectories
    from pymantaray.fleet import ConstantTwist as ConstantTwist
    from pymantaray.fleet import Drifting as Drifting
    from pymantaray.fleet import FloatCycle as FloatCycle
    from pymantaray.fleet import StationKeeping as StationKeeping
    from pymantaray.fleet import Vehicle as Vehicle
    from pymantaray.fleet import Waypoints as Waypoints
    from pymantaray.fleet import simulate as simulate
    from pymantaray.geometry import LocalFrame as LocalFrame
    from pymantaray.ocean import open_ocean as open_ocean
    from pymantaray.ocean import to_local as to_local
    from pymantaray.records import Arrivals as Arrivals
    from pymantaray.records import Estimates as Estimates
    from pymantaray.records import Measurements as Measurements
    from pymantaray.records import RangingTruth as RangingTruth
    from pymantaray.records import Trajectories as Trajectories
    from pymantaray.sensing import Landmark as Landmark
    from pymantaray.sensing import NoiseModel as NoiseModel
    from pymantaray.sensing import PingList as PingList
    from pymantaray.sensing import PingSchedule as PingSchedule
    from pymantaray.sensing import SlotSchedule as SlotSchedule
    from pymantaray.sensing import perturb as perturb
    from pymantaray.sensing.water import Water as Water

__getattr__, __dir__, __all__ = lazy_exports(__name__)
