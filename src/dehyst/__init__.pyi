from dehyst.daemon.api.functions import diagnose as diagnose
from dehyst.daemon.api.functions import identify as identify
from dehyst.daemon.api.functions import invert as invert
from dehyst.daemon.api.functions import load_model as load_model
from dehyst.daemon.api.functions import load_recording as load_recording
from dehyst.daemon.api.functions import simulate as simulate
from dehyst.daemon.api.functions import validate as validate
from dehyst.daemon.client.client import Client as Client
from dehyst.daemon.client.group import Group as Group
from dehyst.daemon.client.positioner import Positioner as Positioner
from dehyst.models.errors import DehystError as DehystError
from dehyst.models.model import Model as Model
from dehyst.models.recording import Recording as Recording
from dehyst.models.recording import Trajectory as Trajectory

__version__: str
