"""Name the module of every public name, for type checkers and for the first use of a name."""

from dem_bridge import errors as errors
from dem_bridge import features as features
from dem_bridge import plot as plot
from dem_bridge import testing as testing
from dem_bridge.accuracy import observed_order as observed_order
from dem_bridge.api.regress import regress as regress
from dem_bridge.api.runs import available as available
from dem_bridge.api.runs import plan as plan
from dem_bridge.api.runs import solve as solve
from dem_bridge.api.runs import write_deck as write_deck
from dem_bridge.api.scenes import scene_from_csv as scene_from_csv
from dem_bridge.api.scenes import scene_from_deck as scene_from_deck
from dem_bridge.api.studies import minimal as minimal
from dem_bridge.api.studies import study as study
from dem_bridge.api.tables import export as export
from dem_bridge.api.tables import table_of as table_of
from dem_bridge.api.trajectories import compare as compare
from dem_bridge.api.trajectories import read_trajectory as read_trajectory
from dem_bridge.api.trajectories import write_trajectory as write_trajectory
from dem_bridge.api.verification import verify as verify
from dem_bridge.backends.base import Resolution as Resolution
from dem_bridge.backends.base import Sampling as Sampling
from dem_bridge.drive import Drive as Drive
from dem_bridge.exports.angles import angles_for as angles_for
from dem_bridge.geometry import Body as Body
from dem_bridge.geometry import Geometry as Geometry
from dem_bridge.geometry import Material as Material
from dem_bridge.lmp.engine import Engine as Engine
from dem_bridge.physics.law import ContactLaw as ContactLaw
from dem_bridge.physics.law import law_of as law_of
from dem_bridge.planning.answer import Plan as Plan
from dem_bridge.scene import Adhesion as Adhesion
from dem_bridge.scene import Damping as Damping
from dem_bridge.scene import Scene as Scene
from dem_bridge.scene import Wall as Wall
from dem_bridge.scene_file import load_scene as load_scene
from dem_bridge.scene_file import shipped_scenes as shipped_scenes
from dem_bridge.scene_file.bodies import chain as chain
from dem_bridge.studies.study import Study as Study
from dem_bridge.studies.verification import Verification as Verification
from dem_bridge.trajectory import Trajectory as Trajectory
from dem_bridge.trajectory import load_trajectory as load_trajectory
from dem_bridge.version import __version__ as __version__

__all__: list[str]
